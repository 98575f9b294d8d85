"""Campaigns that live on the solutions of other campaigns."""

import pytest

from service.spec import SpecError
from service.store.errors import StoreError
from tests.service.campaigns import OUTAGE, finish, spec_fields, submitted
from tests.workers.fake import PROVENANCE, record
from workers.executor import Inline
from workers.messages import Ending, JobOutcome


def searches(store, campaign_id=1):
    return {search.name: search for search in store.campaign(campaign_id).searches}


def run_in_vain(job, stop=lambda: False):
    """Find no solution."""
    solves = tuple(record(job, hop, 0.0) for hop in range(job.n_hops))
    return JobOutcome(ending=Ending.INFEASIBLE, solves=solves, provenance=PROVENANCE)


def seeded_elsewhere(**seeds):
    """Return a campaign that lives on the solutions of another one."""
    search = {"id": "s1-0", "strategy": "S(1|0)", "outages": [OUTAGE]}
    search["seeds"] = {"campaign": "test", "from": "s0"} | seeds
    return spec_fields(campaign={"name": "later", "rng_seed": 8}, search=[search])


@pytest.mark.parametrize("seeds", [{}, {"order": "delta_v"}])
def test_seeds_come_from_a_campaign_that_has_ended(store, seeds):
    submitted(store)
    finish(store)
    n_solutions = searches(store)["s0"].n_solutions
    submitted(store, seeded_elsewhere(**seeds))
    finish(store)
    later = searches(store, 2)["s1-0"]
    assert later.n_solves == searches(store)["s0"].n_strict < n_solutions + 1
    assert (later.seeds_from, store.campaign(2).state) == ("test/s0", "done")


@pytest.mark.parametrize("seeds", [{}, {"order": "delta_v"}])
def test_seeds_come_from_a_campaign_that_goes_on(store, seeds):
    submitted(store, spec_fields(guesses=20))
    finish(store, n_steps=2)
    submitted(store, seeded_elsewhere(**seeds))
    finish(store)
    assert searches(store, 2)["s1-0"].n_solves == searches(store)["s0"].n_strict
    assert store.campaign(2).state == "done"


def test_a_campaign_ends_with_the_last_of_those_that_it_lives_on(store):
    submitted(store)
    submitted(store, seeded_elsewhere())
    again = {"id": "s2-1", "strategy": "S(2|1)", "outages": [OUTAGE, OUTAGE | {"segment": 40}]}
    again["seeds"] = {"campaign": "later", "from": "s1-0"}
    submitted(store, spec_fields(campaign={"name": "last", "rng_seed": 9}, search=[again]))
    # No solve of the first finds a seed, so that the others have nothing to do.
    finish(store, Inline(run_in_vain), n_steps=50)
    assert [item.state for item in store.campaigns()] == ["done"] * 3


def test_seeds_of_another_campaign_that_do_not_fit_are_refused_and_nothing_is_stored(store):
    submitted(store)
    other = seeded_elsewhere()
    other["problem"] = {"preset": "ppe-drm3", "n_segments": 40}
    with pytest.raises(SpecError, match="expected the same reference problem"):
        submitted(store, other)
    with pytest.raises(SpecError, match="expected a search of campaign test, got 's7'"):
        submitted(store, seeded_elsewhere(**{"from": "s7"}))
    with pytest.raises(SpecError, match=r"expected a search of S\(0...\) for S\(1\|0\)"):
        submitted(store, seeded_elsewhere(**{"from": "s1-0"}))
    with pytest.raises(StoreError, match="campaign never: expected one that exists"):
        submitted(store, seeded_elsewhere(campaign="never"))
    assert len(store.campaigns()) == 1


def test_a_search_that_has_ended_without_solutions_feeds_no_other(store):
    submitted(store)
    finish(store, Inline(run_in_vain))
    with pytest.raises(SpecError, match=r"expected strict solutions, got none from test/s0, which has ended"):
        submitted(store, seeded_elsewhere())
    assert len(store.campaigns()) == 1
