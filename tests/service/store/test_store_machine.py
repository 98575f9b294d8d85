"""Anything that may happen to a store, in any order, under a clock that a test moves."""

import json
import shutil
import sqlite3
import tempfile
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, initialize, invariant, multiple, rule

from service.db.dialect import TALLIES
from service.db.transitions import TRANSITIONS
from service.spec import spec_from
from service.store.errors import WrongStateError
from service.store.store import Store
from tests.service.campaigns import OUTAGE, spec_fields
from tests.service.clock import Clock
from tests.workers.fake import run_fake
from workers.messages import RESULTS, Ending, JobOutcome, StaleAttemptError, Ticket

WORKERS = st.sampled_from(["local:a", "node7:1", "node8:1"])
SEARCHES = st.sampled_from(["s0", "s1-0", "s2-1"])
VERBS = st.sampled_from(["pause", "resume", "cancel"])
SEEDS = st.sampled_from(["{}", '{"order": "delta_v", "limit": 2}'])
#: Endings that a worker reports when there is no result.
WITHOUT_RESULT = st.sampled_from([Ending.CRASH, Ending.CANCELLED, Ending.ERROR])


@cache
def made_spec(rng_seed, seeds):
    other = {"segment": 40, "duration_days": 1.0}
    third = {"id": "s2-1", "strategy": "S(2|1)", "outages": [OUTAGE, other], "seeds": {"from": "s1-0"}}
    made = spec_fields(guesses=6, campaign={"name": "machine", "rng_seed": rng_seed})
    made["search"][1]["seeds"] |= json.loads(seeds)
    made["search"].append(third)
    return spec_from(made)


class StoreMachine(RuleBasedStateMachine):
    """What workers, operators, the clock and bad luck do; the invariants hold after each step."""

    claims = Bundle("claims")

    def __init__(self):
        super().__init__()
        self.clock = Clock()
        self.folder = Path(tempfile.mkdtemp())
        self.store = Store(self.folder, clock=self.clock)
        self.reader = sqlite3.connect(self.folder / "coastarc.db")
        #: Tickets whose reports were accepted, with the answer; those known to be lost.
        self.answers = {}
        self.lost = set()
        self.states = {}

    def teardown(self):
        self.reader.close()
        self.store.close()
        shutil.rmtree(self.folder)

    # What happens.

    @initialize(rng_seed=st.integers(1, 2), seeds=SEEDS)
    def begin(self, rng_seed, seeds):
        self.submit(rng_seed, seeds)

    @rule(rng_seed=st.integers(1, 2), seeds=SEEDS)
    def submit(self, rng_seed, seeds):
        spec = made_spec(rng_seed, seeds)
        campaign, _ = self.store.submit(spec)
        assert self.store.submit(spec) == (campaign, False)

    @rule(target=claims, worker=WORKERS, n_jobs=st.integers(1, 4))
    def claim(self, worker, n_jobs):
        return multiple(*self.store.claim(worker, n_jobs))

    @rule(claim=claims)
    def complete(self, claim):
        self.report(claim, run_fake(claim.job))

    @rule(target=claims, n_jobs=st.integers(1, 3))
    def work(self, n_jobs):
        claims = self.store.claim("node7:1", n_jobs)
        for claim in claims:
            self.report(claim, run_fake(claim.job))
        return multiple(*claims)

    @rule(claim=claims, ending=WITHOUT_RESULT)
    def fail(self, claim, ending):
        self.report(claim, JobOutcome(ending=ending, error="it failed"))

    def report(self, claim, outcome):
        ticket = claim.ticket
        before = self.all_rows()
        if ticket in self.lost and outcome.ending in RESULTS and self.waits(ticket):
            # Nobody has begun with it since, so the result is taken all the same.
            self.lost.discard(ticket)
        if ticket in self.lost:
            with pytest.raises(StaleAttemptError):
                self.store.complete(ticket, outcome)
            assert self.all_rows() == before
            return
        answer = self.store.complete(ticket, outcome)
        if ticket in self.answers:
            assert answer == self.answers[ticket] and self.all_rows() == before
        self.answers[ticket] = answer

    def waits(self, ticket):
        query = "SELECT count(*) FROM job WHERE id = :id AND attempt = :attempt AND state = 'queued'"
        return self.rows(query, id=ticket.job_id, attempt=ticket.attempt) == [(1,)]

    @rule(claim=claims)
    def heartbeat(self, claim):
        ticket = claim.ticket
        answer = self.store.heartbeat("node7:1", [ticket])
        is_held = ticket not in self.lost and ticket not in self.answers
        assert len(answer.extended) == is_held and len(answer.not_held) == (not is_held)
        assert set(answer.to_cancel) <= set(answer.extended)

    @rule(seconds=st.sampled_from([0.5, 10.0, 31.0, 100.0]))
    def advance(self, seconds):
        self.clock.advance(seconds)

    @rule()
    def reap(self):
        query = "SELECT id, attempt FROM job WHERE state = 'running' AND lease_until < :now"
        expired = {Ticket(*row) for row in self.rows(query, now=self.clock.now)}
        assert self.store.reap() == len(expired)
        self.lost |= expired

    @rule()
    def workers_fall_silent(self):
        self.advance(31.0)
        self.reap()

    @rule()
    def coordinator_dies(self):
        self.store.close()
        self.store = Store(self.folder, clock=self.clock)
        query = "SELECT id, attempt FROM job WHERE state = 'running' AND worker LIKE 'local:%'"
        self.lost |= {Ticket(*row) for row in self.rows(query)}
        self.store.recover("local:")

    @rule(verb=VERBS, campaign=st.integers(1, 2))
    def steer_campaign(self, verb, campaign):
        # Seldom cancelled, since nothing happens in it any more.
        if self.is_there(campaign) and (verb != "cancel" or self.clock.now % 7 < 1):
            self.tried(lambda: self.store.control_campaign(campaign, verb))

    @rule(verb=VERBS, campaign=st.integers(1, 2), name=SEARCHES)
    def steer_search(self, verb, campaign, name):
        if self.is_there(campaign) and (verb != "cancel" or self.clock.now % 7 < 1):
            self.tried(lambda: self.store.control_search(campaign, name, verb))

    @rule(claim=claims)
    def cancel_job(self, claim):
        self.tried(lambda: self.store.cancel_job(claim.job_id))

    @rule(claim=claims)
    def requeue(self, claim):
        self.tried(lambda: self.store.requeue_job(claim.job_id))

    def tried(self, act):
        before = self.all_rows()
        try:
            act()
        except WrongStateError:
            assert self.all_rows() == before

    # What holds.

    @invariant()
    def jobs_are_conserved(self):
        states = Counter(dict(self.rows("SELECT search_id, count(*) FROM job GROUP BY search_id")))
        for search_id, n_planned, n_solves, seconds in self.rows(
            "SELECT id, n_planned, n_solves, cpu_seconds FROM search"
        ):
            assert states[search_id] == n_planned
            mine = "SELECT count(*), coalesce(sum(cpu_seconds), 0.0) FROM solve WHERE search_id = :id"
            assert self.rows(mine, id=search_id) == [(n_solves, pytest.approx(seconds))]

    @invariant()
    def tallies_are_those_of_the_rows(self):
        # An attempt that was lost and then completed after all leaves a count of zero.
        kept = {tuple(row[:3]): row[3] for row in self.rows("SELECT * FROM tally") if row[3]}
        assert kept == {tuple(row[:3]): row[3] for row in self.rows(TALLIES)}

    @invariant()
    def views_count_what_is_there(self):
        states = Counter(row[0] for row in self.rows("SELECT state FROM job"))
        assert self.store.gauges.read().jobs == states
        assert sum(item.n_jobs for item in self.store.campaigns()) == states.total()

    @invariant()
    def a_job_has_at_most_one_accepted_result_and_its_solves_are_those(self):
        accepted = Counter(t.job_id for t, answer in self.answers.items() if answer.state == "done")
        assert set(accepted.values()) <= {1}
        assert set(accepted) == {row[0] for row in self.rows("SELECT id FROM job WHERE state = 'done'")}
        query = "SELECT job_id, count(*), count(DISTINCT attempt) FROM solve GROUP BY job_id"
        solves = {job: (n, attempts) for job, n, attempts in self.rows(query)}
        hops = dict(self.rows("SELECT id, n_hops FROM job WHERE state = 'done'"))
        assert solves == {job: (n_hops, 1) for job, n_hops in hops.items()}

    @invariant()
    def the_lineage_has_no_circle(self):
        seeds = {}
        for solution, seed in self.rows("SELECT solution_id, seed_id FROM seed_link"):
            seeds.setdefault(solution, []).append(seed)

        def depth(solution, path=()):
            assert solution not in path
            return 1 + max((depth(s, (*path, solution)) for s in seeds.get(solution, ())), default=0)

        assert all(depth(solution) <= 3 for solution in seeds)

    @invariant()
    def each_seed_mapping_and_case_is_there_once(self):
        query = "SELECT search_id, seed_id, mapping, case_index FROM job WHERE kind = 'map'"
        uses = self.rows(query)
        assert len(uses) == len(set(uses))

    @invariant()
    def running_jobs_are_held_by_their_last_attempt(self):
        query = "SELECT job_id, attempt FROM attempt WHERE ended_at IS NULL ORDER BY job_id"
        running = self.rows("SELECT id, attempt FROM job WHERE state = 'running' ORDER BY id")
        assert self.rows(query) == running
        assert not {Ticket(*row) for row in running} & (self.lost | set(self.answers))

    @invariant()
    def what_has_ended_has_nothing_left_to_do(self):
        query = "SELECT search.state, job.state FROM job JOIN search ON search.id = job.search_id"
        left = {pair for pair in self.rows(query) if pair[0] in ("done", "cancelled")}
        assert not {("done", "queued"), ("done", "running"), ("cancelled", "queued")} & left
        query = "SELECT campaign.state, search.state FROM search JOIN campaign ON campaign.id = campaign_id"
        assert not {s for c, s in self.rows(query) if c in ("done", "cancelled")} - {"done", "cancelled"}

    @invariant()
    def states_change_as_the_table_says(self):
        # One step may make several changes; the triggers look at each of them.
        for noun in ("campaign", "search", "job"):
            for row_id, state in self.rows(f"SELECT id, state FROM {noun}"):
                old = self.states.get((noun, row_id), state)
                assert old == state or reachable(noun, old, state)
                self.states[noun, row_id] = state

    def is_there(self, campaign):
        return ("campaign", campaign) in self.states

    def rows(self, query, **values):
        return self.reader.execute(query, values).fetchall()

    def all_rows(self):
        tables = ("campaign", "search", "job", "attempt", "solve", "solution", "seed_link", "event")
        return {table: self.rows(f"SELECT * FROM {table}") for table in tables}


def reachable(noun, old, new):
    """Return whether some changes lead from one state to another."""
    seen, found = {old}, {old}
    while found:
        found = {s for state in found for s in TRANSITIONS[noun][state]} - seen
        seen |= found
    return new in seen


STATES = {
    "campaign": ("active", "paused", "done", "cancelled"),
    "search": ("waiting", "active", "paused", "done", "cancelled"),
    "job": ("queued", "running", "done", "dead", "cancelled"),
}

TestStoreMachine = StoreMachine.TestCase
TestStoreMachine.settings = settings(
    max_examples=15,
    stateful_step_count=40,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
)
