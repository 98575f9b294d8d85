"""States and their changes, leases, control, sharing; what the store does over a lifetime."""

import sqlite3
from typing import get_args

import pytest

from service.db.tables import CAMPAIGN_STATES, JOB_STATES, SEARCH_STATES
from service.db.transitions import TRANSITIONS, transition_triggers
from service.scheduler import Share, in_turn
from service.spec import spec_from
from service.store.errors import (
    KeyReusedError,
    StoreError,
    UnknownRowError,
    WorkerRefusedError,
    WrongStateError,
)
from service.store.store import Store
from tests.service.campaigns import content, spec_fields, submitted
from tests.service.clock import Clock
from tests.workers.fake import run_fake
from workers.messages import (
    CompleteAnswer,
    CompleteRequest,
    Ending,
    HeldJob,
    JobOutcome,
    StaleAttemptError,
    Ticket,
    WorkerInfo,
    job_digest,
)
from workers.provenance import code_version

CRASH = JobOutcome(ending=Ending.CRASH)
CANCELLED = JobOutcome(ending=Ending.CANCELLED)


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def store(tmp_path, clock):
    with Store(tmp_path, clock=clock) as opened:
        yield opened


def claim_one(store, worker="a"):
    (claim,) = store.claim(worker, 1)
    return claim


def work(store, n_jobs=1000):
    """Do so many jobs, or all that there are."""
    for _ in range(n_jobs):
        claims = store.claim("a", 1)
        for claim in claims:
            store.complete(claim.ticket, run_fake(claim.job))
        if not claims:
            return


def job(store, claim):
    return store.job(claim.job_id)


def search(store, name="s0"):
    return next(search for search in store.campaign(1).searches if search.name == name)


def held(*claims):
    return tuple(HeldJob(**claim.ticket._asdict()) for claim in claims)


def rows(store, query):
    with sqlite3.connect(store.folder / "coastarc.db") as connection:
        found = connection.execute(query).fetchall()
    connection.close()
    return found


# States.


def test_every_state_of_the_api_has_its_changes_and_no_other_is_named():
    states = {"campaign": CAMPAIGN_STATES, "search": SEARCH_STATES, "job": JOB_STATES}
    assert {noun: set(known) for noun, known in states.items()} == {n: set(t) for n, t in TRANSITIONS.items()}
    assert {new for changes in TRANSITIONS.values() for after in changes.values() for new in after} <= set(
        CAMPAIGN_STATES + SEARCH_STATES + JOB_STATES
    )
    # Where a worker is told what became of a job that it had.
    assert set(get_args(CompleteAnswer.model_fields["state"].annotation)) == set(
        TRANSITIONS["job"]["running"]
    )


@pytest.mark.parametrize("noun", TRANSITIONS)
def test_the_database_makes_the_changes_of_the_table_and_no_other(store, noun):
    submitted(store, spec_fields(guesses=1))
    with sqlite3.connect(store.folder / "coastarc.db") as connection:
        for old in TRANSITIONS[noun]:
            for new in TRANSITIONS[noun]:
                connection.execute(f"DROP TRIGGER {noun}_transition")
                connection.execute(change_of_state(noun, old))
                for statement in transition_triggers(noun, "sqlite"):
                    connection.execute(statement)
                if new in (old, *TRANSITIONS[noun][old]):
                    connection.execute(change_of_state(noun, new))
                else:
                    with pytest.raises(sqlite3.IntegrityError, match=f"{noun}: expected a known change"):
                        connection.execute(change_of_state(noun, new))
    connection.close()


def change_of_state(noun, state):
    # A job has a lease while it runs.
    lease = f", lease_until = {'1.0' if state == 'running' else 'NULL'}" if noun == "job" else ""
    return f"UPDATE {noun} SET state = '{state}'{lease} WHERE id = 1"


def test_a_job_has_a_lease_while_it_runs_and_at_no_other_time(store):
    submitted(store)
    claim_one(store)
    with sqlite3.connect(store.folder / "coastarc.db") as connection:
        for lease, state in (("NULL", "running"), ("1", "queued")):
            with pytest.raises(sqlite3.IntegrityError, match="running_has_lease"):
                connection.execute(f"UPDATE job SET lease_until = {lease} WHERE state = '{state}'")
    connection.close()


# Leases.


def test_a_lease_that_is_renewed_does_not_run_out(store, clock):
    submitted(store)
    claim = claim_one(store)
    for _ in range(10):
        clock.advance(29.0)
        assert store.heartbeat("a", [claim.ticket]).extended == held(claim)
        assert store.reap() == 0
    assert job(store, claim).state == "running"


def test_a_lease_that_ran_out_puts_the_job_back_after_a_wait_and_counts_a_failure(store, clock):
    submitted(store, spec_fields(guesses=1))
    claim = claim_one(store)
    clock.advance(30.1)
    assert store.reap() == 1 and store.reap() == 0
    view = job(store, claim)
    assert (view.state, view.n_failures, view.ending, view.lease_until) == ("queued", 1, "lost", None)
    assert rows(store, "SELECT ending, next_state FROM attempt") == [("lost", None)]
    assert store.claim("b", 1) == []
    clock.advance(1.0)
    assert claim_one(store, "b").attempt == 2


def test_a_job_that_is_lost_three_times_is_dead_and_ends_its_search(store, clock):
    submitted(store, spec_fields(guesses=1))
    for _ in range(3):
        claim = claim_one(store)
        clock.advance(90.0)
        assert store.reap() == 1
        clock.advance(60.0)
    assert job(store, claim).state == "dead" and store.campaign(1).state == "done"


def test_a_result_after_the_lease_but_before_the_reaper_is_accepted(store, clock):
    submitted(store)
    claim = claim_one(store)
    clock.advance(1000.0)
    assert store.complete(claim.ticket, run_fake(claim.job)).state == "done"
    assert store.reap() == 0


def test_the_same_report_again_gets_the_same_answer_and_changes_nothing(store, clock):
    submitted(store)
    first, second = claim_one(store), claim_one(store)
    answers = [store.complete(first.ticket, run_fake(first.job)), store.complete(second.ticket, CRASH)]
    before = store.campaign(1), store.last_event_id(1)
    assert store.complete(first.ticket, run_fake(first.job)) == answers[0]
    # Whatever it says the second time, and whatever has become of the job since.
    clock.advance(5.0)
    assert store.complete(second.ticket, run_fake(second.job)) == answers[1]
    after = store.campaign(1), store.last_event_id(1)
    assert before[0].searches == after[0].searches and before[1] == after[1]


def test_reports_of_attempts_and_jobs_that_never_were_are_refused(store):
    submitted(store)
    claim = claim_one(store)
    with pytest.raises(StaleAttemptError, match="expected attempt 2 to hold it"):
        store.complete(Ticket(claim.job_id, 2), run_fake(claim.job))
    with pytest.raises(UnknownRowError, match="job 999"):
        store.complete(Ticket(999, 1), CRASH)


def test_a_heartbeat_tells_who_lost_what(store, clock):
    submitted(store)
    kept, lost = store.claim("a", 2)
    clock.advance(20.0)
    store.heartbeat("a", [kept.ticket])
    clock.advance(20.0)
    store.reap()
    answer = store.heartbeat("a", [kept.ticket, lost.ticket])
    assert (answer.extended, answer.not_held, answer.to_cancel) == (held(kept), held(lost), ())
    assert store.heartbeat("a", []).extended == ()
    seen = store.look([kept.ticket, lost.ticket])
    assert (seen.extended, seen.not_held, seen.to_cancel) == ((), held(lost), ())


def test_a_look_extends_no_lease_and_tells_what_to_cancel(store, clock):
    submitted(store)
    claim = claim_one(store)
    store.cancel_job(claim.job_id)
    clock.advance(20.0)
    assert store.look([claim.ticket]).to_cancel == held(claim)
    clock.advance(20.0)
    store.reap()
    assert store.look([claim.ticket]).not_held == held(claim)


def test_only_jobs_of_workers_that_are_gone_for_sure_are_recovered(store):
    submitted(store)
    mine, theirs = claim_one(store, "local:me:1"), claim_one(store, "node7:2")
    assert store.recover("local:") == 1
    assert (job(store, mine).state, job(store, theirs).state) == ("queued", "running")
    assert job(store, mine).n_failures == 0


def test_an_outcome_that_does_not_fit_its_problem_is_refused_whole(store):
    submitted(store, spec_fields(guesses=40))
    claims = store.claim("a", 20)
    claim = next(claim for claim in claims if any(solve.x for solve in run_fake(claim.job).solves))
    outcome = run_fake(claim.job)
    broken = tuple(s.model_copy(update={"x": (1.0, 2.0)}) if s.x else s for s in outcome.solves)
    with pytest.raises(StoreError, match="expected shape"):
        store.complete(claim.ticket, outcome.model_copy(update={"solves": broken}))
    assert rows(store, "SELECT count(*) FROM solve") == [(0,)] and job(store, claim).state == "running"


# Control.


def test_a_pause_drains_and_survives_a_restart(store, clock, tmp_path):
    submitted(store)
    claim = claim_one(store)
    store.control_campaign(1, "pause")
    assert store.claim("a", 5) == []
    assert store.complete(claim.ticket, run_fake(claim.job)).state == "done"
    store.close()
    with Store(tmp_path, clock=clock) as again:
        assert again.claim("a", 5) == [] and again.campaign(1).state == "paused"
        again.control_campaign(1, "resume")
        work(again)
        assert again.campaign(1).state == "done"


def test_a_pause_changes_nothing_in_what_is_found(store, tmp_path):
    (tmp_path / "other").mkdir()
    with Store(tmp_path / "other") as undisturbed:
        submitted(undisturbed)
        work(undisturbed)
        expected = content(undisturbed)
    submitted(store)
    work(store, 2)
    store.control_search(1, "s1-0", "pause")
    work(store, 6)
    assert search(store, "s1-0").state == "paused" and search(store, "s0").state == "done"
    store.control_search(1, "s1-0", "resume")
    work(store)
    assert content(store) == expected != []


def test_a_paused_search_chooses_its_seeds_when_it_is_resumed(store):
    fields = spec_fields(guesses=20)
    fields["search"][1]["seeds"] = {"from": "s0", "order": "delta_v", "limit": 2}
    submitted(store, fields)
    store.control_search(1, "s1-0", "pause")
    work(store, 12)
    assert search(store, "s1-0").n_solves == 0 and search(store, "s0").state == "done"
    store.control_search(1, "s1-0", "resume")
    work(store)
    assert search(store, "s1-0").n_solves == 2 and store.campaign(1).state == "done"


def test_a_cancelled_campaign_stops_what_runs_and_hands_out_nothing(store):
    submitted(store)
    claim = claim_one(store)
    store.control_campaign(1, "cancel")
    assert store.heartbeat("a", [claim.ticket]).to_cancel == held(claim)
    assert store.claim("a", 9) == [] and search(store).jobs.queued == 0
    assert store.complete(claim.ticket, CANCELLED).state == "cancelled"
    view = store.campaign(1)
    assert view.state == "cancelled" and {one.state for one in view.searches} == {"cancelled"}


def test_a_result_that_arrives_during_a_cancel_is_kept(store):
    submitted(store)
    claim = claim_one(store)
    store.control_campaign(1, "cancel")
    assert store.complete(claim.ticket, run_fake(claim.job)).state == "done"
    assert search(store).n_solves == 2 and search(store, "s1-0").jobs.queued == 0


@pytest.mark.parametrize("is_reaped", [True, False])
def test_a_job_whose_worker_is_lost_during_a_cancel_is_cancelled(store, clock, is_reaped):
    submitted(store)
    claim = claim_one(store)
    store.cancel_job(claim.job_id)
    if is_reaped:
        clock.advance(31.0)
        store.reap()
    else:
        store.complete(claim.ticket, CRASH)
    view = job(store, claim)
    assert (view.state, view.n_failures, view.is_cancelling) == ("cancelled", 0, False)


def test_searches_go_on_with_the_seeds_of_one_that_was_cancelled(store):
    submitted(store, spec_fields(guesses=20))
    work(store, 4)
    n_strict = search(store).n_strict
    store.control_search(1, "s0", "cancel")
    work(store)
    assert store.campaign(1).state == "done" and search(store).state == "cancelled"
    assert search(store, "s1-0").n_solves == n_strict > 0


def test_a_dead_job_that_is_requeued_grows_its_attempt_and_forgets_its_failures(store, clock):
    submitted(store, spec_fields(guesses=1))
    for _ in range(3):
        claim = claim_one(store)
        store.complete(claim.ticket, CRASH)
        clock.advance(60.0)
    assert store.campaign(1).state == "done"
    store.requeue_job(claim.job_id)
    assert (store.campaign(1).state, store.campaign(1).finished_at) == ("active", None)
    again = claim_one(store)
    assert (again.attempt, job(store, again).n_failures) == (4, 0)
    store.complete(again.ticket, run_fake(again.job))
    work(store)
    assert store.campaign(1).state == "done"


def test_a_cancelled_job_can_be_requeued_and_one_of_a_cancelled_search_cannot(store):
    submitted(store)
    store.cancel_job(1)
    assert store.job(1).state == "cancelled"
    store.requeue_job(1)
    assert store.job(1).state == "queued"
    store.control_search(1, "s0", "cancel")
    with pytest.raises(WrongStateError, match="search s0: expected a search that goes on"):
        store.requeue_job(1)


def test_a_job_is_not_requeued_beyond_the_budget_of_its_search(store):
    submitted(store, spec_fields(search=[{"id": "s0", "strategy": "S(0)", "solutions": 1}]))
    work(store)
    unused = next(job for job in store.jobs(1, None, "cancelled", 1).items)
    with pytest.raises(WrongStateError, match="expected a budget that is not used up"):
        store.requeue_job(unused.id)
    assert store.job(unused.id).state == "cancelled"


def test_asking_for_what_is_so_changes_nothing(store):
    submitted(store)
    for verb in ("pause", "cancel"):
        store.control_campaign(1, verb)
        n_events = store.last_event_id(1)
        store.control_campaign(1, verb)
        store.control_search(1, "s0", "cancel") if verb == "cancel" else None
        assert store.last_event_id(1) == n_events


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda s: s.control_campaign(1, "pause"), "campaign 1: expected state active to pause, got done"),
        (lambda s: s.control_campaign(1, "resume"), "campaign 1: expected state paused to resume, got done"),
        (
            lambda s: s.control_search(1, "s0", "resume"),
            "search s0: expected state paused to resume",
        ),
        (lambda s: s.cancel_job(1), "job 1: expected state queued or running to cancel, got done"),
        (lambda s: s.requeue_job(1), "job 1: expected state dead or cancelled to requeue, got done"),
    ],
)
def test_what_cannot_be_from_a_state_is_refused(store, act, message):
    submitted(store)
    work(store)
    with pytest.raises(WrongStateError, match=message):
        act(store)


def test_control_of_what_does_not_exist_is_refused(store):
    submitted(store)
    for act in (
        lambda: store.control_campaign(9, "pause"),
        lambda: store.control_search(1, "s9", "pause"),
        lambda: store.set_search(1, "s9", weight=2.0),
        lambda: store.cancel_job(999),
    ):
        with pytest.raises(UnknownRowError):
            act()


# Sharing.


def two_searches(store):
    other = {"id": "t0", "strategy": "S(0)", "guesses": 200}
    return submitted(store, spec_fields(search=[{"id": "s0", "strategy": "S(0)", "guesses": 200}, other]))


def served(store, n_jobs):
    """Return how many jobs of each search were handed out and finished in turn."""
    counts = {"s0": 0, "t0": 0}
    for _ in range(n_jobs):
        claim = claim_one(store)
        counts["s0" if claim.job.address.search == 0 else "t0"] += 1
        store.complete(claim.ticket, run_fake(claim.job))
    return counts


def test_searches_of_equal_priority_share_by_weight(store):
    two_searches(store)
    assert served(store, 8) == {"s0": 4, "t0": 4}
    store.set_search(1, "t0", weight=3.0)
    assert served(store, 16) == {"s0": 4, "t0": 12}


def test_a_search_that_comes_back_does_not_make_up_for_its_absence(store):
    two_searches(store)
    store.control_search(1, "t0", "pause")
    assert served(store, 8) == {"s0": 8, "t0": 0}
    store.control_search(1, "t0", "resume")
    assert served(store, 8) == {"s0": 4, "t0": 4}


def test_the_search_and_the_campaign_with_the_lower_priority_go_first(store):
    two_searches(store)
    store.set_search(1, "t0", priority=-5)
    assert served(store, 4) == {"s0": 0, "t0": 4}
    submitted(store, spec_fields(campaign={"name": "urgent", "rng_seed": 8}))
    store.set_campaign(2, priority=-1)
    assert {store.job(claim.job_id).campaign_id for claim in store.claim("a", 4)} == {2}


def test_a_specification_says_how_its_searches_share(store):
    fields = spec_fields(guesses=40, campaign={"name": "test", "rng_seed": 7, "priority": -2})
    fields["search"] = [fields["search"][0] | {"id": name} for name in ("s0", "t0")]
    fields["search"][1] |= {"weight": 3.0, "priority": 0}
    submitted(store, fields)
    assert store.campaign(1).priority == -2
    assert served(store, 16) == {"s0": 4, "t0": 12}


def test_several_jobs_at_once_are_shared_as_one_by_one(store):
    two_searches(store)
    store.set_search(1, "t0", weight=3.0)
    positions = [claim.job.address.search for claim in store.claim("a", 16)]
    assert (positions.count(0), positions.count(1)) == (4, 12)


def test_a_search_without_jobs_leaves_its_turn_to_others():
    left = {1: 1, 2: 5}

    def take(search_id):
        left[search_id] -= 1
        return (search_id, 1) if left[search_id] >= 0 else None

    shares = [Share(1, (0, 0), 1.0, 0.0, 0, 1.0), Share(2, (0, 0), 1.0, 0.0, 0, 1.0)]
    assert in_turn(shares, take, 9) == [1, 2, 2, 2, 2, 2]


# Workers, submissions.

WORKER = WorkerInfo(
    name="node7:1",
    host="node7",
    executor="process",
    slots=4,
    code_version=code_version(),
    python_version="3.11.99",
)


def test_a_worker_is_listed_with_what_it_holds_until_it_falls_silent(store, clock):
    submitted(store)
    store.register(WORKER)
    claim = claim_one(store, WORKER.name)
    (view,) = store.workers().items
    assert (view.name, view.slots, view.is_alive) == ("node7:1", 4, True)
    assert [(job.job_id, job.attempt) for job in view.held] == [claim.ticket]
    clock.advance(60.0)
    assert store.workers().items[0].is_alive is False
    store.heartbeat(WORKER.name, [])
    assert store.workers().items[0].is_alive is True


@pytest.mark.parametrize("change", [{"code_version": "0.0.1+0"}, {"python_version": "3.10.1"}])
def test_a_worker_that_would_compute_something_else_is_refused_with_the_remedy(store, change):
    with pytest.raises(WorkerRefusedError, match="install the coordinator's version where it runs"):
        store.register(WORKER.model_copy(update=change))
    assert store.workers().items == []


def test_a_key_belongs_to_the_specification_that_came_with_it_first(store):
    spec = spec_from(spec_fields())
    assert store.submit(spec, "k1") == (1, True)
    assert store.submit(spec, "k1") == store.submit(spec, "k2") == (1, False)
    with pytest.raises(KeyReusedError, match="idempotency key k1: expected the specification of campaign 1"):
        store.submit(spec_from(spec_fields(guesses=9)), "k1")
    assert len(store.campaigns()) == 1


@pytest.mark.parametrize("loss", ["lease", "restart"])
def test_a_result_that_comes_when_its_job_waits_again_is_taken_and_saves_the_work(store, clock, loss):
    submitted(store)
    claim = claim_one(store, "local:a")
    if loss == "lease":
        clock.advance(31.0)
        assert store.reap() == 1
    else:
        assert store.recover("local:") == 1
    assert store.complete(claim.ticket, run_fake(claim.job)).state == "done"
    # The same again is no news, and nobody gets the job any more.
    assert store.complete(claim.ticket, run_fake(claim.job)).state == "done"
    assert rows(store, "SELECT ending, next_state FROM attempt") == [
        (run_fake(claim.job).ending.value, "done")
    ]
    assert claim.job_id not in {other.job_id for other in store.claim("b", 100)}
    assert rows(store, "SELECT count(*) FROM solve")[0][0] == len(run_fake(claim.job).solves)
    kept = rows(store, "SELECT name, number FROM tally WHERE noun = 'attempt' AND number <> 0")
    assert kept == [(run_fake(claim.job).ending.value, 1)]


def test_a_result_that_comes_after_somebody_else_has_begun_is_stale(store, clock):
    submitted(store)
    claim = claim_one(store)
    clock.advance(31.0)
    store.reap()
    clock.advance(5.0)
    again = next(one for one in store.claim("b", 100) if one.job_id == claim.job_id)
    with pytest.raises(StaleAttemptError):
        store.complete(claim.ticket, run_fake(claim.job))
    assert store.complete(again.ticket, run_fake(again.job)).state == "done"


@pytest.mark.parametrize("ending", [Ending.CRASH, Ending.CANCELLED, Ending.ERROR])
def test_what_is_no_result_does_not_take_a_job_out_of_the_queue(store, clock, ending):
    submitted(store)
    claim = claim_one(store)
    clock.advance(31.0)
    store.reap()
    with pytest.raises(StaleAttemptError):
        store.complete(claim.ticket, JobOutcome(ending=ending))
    assert store.job(claim.job_id).state == "queued"


def test_a_result_of_the_job_of_another_archive_is_refused(store):
    submitted(store)
    claim = claim_one(store)
    report = CompleteRequest(**claim.ticket._asdict(), outcome=run_fake(claim.job), job_digest="0" * 32)
    with pytest.raises(StoreError, match="expected the outcome of this job, got that of another archive"):
        store.complete_many([report])
    report = report.model_copy(update={"job_digest": job_digest(claim.job)})
    assert store.complete_many([report])[0].state == "done"


def test_an_outcome_whose_report_was_refused_can_be_handed_in_once_its_job_is_requeued(store):
    submitted(store)
    claim = claim_one(store)
    store.complete(claim.ticket, JobOutcome(ending=Ending.ERROR, error="report: expected one that is taken"))
    # A dead job stays dead, whoever says what.
    assert store.complete(claim.ticket, run_fake(claim.job)).state == "dead"
    store.requeue_job(claim.job_id)
    assert store.complete(claim.ticket, run_fake(claim.job)).state == "done"
