"""P_k as pygmo sees it, judged by pygmo's own checks and tried by its own optimizers."""

import copy
import json
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

from core.interop import PygmoProblem
from core.problem import load_problem
from core.verification.verify import verify
from tests.core.known import near, solution
from tests.core.transcription.points import random_point

pygmo = pytest.importorskip("pygmo")

VECTORS = json.loads((Path(__file__).parents[2] / "acceptance" / "vectors.json").read_text(encoding="utf-8"))
PRESET = load_problem("ppe-drm3")
#: Few segments, so that differences cost little; one realization, so that there are two kinds of rows.
SMALL = PRESET.model_copy(update={"n_segments": 6}).with_outages([(3, 1.0)])


@pytest.fixture(scope="module")
def small():
    # Exact, since what differences see of the integrator's error is that error over their step.
    return PygmoProblem(SMALL, tolerance=1e-13)


@pytest.fixture(scope="module")
def point(small):
    return small.to_pygmo(random_point(small.transcription, 3))


def dense(problem, z):
    gradient = np.zeros((1 + problem.get_nec(), len(z)))
    rows, columns = problem.gradient_sparsity().T
    gradient[rows, columns] = problem.gradient(z)
    return gradient


def test_pygmo_finds_the_gradient_that_we_state(small, point):
    estimated = pygmo.estimate_gradient_h(small.fitness, point, dx=3e-4).reshape(1 + small.get_nec(), -1)
    stated = dense(small, point)
    assert np.all(np.isfinite(stated))
    largest = np.max(np.abs(stated), axis=1, keepdims=True)
    assert np.max(np.abs(estimated - stated) / largest) < 2e-5


def test_pygmo_finds_no_partial_outside_the_sparsity_that_we_state(small, point):
    estimated = {tuple(pair) for pair in pygmo.estimate_sparsity(small.fitness, point, dx=1e-6).tolist()}
    stated = [tuple(pair) for pair in small.gradient_sparsity().tolist()]
    assert estimated <= set(stated)
    assert len(set(stated)) == len(stated) < 0.8 * len(point) * (1 + small.get_nec())
    # Coasting on a ballistic target has no effect; everything else that is stated is felt.
    final_coasts = {layout.final_coast for layout in small.transcription.layout.trajectories}
    assert {column for _, column in set(stated) - estimated} <= final_coasts


def test_pygmo_takes_it_for_a_problem_with_equality_constraints_and_a_sparse_gradient(small):
    problem = pygmo.problem(small)
    assert (problem.get_nobj(), problem.get_nec(), problem.get_nic()) == (1, 14, 0)
    assert problem.get_nx() == small.transcription.n_variables
    assert problem.has_gradient() and problem.has_gradient_sparsity() and not problem.is_stochastic()
    assert problem.get_name() == "coastarc P_1" and SMALL.hash in problem.get_extra_info()
    lower, upper = (small.from_pygmo(bound) for bound in problem.get_bounds())
    assert np.allclose([lower, upper], small.transcription.bounds, rtol=1e-15)


def test_copies_and_pickles_are_the_same_problem(small, point):
    problem = pygmo.problem(small)
    expected = problem.fitness(point)
    for other in (copy.deepcopy(problem), pickle.loads(pickle.dumps(problem))):
        assert np.array_equal(other.fitness(point), expected)
        assert np.array_equal(other.gradient(point), problem.gradient(point))
        assert other.extract(PygmoProblem).problem == SMALL


@pytest.fixture(scope="module")
def known():
    """A strict solution of P_0 as a population of one."""
    udp = PygmoProblem(PRESET)
    problem = pygmo.problem(udp)
    problem.c_tol = udp.constraint_tolerance
    population = pygmo.population(problem, size=0)
    population.push_back(udp.to_pygmo(np.array(VECTORS["S(0)"][0])))
    return udp, population


def test_what_the_verifier_calls_strict_is_feasible_to_pygmo_and_its_objective_is_the_mass(known):
    udp, population = known
    z = population.get_x()[0]
    found = verify(PRESET, udp.from_pygmo(z))
    assert found.strict and population.problem.feasibility_x(z)
    assert population.get_f()[0][0] * 15000.0 == pytest.approx(-found.final_mass_kg[0], rel=1e-12)


def slsqp():
    algorithm = pygmo.nlopt("slsqp")
    algorithm.maxeval = 60
    return algorithm


def ipopt():
    algorithm = pygmo.ipopt()
    algorithm.set_integer_options({"print_level": 0, "max_iter": 150, "limited_memory_max_history": 30})
    algorithm.set_string_options({"sb": "yes", "nlp_scaling_method": "none"})
    # A small barrier, since the start is near.
    algorithm.set_numeric_options({"mu_init": 1e-5, "bound_push": 1e-7, "bound_frac": 1e-7, "tol": 1e-6})
    algorithm.set_numeric_option("constr_viol_tol", 1e-8)
    return algorithm


def test_an_optimizer_of_pygmo_makes_a_known_solution_a_little_better(known):
    udp, population = known
    evolved = pygmo.algorithm(slsqp()).evolve(population)
    before, after = (verify(PRESET, udp.from_pygmo(one.champion_x)) for one in (population, evolved))
    assert after.strict and after.final_mass_kg[0] > before.final_mass_kg[0] + 1e-4


def test_two_optimizers_of_pygmo_agree_on_the_optimum_near_a_point_that_does_not_arrive(known):
    udp, population = known
    start = udp.to_pygmo(near(udp.transcription, rng_seed=1))
    assert not population.problem.feasibility_x(start)
    masses = []
    for algorithm in (slsqp(), ipopt()):
        own = pygmo.population(population.problem, size=0)
        own.push_back(start)
        found = verify(PRESET, udp.from_pygmo(pygmo.algorithm(algorithm).evolve(own).champion_x))
        assert found.strict
        masses.append(found.final_mass_kg[0])
    assert masses[0] == pytest.approx(masses[1], abs=0.01)
    assert min(masses) > solution()[-1] - 0.01


def test_the_example_of_the_page_runs(capsys):
    page = Path(__file__).parents[3] / "docs" / "interoperability.md"
    (block,) = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    exec(compile(block, str(page), "exec"), {})
    assert capsys.readouterr().out == "154 7 False\n"
