"""From a job to its outcome, with numerics that are told what to find."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from core.nlp import ExitStatus, Outcome
from core.search import ChainState, HopSettings
from tests.service.clock import Clock
from tests.workers.jobs import hop_job
from workers import run
from workers.messages import Address, Ending, JobSettings, MapJob
from workers.retry import Awake

GOOD, WEAK, BAD = 1e-3, 0.5, 1e4  # position defects [km]: strict, paper, neither


def outcome(status, defect_km):
    defects = np.zeros((1, 7))
    defects[0, 0] = defect_km
    x = np.concatenate([[40.0, 1.0, 2.0], np.full(150, 0.5), [12_900.0]])
    return Outcome(status, x, 12_900.0, defect_km / 0.1, defects, 7, 9, 0.1)


class Numerics:
    """Stands for core: returns outcomes from a list, and remembers what it was given."""

    #: As of a chain; these go on from nothing.
    state = ChainState(width=0.1)

    def __init__(self, monkeypatch, outcomes, verdict=(True, True)):
        self.outcomes = list(outcomes)
        self.guesses, self.settings, self.n_verified = [], [], 0
        self.verdict = verdict
        monkeypatch.setattr(
            run, "prepared", lambda definition, settings: (run.problem_from(definition), None)
        )
        monkeypatch.setattr(run, "precompiled", lambda definition, settings: run.problem_from(definition))
        monkeypatch.setattr(run, "Chain", lambda *laws: self)
        monkeypatch.setattr(run.core, "solve", self.solve, raising=False)
        monkeypatch.setattr(run, "solve_seed", self.solve_seed)
        monkeypatch.setattr(run.core, "verify", self.verify, raising=False)
        monkeypatch.setattr(run, "trajectory", lambda *_: None)
        monkeypatch.setattr(run, "verification_record", lambda *_: None)

    def ask(self, rng):
        self.guesses.append(rng.random(3).tolist())
        return self.guesses[-1]

    def tell(self, found):
        return "accepted"

    def solve(self, transcription, guess, settings, stop):
        self.settings.append(settings)
        found = self.outcomes.pop(0)
        if isinstance(found, Exception):
            raise found
        return found

    def solve_seed(self, problem, x, other, mapping, settings, stop, n_legs, tolerance):
        self.form = (n_legs, tolerance)
        return self.solve(None, x, settings, stop)

    def verify(self, problem, x):
        self.n_verified += 1
        return SimpleNamespace(paper=self.verdict[0], strict=self.verdict[1])


SOLVED = outcome(ExitStatus.OPTIMAL, GOOD)
STALLED = outcome(ExitStatus.STALLED, BAD)


def test_every_hop_is_a_record_feasible_or_not(monkeypatch):
    Numerics(monkeypatch, [STALLED, SOLVED, outcome(ExitStatus.TIMEOUT, BAD)])
    found = run.run_job(hop_job(chain=4, n_hops=3))
    assert found.ending is Ending.FEASIBLE
    assert [solve.ending for solve in found.solves] == [Ending.INFEASIBLE, Ending.FEASIBLE, Ending.TIMEOUT]
    assert [solve.rng_key for solve in found.solves] == [f"2026/0/0/0/4/{hop}" for hop in range(3)]
    assert [solve.x is None for solve in found.solves] == [True, False, True]
    assert found.solves[0].defects[0][0] == BAD and found.solves[0].status == "STALLED"


def test_hops_draw_from_their_address_alone(monkeypatch):
    numerics = Numerics(monkeypatch, [STALLED] * 4)
    run.run_job(hop_job(chain=1, n_hops=2))
    run.run_job(hop_job(chain=1, n_hops=2))
    first, second, *again = numerics.guesses
    assert first != second and again == [first, second]


def test_a_solve_at_the_papers_tolerance_is_verified_too(monkeypatch):
    numerics = Numerics(monkeypatch, [outcome(ExitStatus.STALLED, WEAK), STALLED], verdict=(True, False))
    found = run.run_job(hop_job(n_hops=2))
    assert numerics.n_verified == 1
    assert not found.solves[0].is_feasible and found.solves[0].x is not None


def test_what_the_verifier_refuses_is_no_solution(monkeypatch):
    Numerics(monkeypatch, [SOLVED], verdict=(False, False))
    (solve,) = run.run_job(hop_job()).solves
    assert solve.is_feasible and solve.ending is Ending.INFEASIBLE and solve.x is None


def test_a_path_through_a_body_is_no_solution_though_it_is_closed(monkeypatch):
    numerics = Numerics(monkeypatch, [outcome(ExitStatus.IMPACT, GOOD)])
    (solve,) = run.run_job(hop_job()).solves
    assert solve.ending is Ending.INFEASIBLE and solve.x is None and solve.status == "IMPACT"
    assert numerics.n_verified == 0


def test_a_defect_that_is_not_finite_is_a_numerical_ending(monkeypatch):
    Numerics(monkeypatch, [outcome(ExitStatus.NOT_FINITE, float("nan"))])
    found = run.run_job(hop_job())
    assert found.ending is Ending.NUMERICAL
    assert found.solves[0].defects[0][:2] == (None, 0.0) and found.solves[0].violation is None


def test_a_bug_of_ours_is_an_error_with_a_traceback_and_keeps_what_was_done(monkeypatch):
    Numerics(monkeypatch, [STALLED, ZeroDivisionError("oh")])
    found = run.run_job(hop_job(n_hops=3))
    assert found.ending is Ending.ERROR and len(found.solves) == 1
    assert found.error.splitlines()[-1] == "ZeroDivisionError: oh" and "run.py" in found.error


def test_of_a_very_long_error_the_end_is_kept(monkeypatch):
    Numerics(monkeypatch, [ValueError("x" * 200_000 + " and so on")])
    found = run.run_job(hop_job())
    assert found.ending is Ending.ERROR and found.error.endswith("x and so on\n")


def test_a_solve_that_was_stopped_is_no_guess(monkeypatch):
    numerics = Numerics(monkeypatch, [STALLED, STALLED, STALLED])
    found = run.run_job(hop_job(n_hops=3), stop=lambda: len(numerics.settings) == 2)
    assert found.ending is Ending.CANCELLED and len(found.solves) == 1


def test_a_map_job_solves_its_seed_once(monkeypatch):
    numerics = Numerics(monkeypatch, [SOLVED])
    problem = hop_job().problem
    job = MapJob(
        problem=problem,
        rng_seed=3,
        address=Address(search=1, chain=255),
        seed_id=f"{255:032x}",
        seed_problem=problem,
        seed_x=(1.0, 2.0),
        mapping="reference",
        settings=JobSettings(n_legs=17, integrator_tolerance=1e-11),
    )
    (solve,) = run.run_job(job).solves
    assert numerics.form == (17, 1e-11)
    assert solve.rng_key == "3/1/1/0/255/0" and solve.move is None and solve.ending is Ending.FEASIBLE


def test_caps_reach_the_solver_and_what_is_open_keeps_the_default(monkeypatch):
    numerics = Numerics(monkeypatch, [STALLED, STALLED])
    run.run_job(hop_job())
    run.run_job(hop_job(settings={"cpu_seconds": 2.0}))
    first, second = numerics.settings
    assert (first.cpu_seconds, first.max_iterations) == (5.0, 3)
    assert second.cpu_seconds == 2.0 and second.max_iterations > 3


def test_the_wall_clock_stops_a_solve_that_gets_no_processor(monkeypatch):
    monkeypatch.setattr(run, "WALL_MARGIN_S", -1e6)
    stops = []
    numerics = Numerics(monkeypatch, [outcome(ExitStatus.STOPPED, BAD)])
    monkeypatch.setattr(run.core, "solve", lambda *a: (stops.append(a[3]()), numerics.solve(*a))[1])
    found = run.run_job(hop_job())
    assert stops == [True] and found.solves[0].ending is Ending.TIMEOUT


@pytest.mark.parametrize("status", list(ExitStatus))
def test_every_status_of_the_solver_has_an_ending(monkeypatch, status):
    Numerics(monkeypatch, [outcome(status, BAD)])
    assert run.run_job(hop_job()).ending in (Ending.INFEASIBLE, Ending.NUMERICAL, Ending.TIMEOUT)


def test_a_solve_that_the_deadline_cut_short_and_the_verifier_refuses_is_out_of_time(monkeypatch):
    Numerics(monkeypatch, [outcome(ExitStatus.FEASIBLE_AT_DEADLINE, GOOD)], verdict=(False, False))
    assert run.run_job(hop_job()).ending is Ending.TIMEOUT


def test_counts_end_a_solve_long_before_the_clock_does():
    # 1200 iterations were measured to take 7.3 s; a slower processor has more than ten times that.
    assert run.solve_settings(JobSettings()).cpu_seconds >= 100.0


def test_the_laws_of_a_job_reach_its_chain(monkeypatch):
    told = []
    numerics = Numerics(monkeypatch, [STALLED])
    monkeypatch.setattr(run, "Chain", lambda _, settings, place: told.append(settings) or numerics)
    laws = {"hop_law": "pareto", "hop_width": 0.01, "hop_shape": 0.8, "time_hop_probability": 0.05}
    run.run_job(hop_job(laws=HopSettings(max_failures=9, **laws)))
    assert told == [HopSettings(max_failures=9, **laws)]


@pytest.mark.parametrize(
    "wrong",
    [
        {"hop_width": 0},
        {"hop_shape": 0.01},
        {"hop_shape": 11},
        {"time_hop_probability": 1.1},
        {"max_failures": 0},
    ],
)
def test_a_number_that_no_chain_takes_is_no_law_of_a_job(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        HopSettings(hop_law="pareto", **wrong)
    with pytest.raises(ValueError, match=next(iter(wrong))):
        hop_job(laws={"hop_law": "pareto"} | wrong)


def test_a_solve_whose_process_is_stopped_for_hours_is_not_at_its_deadline_when_it_wakes(monkeypatch):
    clock = Clock(0.0)
    monkeypatch.setattr(run, "Awake", lambda: Awake(clock))
    deadline = run._Deadline(JobSettings(cpu_seconds=5.0), SimpleNamespace(k=0), lambda: False)
    for _ in range(3):
        clock.advance(3 * 3600.0)
        assert not deadline()
    # 4 times its cap and 60 s, of which each pause took 10 s.
    clock.advance(9.0)
    assert not deadline()
    is_over = []
    for _ in range(50):
        clock.advance(1.0)
        is_over.append(deadline())
    assert is_over.index(True) == 41


def test_a_process_compiles_before_its_first_mapped_solve_and_never_again(monkeypatch):
    made, is_compiled = [], threading.Event()
    monkeypatch.setattr(run, "_IS_COMPILED", is_compiled)
    monkeypatch.setattr(run, "_transcribed", lambda problem, **_: (made.append(problem), is_compiled.set()))
    definition = run.problem_from({"preset": "ppe-drm3"}).model_dump(mode="json")
    problems = [run.precompiled(definition, JobSettings()) for _ in range(2)]
    assert made == problems[:1]
