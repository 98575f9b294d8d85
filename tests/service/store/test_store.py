import os
import signal
import sqlite3

import pytest

from core.problem import problem_from
from service import scheduler
from service.schemas.solution import Filter
from service.spec import spec_from
from service.store.store import Store
from service.validation import solution_hash
from tests.service.campaigns import OUTAGE, content, finish, spec_fields, submitted
from tests.service.clock import Clock
from tests.workers.fake import PROVENANCE, run_fake
from workers.executor import ProcessPool
from workers.messages import Ending, JobOutcome, MapJob, StaleAttemptError, Ticket


def rows(store, query):
    with sqlite3.connect(store.folder / "coastarc.db") as connection:
        found = connection.execute(query).fetchall()
    connection.close()
    return found


def folder_in(place, name):
    folder = place / str(name)
    folder.mkdir()
    return folder


def searches(store, campaign_id=1):
    return {search.name: search for search in store.campaign(campaign_id).searches}


def test_a_campaign_ends_by_itself_and_feeds_its_own_seeds(store):
    submitted(store)
    finish(store)
    s0, s1 = searches(store)["s0"], searches(store)["s1-0"]
    assert store.campaign(1).state == "done" and s0.state == s1.state == "done"
    assert s0.n_solves == 8 and s0.jobs.done == 4
    assert s0.n_strict > 0 and s1.n_solves == s1.n_guesses_planned == s0.n_strict
    assert s1.n_solutions == s1.n_solves


def test_the_first_seed_is_mapped_while_its_search_still_runs(store):
    submitted(store, spec_fields(guesses=40))
    finish(store, n_steps=6)
    s0, s1 = searches(store)["s0"], searches(store)["s1-0"]
    assert s0.state == "active" and s1.n_solves > 0


def test_every_strict_solution_is_mapped_exactly_once(store):
    submitted(store)
    finish(store)
    seeds = rows(store, "SELECT seed_id, count(*) FROM job WHERE kind = 'map' GROUP BY seed_id")
    strict = rows(store, "SELECT solution_id FROM solve WHERE search_id = 1 AND strict")
    assert sorted(seed for seed, _ in seeds) == sorted(key for (key,) in strict)
    assert {n for _, n in seeds} == {1}


def test_infeasible_solves_are_stored_with_their_defects_and_times(store):
    submitted(store)
    finish(store)
    found = rows(store, "SELECT length(defects), cpu_seconds, status FROM solve WHERE ending = 'infeasible'")
    assert found and all(entry == (56, 1.5, "STALLED") for entry in found)
    assert searches(store)["s0"].endings["infeasible"] == len(found)


def test_two_workers_one_worker_and_none_find_the_same(store, tmp_path):
    submitted(store)
    finish(store)
    for n_workers in (1, 2):
        other = Store(folder_in(tmp_path, n_workers))
        submitted(other)
        pool = ProcessPool(n_workers, "tests.workers.fake:run_fake")
        finish(other, pool)
        pool.close()
        assert content(other) == content(store) != []
        other.close()


def test_the_same_specification_again_is_the_same_campaign(store):
    assert store.submit(spec_from(spec_fields())) == (1, True)
    assert store.submit(spec_from(spec_fields())) == (1, False)
    assert store.submit(spec_from(spec_fields(guesses=9))) == (2, True)


def test_a_job_is_handed_out_once(store):
    submitted(store)
    first, second = store.claim("a", 3), store.claim("b", 3)
    assert len(first) == 3 and len(second) == 1
    assert len({claim.job_id for claim in [*first, *second]}) == 4


def test_a_late_report_of_an_older_attempt_changes_nothing(store):
    submitted(store)
    old = store.claim("a", 1)[0]
    store.recover()
    new = store.claim("b", 1)[0]
    assert (new.job_id, new.attempt) == (old.job_id, old.attempt + 1)
    with pytest.raises(StaleAttemptError, match="got a stale report"):
        store.complete(old.ticket, run_fake(old.job))
    assert rows(store, "SELECT count(*) FROM solve") == [(0,)]
    store.complete(new.ticket, run_fake(new.job))
    with pytest.raises(StaleAttemptError):
        store.complete(old.ticket, run_fake(old.job))


def test_a_job_that_crashes_three_times_is_dead(tmp_path):
    clock = Clock()
    store = Store(tmp_path, clock=clock)
    submitted(store, spec_fields(guesses=1))
    for attempt in (1, 2, 3):
        clock.advance(60.0)
        (claim,) = store.claim("a", 1)
        assert claim.attempt == attempt
        store.complete(Ticket(claim.job_id, attempt), JobOutcome(ending=Ending.CRASH, error="exit code -9"))
    (job,) = store.jobs(1, None, None, 10).items
    assert (job.state, job.ending, job.n_failures, job.error) == ("dead", "crash", 3, "exit code -9")
    assert store.campaign(1).state == "done"
    store.close()


def test_a_bug_of_ours_is_dead_at_once_and_keeps_its_traceback(store):
    submitted(store, spec_fields(guesses=1))
    (claim,) = store.claim("a", 1)
    error = "Traceback ...\nZeroDivisionError: division by zero"
    store.complete(
        Ticket(claim.job_id, 1), JobOutcome(ending=Ending.ERROR, error=error, provenance=PROVENANCE)
    )
    (job,) = store.jobs(None, "s0", "dead", 10).items
    assert job.error == "ZeroDivisionError: division by zero"
    assert rows(store, "SELECT error FROM attempt") == [(error,)]


def test_a_job_that_was_interrupted_keeps_its_solves_and_runs_again(store):
    submitted(store, spec_fields(guesses=2))
    (claim,) = store.claim("a", 1)
    whole = run_fake(claim.job)
    part = whole.model_copy(update={"ending": Ending.CANCELLED, "solves": whole.solves[:1]})
    store.complete(Ticket(claim.job_id, 1), part)
    assert searches(store)["s0"].n_solves == 1 and searches(store)["s0"].jobs.queued == 1
    finish(store)
    assert searches(store)["s0"].n_solves == 2


def test_what_a_dead_process_left_running_is_finished_with_the_same_result(store, tmp_path):
    undisturbed = Store(folder_in(tmp_path, "other"))
    submitted(undisturbed)
    finish(undisturbed)
    submitted(store)
    store.claim("a process that dies", 2)
    assert store.recover() == 2
    finish(store)
    assert content(store) == content(undisturbed)
    undisturbed.close()


def test_killing_workers_changes_nothing_in_what_is_found(store, tmp_path):
    undisturbed = Store(folder_in(tmp_path, "other"))
    submitted(undisturbed)
    finish(undisturbed)
    submitted(store)
    pool = ProcessPool(2, "tests.workers.fake:run_slowly")

    def kill_one_that_works(n):
        busy = [pid for pid, ticket in pool.processes().items() if ticket is not None]
        if busy and n in (1, 4):  # two, since three would make one job dead
            os.kill(busy[0], signal.SIGKILL)

    finish(store, pool, before_step=kill_one_that_works)
    pool.close()
    assert ("crash",) in rows(store, "SELECT DISTINCT ending FROM attempt")
    assert content(store) == content(undisturbed)
    undisturbed.close()


def test_ordered_seeds_wait_for_their_search_and_the_best_go_first(store):
    fields = spec_fields()
    fields["search"][1]["seeds"] = {"from": "s0", "order": "delta_v", "limit": 2}
    submitted(store, fields)
    finish(store, n_steps=3)
    assert searches(store)["s1-0"].state == "waiting"
    finish(store)
    strict = "SELECT solution_id FROM solve WHERE search_id = 1 AND strict"
    best = rows(store, f"SELECT id FROM solution WHERE id IN ({strict}) ORDER BY delta_v_km_s LIMIT 2")
    assert rows(store, "SELECT seed_id FROM job WHERE kind = 'map' ORDER BY id") == best


def test_a_budget_in_core_seconds_ends_a_search(store):
    fields = spec_fields(search=[{"id": "s0", "strategy": "S(0)", "core_seconds": 10.0}])
    submitted(store, fields)
    finish(store)
    s0 = searches(store)["s0"]
    assert s0.state == "done" and s0.n_solves == 7 and s0.jobs.cancelled > 0  # 7 x 1.5 s


def test_a_budget_in_solutions_ends_a_search(store):
    submitted(store, spec_fields(search=[{"id": "s0", "strategy": "S(0)", "solutions": 3}]))
    finish(store)
    assert searches(store)["s0"].n_strict == 3


def test_a_chain_of_three_searches_runs_to_its_end(store):
    fields = spec_fields(guesses=20)
    other = {"segment": 40, "duration_days": 1.0}
    fields["search"].append(
        {"id": "s2-1", "strategy": "S(2|1)", "outages": [OUTAGE, other], "seeds": {"from": "s1-0"}}
    )
    submitted(store, fields)
    finish(store)
    view = searches(store)
    assert view["s2-1"].state == "done" and view["s2-1"].n_solves == view["s1-0"].n_strict > 0
    best = store.lineage(view["s2-1"].best_solution_id)
    assert [node.k for node in best.nodes] == [2, 1, 0] and len(best.edges) == 2


def test_a_map_job_carries_its_seed_bit_by_bit(store):
    submitted(store, spec_fields(guesses=8))
    jobs = []
    while claims := store.claim("a", 1):
        jobs.append(claims[0].job)
        store.complete(claims[0].ticket, run_fake(claims[0].job))
    mapped = [job for job in jobs if isinstance(job, MapJob)]
    assert mapped
    for job in mapped:
        assert solution_hash(problem_from(job.seed_problem).hash, job.seed_x) == job.seed_id
        assert job.address.chain == int(job.seed_id, 16) and job.address.search == 1


def test_states_that_do_not_exist_are_refused_by_the_database(store):
    submitted(store)
    with sqlite3.connect(store.folder / "coastarc.db") as connection:
        for table in ("campaign", "search", "job"):
            connection.execute(f"DROP TRIGGER {table}_transition")
            with pytest.raises(sqlite3.IntegrityError, match="known_state"):
                connection.execute(f"UPDATE {table} SET state = 'asleep'")
    connection.close()


def test_one_solution_in_two_campaigns_is_stored_once_and_listed_in_both(store):
    submitted(store)
    submitted(store, spec_fields(campaign={"name": "again", "rng_seed": 7}))
    finish(store)
    assert len(content(store)) == store.campaign(1).n_solutions == store.campaign(2).n_solutions


def test_nothing_is_requeued_where_nothing_died(store):
    campaign_id = submitted(store)
    finish(store)
    assert store.requeue_dead_jobs(campaign_id) == 0 and store.campaign(campaign_id).state == "done"


def test_ordered_seeds_are_chosen_once(store, monkeypatch):
    fields, calls, chosen = spec_fields(guesses=16), [], scheduler.chosen
    fields["search"][1]["seeds"] = {"from": "s0", "order": "delta_v"}
    monkeypatch.setattr(scheduler, "chosen", lambda *of: calls.append(of) or chosen(*of))
    submitted(store, fields)
    finish(store)
    assert store.campaign(1).searches[1].n_solves > 2 and len(calls) == 1


def test_a_campaign_of_several_cases_and_mappings_runs_to_its_end(store):
    cases = {"cases": [[8, 24], [24, 40]], "duration_days": 1.0, "mapping": ["reference", "nearest"]}
    fields = spec_fields(guesses=20)
    fields["search"].append({"id": "s2-1", "strategy": "S(2|1)", "seeds": {"from": "s1-0"}} | cases)
    submitted(store, fields)
    finish(store)
    view = searches(store)
    assert view["s2-1"].n_solves == 4 * view["s1-0"].n_strict > 0
    assert [[o.segment for o in case.outages] for case in view["s2-1"].cases] == [[8, 24], [24, 40]]
    solves = [s for s in store.campaign_facts(1).solves if s.search == "s2-1"]
    assert len(solves) == view["s2-1"].n_solves
    assert len({(s.seed_id, s.mapping, s.outages) for s in solves}) == len(solves)
    records = store.all_records(Filter(search="s2-1"))
    assert {r.mapping for r in records} == {"reference", "reference(1,1)"}
    assert {r.problem_hash for r in records} == {case.problem_hash for case in view["s2-1"].cases}


def test_facts_of_a_campaign_are_those_of_its_records(store):
    submitted(store)
    finish(store)
    facts = store.campaign_facts(store.find_campaign("test"))
    assert len(facts.solves) == sum(search.n_solves for search in searches(store).values())
    found = {s.solution_id: s for s in facts.solves if s.strict}
    records = [r for r in store.all_records(Filter()) if r.strict]
    assert {r.id for r in records} == set(found) and {r.id for r in records} <= set(facts.vectors)
    for r in records:
        fact = found[r.id]
        assert (r.search, r.strategy, r.k, r.seed_id, r.mapping) == (
            fact.search,
            fact.strategy,
            fact.k,
            fact.seed_id,
            fact.mapping,
        )
        assert fact.outages == tuple((o.segment, o.duration_days) for o in r.outages)
        assert (r.propellant_kg, r.delta_v_km_s, r.cpu_seconds) == (
            fact.propellant_kg,
            fact.delta_v_km_s,
            fact.cpu_seconds,
        )
    assert {s.cap_seconds for s in facts.solves if s.k == 1} == {240.0}  # 120 s times 1 + k


def test_a_limit_gives_the_best_solutions(store):
    submitted(store)
    finish(store)
    assert store.all_records(Filter(), limit=2) == store.all_records(Filter())[:2]
