import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.scheduler import (
    CHAINS_AHEAD,
    Candidate,
    Progress,
    after_failure,
    chosen,
    jobs_of_seeds,
    map_jobs,
    next_chains,
    priority,
    search_state,
)
from service.spec import spec_from
from service.spec.search_spec import SearchSpec

NOTHING = Progress(n_chains=0, n_queued=0, n_running=0, cpu_seconds=0.0, n_solutions=0)


def chain_search(**more):
    return SearchSpec.model_validate({"id": "a", "strategy": "S(0)", "guesses": 10} | more)


def seeded_search(**more):
    outages = [{"segment": 4, "duration_days": 1.0}]
    fields = {"id": "b", "strategy": "S(1|0)", "outages": outages, "seeds": {"from": "a"}}
    return SearchSpec.model_validate(fields | more)


def progress(**changes):
    return Progress(**({name: getattr(NOTHING, name) for name in Progress.__slots__} | changes))


def cases(strategy, segments, **more):
    """Return the fields of a search with several cases of outages of a day."""
    return {
        "id": strategy[2:-1].replace("|", "-"),
        "strategy": strategy,
        "cases": segments,
        "duration_days": 1.0,
    } | more


def two_searches(target, source=None):
    """Return a specification whose second search takes the seeds of the first."""
    first = source or cases("S(1)", [[4], [12], [20]], guesses=9)
    target = {"seeds": {"from": first["id"]}} | target
    campaign = {"name": "a", "rng_seed": 1}
    return spec_from({"campaign": campaign, "problem": {"preset": "ppe-drm3"}, "search": [first, target]})


def seed(case, number=1):
    return Candidate(f"{number:032x}", (case, "0", 0), [(4 + 8 * case, 1.0)], 0.5, 50.0)


@settings(deadline=None)  # a busy machine takes its time
@given(guesses=st.integers(1, 2000), hops=st.integers(1, 30), batch=st.integers(1, 300))
def test_chains_share_out_the_whole_budget_whatever_the_order_of_work(guesses, hops, batch):
    search, planned = chain_search(guesses=guesses, hops=hops), []
    n_queued = 0
    while new := next_chains(search, progress(n_chains=len(planned), n_queued=n_queued)):
        planned += new
        n_queued = max(0, n_queued + len(new) - batch)
    assert [job.chain for job in planned] == list(range(len(planned)))
    assert sum(job.n_hops for job in planned) == guesses
    assert all(job.n_hops == hops for job in planned[:-1])


@settings(deadline=None)
@given(guesses=st.integers(12, 500), hops=st.integers(1, 9), n_cases=st.integers(1, 12))
def test_the_budget_is_shared_evenly_among_the_cases(guesses, hops, n_cases):
    fields = cases("S(1)", [[4 * n] for n in range(1, n_cases + 1)], guesses=guesses, hops=hops)
    search, planned = SearchSpec.model_validate(fields), []
    while new := next_chains(search, progress(n_chains=len(planned))):
        planned += new
    shares = [sum(job.n_hops for job in planned if job.case == case) for case in range(n_cases)]
    assert sum(shares) == guesses and max(shares) - min(shares) <= 1
    assert [job.chain for job in planned] == list(range(len(planned)))


def test_every_seed_goes_to_every_case_unless_told_otherwise():
    spec = two_searches(cases("S(2|1)", [[4, 48], [8, 16], [4, 12]]))
    assert [job.case for job in map_jobs(spec, spec.search[1], seed(0))] == [0, 1, 2]


def test_contained_seeds_go_to_the_cases_that_hold_their_outages():
    spec = two_searches(
        cases("S(2|1)", [[4, 48], [8, 16], [4, 12]], seeds={"from": "1", "pairing": "contained"})
    )
    assert [[job.case for job in map_jobs(spec, spec.search[1], seed(case))] for case in range(3)] == [
        [0, 2],
        [2],
        [],
    ]


def test_seeds_take_turns_over_the_cases_in_their_order():
    wanted = {"from": "1", "pairing": "round-robin"}
    spec = two_searches(cases("S(2|1)", [[4, 48], [8, 16], [4, 12]], seeds=wanted))
    seeds = [Candidate(f"{9 - i:032x}", (0, f"{i:032x}", 0), [(4, 1.0)], 0.5, 50.0) for i in range(5)]
    jobs = jobs_of_seeds(spec, spec.search[1], reversed(seeds))
    assert [(job.seed_id[-1], job.case) for job in jobs] == [("9", 0), ("8", 1), ("7", 2), ("6", 0), ("5", 1)]


@pytest.mark.parametrize(("k", "n_mappings"), [(1, 1), (2, 2), (3, 9), (4, 82)])
def test_all_mappings_make_one_more_guess_than_realizations_can_be_chosen(k, n_mappings):
    # k'^k + 1 of the paper, with k' = k - 1.
    first = cases(f"S({k - 1})", [list(range(4, 4 * k, 4))], guesses=1)
    if k == 1:
        first = {"id": "0", "strategy": "S(0)", "guesses": 1}
    target = cases(f"S({k}|{k - 1})", [list(range(4, 4 * k + 1, 4))], mapping="all")
    spec = two_searches(target, first)
    known = Candidate(f"{1:032x}", (0, "0", 0), spec.search[0].outage_sets[0], 0.5, 50.0)
    jobs = map_jobs(spec, spec.search[1], known)
    assert len(jobs) == n_mappings == len({job.mapping for job in jobs})
    assert [job.hop for job in jobs] == list(range(n_mappings))


def test_longer_outages_are_seeded_from_the_same_segments():
    target = cases("S(1|1)", [[20], [4], [8]], duration_days=1.5, mapping="continued")
    spec = two_searches(target)
    assert [[job.case for job in map_jobs(spec, spec.search[1], seed(case))] for case in range(3)] == [
        [1],
        [],
        [0],
    ]


def test_a_budget_in_guesses_limits_the_jobs_of_seeds():
    spec = two_searches(cases("S(2|1)", [[4, 48], [8, 16]], guesses=3))
    seeds = [seed(0, number) for number in range(4)]
    assert len(jobs_of_seeds(spec, spec.search[1], seeds)) == 3 and not spec.search[1].is_immediate


def test_the_queue_stays_short_for_any_budget():
    assert len(next_chains(chain_search(guesses=1_000_000), NOTHING)) == CHAINS_AHEAD


def test_a_spent_budget_plans_nothing_more():
    assert next_chains(chain_search(guesses=None, core_seconds=5.0), progress(cpu_seconds=5.0)) == []
    assert next_chains(chain_search(guesses=None, solutions=2), progress(n_solutions=2)) == []
    assert len(next_chains(chain_search(guesses=None, solutions=2), progress(n_solutions=1))) == CHAINS_AHEAD


def test_seeds_never_make_chains():
    assert next_chains(seeded_search(), NOTHING) == []


def test_a_seeded_search_waits_until_its_source_has_ended():
    search = seeded_search()
    assert search_state(search, progress(source_has_ended=False), []) == "waiting"
    assert search_state(search, progress(n_running=1, source_has_ended=False), []) == "active"
    assert search_state(search, NOTHING, []) == "done"


def test_the_end_of_a_seed_chain_goes_first():
    assert priority(seeded_search()) < priority(chain_search())


def test_the_chain_of_a_map_job_is_its_seed_as_a_number():
    spec = two_searches(cases("S(2|1)", [[4, 48]]))
    (job,) = map_jobs(spec, spec.search[1], seed(0, 0x00FF << 64))
    assert job.chain == 0x00FF << 64 and job.seed_id == f"{job.chain:032x}"


def test_seeds_by_chain_take_turns_over_the_cases():
    candidates = [
        Candidate(f"{i:032x}", (case, f"{chain:032x}", 0), (), 1.0, 5.0)
        for i, (case, chain) in enumerate([(0, 0), (0, 2), (1, 1), (1, 3)])
    ]

    def numbers(order):
        search = seeded_search(seeds={"from": "a", "order": order, "limit": 2})
        return [int(c.id, 16) for c in chosen(search, candidates)]

    assert numbers("address") == [0, 1] and numbers("chain") == [0, 2]


@given(
    st.permutations(
        [Candidate(f"{i:032x}", (0, f"{i:032x}", 0), (), float(i % 3), 5.0 - i) for i in range(6)]
    )
)
def test_the_choice_of_seeds_does_not_depend_on_who_came_first(candidates):
    def numbers(**fields):
        return [int(c.id, 16) for c in chosen(seeded_search(seeds={"from": "a"} | fields), candidates)]

    assert numbers(order="address") == [0, 1, 2, 3, 4, 5]
    assert numbers(order="delta_v", limit=4) == [0, 3, 1, 4]
    assert numbers(order="time_of_flight", limit=2) == [5, 4]
    assert numbers(limit=3) == [0, 1, 2]


def test_diverse_seeds_begin_with_the_best_and_go_on_with_the_farthest():
    places = {1: (0.5, [0.0, 0.0]), 2: (0.3, [0.1, 0.0]), 3: (0.4, [0.2, 0.0]), 4: (0.9, [0.0, 3.0])}
    candidates = [
        Candidate(f"{i:032x}", (0, f"{i:032x}", 0), (), delta_v, 50.0, np.array(place))
        for i, (delta_v, place) in places.items()
    ]
    search = seeded_search(seeds={"from": "a", "order": "diversity", "limit": 3})
    # 2 is the cheapest; 4 is far away; 1 and 3 are equally far from 2, and 3 is the cheaper one.
    assert [int(c.id, 16) for c in chosen(search, candidates)] == [2, 4, 3]


def test_only_losses_are_tried_again_and_not_for_ever():
    assert [after_failure("crash", n) for n in (1, 2, 3)] == ["queued", "queued", "dead"]
    assert after_failure("lost", 1) == "queued"
    assert after_failure("error", 0) == "dead"
    assert after_failure("cancelled", 2) == "queued"
