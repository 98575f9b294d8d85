"""`coastarc solutions refine`: campaigns whose one seed is the same flight in fewer segments."""

import shutil

import numpy as np
import pytest

from core.problem import problem_from
from core.search import refined_problem
from service.schemas.solution import Filter
from service.solutions.refine import (
    RefineError,
    best_of,
    check_segments,
    first_step,
    next_step,
    refinement_spec,
)
from service.spec import SpecError, spec_from
from service.spec.spec import SeedChoices
from service.store.store import Store
from tests.acceptance.known import SPEC, run_known
from tests.service.campaigns import finish, spec_fields, submitted
from workers.executor import Inline
from workers.run import run_job

LIMITS = {"max_iterations": 60}


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """An archive of one P_0 and the P_1 that it seeded."""
    folder = tmp_path_factory.mktemp("known")
    with Store(folder) as store:
        store.submit(spec_from(SPEC | {"search": [SPEC["search"][0] | {"guesses": 1}, SPEC["search"][1]]}))
        finish(store, Inline(run_known))
    return folder


@pytest.fixture
def archive(known, tmp_path):
    with Store(shutil.copytree(known, tmp_path / "archive")) as opened:
        yield opened


def solution(store, k):
    return store.record(store.certificates.ids(Filter(k=k))[0])


def test_a_refined_solution_leaves_no_less_mass_and_knows_its_seed(archive):
    seed = solution(archive, 0)
    campaign_id, is_new = archive.submit(refinement_spec(archive, seed, 100, LIMITS))
    finish(archive, Inline(run_job))
    found = best_of(archive, campaign_id)
    step = next_step([first_step(archive, seed)], found, campaign_id, 100)
    assert is_new and found.strict and step.gain_kg == found.objective_kg - seed.objective_kg > -1e-3
    assert (found.seed_id, found.mapping, found.strategy, len(found.x)) == (seed.id, "refined", "S(0|0)", 304)
    graph = archive.lineage(seed.id, 10)
    assert (found.id, "refined") in {(child.id, child.mapping) for child in graph.children}
    assert archive.lineage(found.id).edges[0].seed_id == seed.id
    assert archive.campaign_facts(campaign_id).solves


def test_the_same_refinement_again_is_the_same_campaign(archive):
    spec = refinement_spec(archive, solution(archive, 1), 100, LIMITS)
    first, again = archive.submit(spec), archive.submit(spec)
    assert first[1] and again == (first[0], False)


def test_the_outages_of_a_robust_seed_are_those_of_the_finer_problem_at_the_same_times(archive):
    seed = solution(archive, 1)
    campaign_id, _ = archive.submit(refinement_spec(archive, seed, 100, LIMITS))
    (claim,) = archive.claim("somebody", 5, campaign_id)
    assert claim.job.problem["outages"] == [{"segment": 47, "duration_days": 1.0}]
    assert claim.job.mapping == "refined" and claim.job.seed_id == seed.id
    assert np.array_equal(claim.job.seed_x, seed.x) and claim.job.seed_problem["n_segments"] == 50
    assert (
        problem_from(claim.job.problem).hash
        == refined_problem(problem_from(claim.job.seed_problem), 100).hash
    )


def test_a_tolerance_and_limits_reach_the_job(archive):
    spec = refinement_spec(archive, solution(archive, 0), 100, LIMITS | {"integrator_tolerance": 1e-12})
    (claim,) = archive.claim("somebody", 5, archive.submit(spec)[0])
    assert claim.job.settings.integrator_tolerance == 1e-12 and claim.job.settings.max_iterations == 60


def test_a_refinement_does_not_wait_for_the_search_of_its_seed(store):
    submitted(store)
    finish(store, n_steps=3)
    seed = solution(store, 0)
    assert seed.strict and store.campaign(1).state == "active"
    campaign_id, _ = store.submit(refinement_spec(store, seed, 100, LIMITS))
    (claim,) = store.claim("somebody", 5, campaign_id)
    assert claim.job.seed_id == seed.id
    page = store.seeds_of_search(campaign_id, "refined", SeedChoices())
    assert [(item.seed_id, item.mapping, item.job_state) for item in page.items] == [
        (seed.id, "refined", "running")
    ]


def changed(archive, k=1, problem=None, seeds=None, **search):
    fields = refinement_spec(archive, solution(archive, k), 100, {}).as_fields()
    fields["problem"] |= problem or {}
    fields["search"][0] |= search
    fields["search"][0]["seeds"] |= seeds or {}
    return fields


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"outages": [{"segment": 48, "duration_days": 1.0}]},
            "expected one that fits its outages",
        ),
        ({"problem": {"n_segments": 120}}, "multiple of 50"),
        (
            {"problem": {"bounds": {"final_coast_days": [0, 20]}}},
            "expected one of the same reference problem",
        ),
        ({"seeds": {"solution": "0" * 32}}, "seeds.solution: expected a solution of this archive, got 0000"),
        ({"seeds": {"solution": None, "from": "s1"}}, "seeds.solution: expected one for the mapping refined"),
        (
            {"mapping": ["refined", "aligned"]},
            "expected refined alone and k' = k, got refined, aligned for S",
        ),
    ],
)
def test_what_is_no_refinement_is_refused(archive, change, message):
    with pytest.raises(SpecError, match=message):
        archive.submit(spec_from(changed(archive, **change)))


def test_segments_must_grow_by_whole_factors():
    check_segments(50, [100, 200])
    with pytest.raises(
        RefineError, match="--segments: expected a multiple of 100 and more than that, got 150"
    ):
        check_segments(50, [100, 150])


def test_campaigns_that_say_nothing_new_keep_their_identity():
    # The hash that the specification had before searches could name seeds or a tolerance.
    assert spec_from(spec_fields()).hash == "edae0fb520ad9048f3abd6d7751254e0"
