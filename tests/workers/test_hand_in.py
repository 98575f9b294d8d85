"""Chains that hand in their hops as they go: when, with what, and where the next attempt begins."""

import json
import time
from types import SimpleNamespace

import numpy as np
import pytest

from core.nlp import ExitStatus, Outcome
from core.search import Chain, ChainState, HopSettings, Incumbent
from core.transcription import Layout, TrajectoryLayout
from tests.workers.fake import opened, part_of, run_fake
from tests.workers.jobs import hop_job, worker_info
from tests.workers.test_dispatcher import ListSource
from workers import run
from workers.dispatcher import Dispatcher
from workers.executor import Inline, ProcessPool
from workers.messages import (
    ChainPlace,
    Ending,
    FaultyError,
    HandedIn,
    HandInAnswer,
    JobOutcome,
    Reached,
    StaleAttemptError,
    Ticket,
    UnreachableError,
    sealed,
)

N_HOPS = 12
#: Ten variables with two segments of control.
BOX = (
    np.array([0.0, 0.0, 0.0] + [0.0, -np.pi, -1.5] * 2 + [1.0]),
    np.array([90.0, 30.0, 30.0] + [1.0, np.pi, 1.5] * 2 + [13.0]),
)
SMALL = SimpleNamespace(
    bounds=BOX,
    sampling_box=BOX,
    layout=Layout((TrajectoryLayout(0, 2, None),)),
)


@pytest.fixture
def numerics(monkeypatch):
    """Let hops be real, and solves a rough landscape of their guesses; return the guesses."""
    guesses = []

    def solve(transcription, guess, settings, stop):
        guesses.append(guess.tobytes())
        level = float(np.sin(1e3 * guess).sum())
        violation = np.inf if level > 2.0 else 2.0 + level if level > -1.0 else 0.5
        return Outcome(ExitStatus.STALLED, guess + 1e-3, level, violation, np.full((1, 7), 1e4), 7, 9, 0.1)

    monkeypatch.setattr(run, "prepared", lambda definition, _: (run.problem_from(definition), SMALL))
    monkeypatch.setattr(run.core, "solve", solve)
    return guesses


def chain_job(**more):
    return hop_job(n_hops=N_HOPS, laws=HopSettings(hop_law="gaussian", adaptive=True, max_failures=2), **more)


def sent(message):
    """Return a message as it is behind a pipe, a network and a database."""
    return type(message).model_validate(json.loads(message.model_dump_json()))


def test_hops_are_handed_in_once_some_time_has_passed_and_the_last_never(numerics, monkeypatch):
    parts, now = [], [0.0]
    monkeypatch.setattr(run.time, "monotonic", lambda: now[0])

    def solved_in_4_s(*given, real=run.core.solve):
        now[0] += 4.0
        return real(*given)

    monkeypatch.setattr(run.core, "solve", solved_in_4_s)
    outcome = run.run_job(chain_job(), hand_in=parts.append)
    # Every third hop: 12 s is the first time past 10 s.
    assert [[solve.hop for solve in part.solves] for part in parts] == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    assert [part.place.next_hop for part in parts] == [3, 6, 9]
    assert [solve.hop for solve in outcome.solves] == list(range(N_HOPS)) and outcome.place is None


def test_quick_chains_hand_in_nothing_but_their_outcome(numerics):
    parts = []
    assert len(run.run_job(chain_job(), hand_in=parts.append).solves) == N_HOPS and parts == []


def test_a_chain_goes_on_from_each_of_its_places_bit_by_bit(numerics, monkeypatch):
    monkeypatch.setattr(run, "HAND_IN_S", -1.0)
    parts = []
    whole = run.run_job(chain_job(), hand_in=parts.append)
    guesses = list(numerics)
    assert {solve.move for solve in whole.solves} == {"accepted", "rejected", "restarted"}
    assert any(not part.place.has_incumbent for part in parts) and len(parts) == N_HOPS - 1
    for part in parts:
        numerics.clear()
        rest = run.run_job(sent(chain_job(place=part.place)))
        first = part.place.next_hop
        assert numerics == guesses[first:] and rest.ending is whole.ending
        volatile = {"cpu_seconds", "wall_seconds"}
        assert [solve.model_dump(exclude=volatile) for solve in rest.solves] == [
            solve.model_dump(exclude=volatile) for solve in whole.solves[first:]
        ]


def test_the_ending_of_a_chain_counts_what_was_handed_in_before(numerics):
    place = ChainPlace(
        next_hop=N_HOPS - 1, ending=Ending.FEASIBLE, failures=0, width=0.1, has_incumbent=False
    )
    assert run.run_job(chain_job(place=place)).ending is Ending.FEASIBLE


def test_a_chain_that_is_stopped_says_where_it_stands(numerics):
    outcome = run.run_job(chain_job(), stop=lambda: len(numerics) == 5)
    assert outcome.ending is Ending.CANCELLED and outcome.place.next_hop == len(outcome.solves) == 4


@pytest.mark.parametrize("incumbent", [None, Incumbent(np.array([0.1 + 0.2, -0.0]), 1 / 3, 0.7)])
def test_a_place_keeps_every_bit_of_a_state(incumbent):
    place = sent(run.place_of(ChainState(incumbent, 3, 0.1 * 3), 5, Ending.INFEASIBLE))
    state = run.state_at(place)
    assert (state.failures, state.width) == (3, 0.1 * 3)
    if incumbent is not None:
        assert state.incumbent.x.tobytes() == incumbent.x.tobytes()
        assert (state.incumbent.objective, state.incumbent.violation) == (1 / 3, 0.7)
    else:
        assert state.incumbent is None


@pytest.mark.parametrize("violation", [np.inf, np.nan])
def test_what_could_not_be_flown_stays_an_incumbent_that_anything_finite_beats(violation):
    chain = Chain(SMALL, HopSettings())
    chain.tell(
        Outcome(ExitStatus.NOT_FINITE, np.full(10, np.nan), np.nan, violation, np.zeros((1, 7)), 1, 1, 0.0)
    )
    again = Chain(SMALL, HopSettings(), run.state_at(sent(run.place_of(chain.state, 1, Ending.NUMERICAL))))
    assert not again.is_hopping and again.incumbent is not None
    same = Outcome(ExitStatus.NOT_FINITE, np.zeros(10), np.nan, violation, np.zeros((1, 7)), 1, 1, 0.0)
    assert chain.tell(same) == again.tell(same) == "rejected"


class Talking(Inline):
    """Hands in two parts of a chain, then ends as it is told."""

    def __init__(self, outcome):
        super().__init__(lambda job, stop: outcome or run_fake(job))
        self.parts = []

    def submit(self, ticket, job):
        super().submit(ticket, job)
        self.parts = [
            HandedIn(ticket, sealed(Reached, part_of(job, hops, end)))
            for hops, end in (((0, 1), 2), ((2,), 3))
        ]

    def handed_in(self):
        parts, self.parts = self.parts, []
        return parts


class TakingSource(ListSource):
    """Takes parts, or raises what it is given first."""

    def __init__(self, *faults):
        super().__init__(0)
        job = hop_job(n_hops=5)
        self.waiting = [SimpleNamespace(ticket=Ticket(1, 1), job=job)]
        self.faults, self.parts = list(faults), []

    def claim(self, request):
        claims, self.waiting = self.waiting, []
        return SimpleNamespace(claims=claims, heartbeat_s=0.02)

    def hand_in(self, part):
        if self.faults:
            raise self.faults.pop(0)
        self.parts.append([solve.hop for solve in part.part.solves])
        return HandInAnswer(job_id=1, attempt=1, next_hop=part.part.head.place.next_hop)


def worked(source, outcome=None):
    dispatcher = Dispatcher(source, Talking(outcome), worker_info())
    deadline = time.monotonic() + 60.0
    dispatcher.run(lambda: bool(source.reported) or time.monotonic() > deadline)
    return source.reported[Ticket(1, 1)]


def test_an_outcome_brings_what_is_not_handed_in_yet():
    class Later(Talking):
        def finished(self, timeout):
            # The parts first, the outcome with the next question.
            return [] if self.parts else super().finished(timeout)

    source = TakingSource()
    dispatcher = Dispatcher(source, Later(None), worker_info())
    for _ in range(5):
        dispatcher.step()
    assert source.parts == [[0, 1, 2]]
    assert [solve.hop for solve in source.reported[Ticket(1, 1)].solves] == [3, 4]


def test_an_outcome_that_comes_with_its_parts_brings_them_itself():
    source = TakingSource()
    assert [solve.hop for solve in worked(source).solves] == [0, 1, 2, 3, 4] and source.parts == []


def test_what_a_process_handed_in_before_it_died_is_reported_before_its_death():
    source = TakingSource(UnreachableError("no answer"))
    assert worked(source, JobOutcome(ending=Ending.CRASH)).ending is Ending.CRASH
    assert source.parts == [[0, 1, 2]]


@pytest.mark.parametrize("fault", [FaultyError("500"), StaleAttemptError("job 1: expected to hold it")])
def test_parts_that_are_refused_are_left_to_the_outcome(fault):
    source = TakingSource(fault)
    assert worked(source, JobOutcome(ending=Ending.CRASH)).ending is Ending.CRASH and source.parts == []


def test_a_child_sends_parts_through_its_pipe_and_then_the_outcome():
    pool = ProcessPool(1, "tests.workers.fake:run_handing_in")
    pool.submit(Ticket(1, 1), hop_job(n_hops=3))
    parts, done, deadline = [], [], time.monotonic() + 60.0
    while not done and time.monotonic() < deadline:
        done = pool.finished(0.5)
        parts += pool.handed_in()
    pool.close()
    assert [[solve.hop for solve in part.part.solves] for part in parts] == [[0], [1]]
    assert opened(done[0].outcome) == run_fake(hop_job(n_hops=3)) and parts[0].ticket == Ticket(1, 1)
