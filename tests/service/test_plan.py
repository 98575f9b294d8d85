from hypothesis import given
from hypothesis import strategies as st

from service.scheduler.plan import (
    CHAINS_AHEAD,
    Candidate,
    Progress,
    after_failure,
    chosen,
    map_job,
    next_chains,
    priority,
    search_state,
)
from service.spec import SearchSpec, Seeds

NOTHING = Progress(n_chains=0, n_queued=0, n_running=0, cpu_seconds=0.0, n_solutions=0)


def chain_search(**more):
    return SearchSpec.model_validate({"id": "a", "strategy": "S(0)", "guesses": 10} | more)


def seeded_search(**more):
    outages = [{"segment": 4, "duration_days": 1.0}]
    fields = {"id": "b", "strategy": "S(1|0)", "outages": outages, "seeds": {"from": "a"}}
    return SearchSpec.model_validate(fields | more)


def progress(**changes):
    return Progress(**({name: getattr(NOTHING, name) for name in Progress.__slots__} | changes))


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
    assert map_job("00ff" * 8).chain == int("00ff" * 8, 16)


@given(
    st.permutations([Candidate(f"{i:032x}", (0, f"{i:032x}", 0), float(i % 3), 5.0 - i) for i in range(6)])
)
def test_the_choice_of_seeds_does_not_depend_on_who_came_first(candidates):
    def numbers(**fields):
        return [int(c.id, 16) for c in chosen(Seeds.model_validate({"from": "a"} | fields), candidates)]

    assert numbers(order="address") == [0, 1, 2, 3, 4, 5]
    assert numbers(order="delta_v", limit=4) == [0, 3, 1, 4]
    assert numbers(order="time_of_flight", limit=2) == [5, 4]
    assert numbers(limit=3) == [0, 1, 2]


def test_only_losses_are_tried_again_and_not_for_ever():
    assert [after_failure("crash", n) for n in (1, 2, 3)] == ["queued", "queued", "dead"]
    assert after_failure("lost", 1) == "queued"
    assert after_failure("error", 0) == "dead"
    assert after_failure("cancelled", 2) == "queued"
