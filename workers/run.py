"""From a job to its outcome: one record per NLP solve, each feasible one certified.

This is the only file of workers that does numerics.  Numerical failure is data; an exception is a bug
of ours and ends the attempt as `error`, with the solves that were finished before it.
"""

import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import core
from core.nlp import ExitStatus, Outcome, SolveSettings
from core.problem import Problem, problem_from
from core.search import (
    Chain,
    ChainState,
    HopAddress,
    Incumbent,
    hop_rng,
    solve_recovery,
    solve_seed,
)
from core.tolerances import violation
from core.transcription import TOLERANCE, Transcription
from core.world import world_of
from workers.certify import finite_or_none, trajectory, verification_record
from workers.messages import (
    KIND_NUMBERS,
    LONGEST_ERROR,
    WALL_FACTOR,
    WALL_MARGIN_S,
    ChainPart,
    ChainPlace,
    Ending,
    HopJob,
    Job,
    JobOutcome,
    JobSettings,
    MapJob,
    SolveRecord,
)
from workers.process_tree import require_one_thread
from workers.provenance import provenance
from workers.retry import Awake

Stop = Callable[[], bool]

#: How long a chain works before it hands in its hops, and again [s]: a loss costs that much, or one hop.
HAND_IN_S = 10.0

#: Endings of statuses that are not plainly infeasible.
ENDINGS = {
    "NOT_FINITE": Ending.NUMERICAL,
    "SOLVER_FAILURE": Ending.NUMERICAL,
    "TIMEOUT": Ending.TIMEOUT,
    "FEASIBLE_AT_DEADLINE": Ending.TIMEOUT,
    # Nobody asked it to: a job that was cancelled hands in no record, so this was the wall clock.
    "STOPPED": Ending.TIMEOUT,
}


def run_job(
    job: Job, stop: Stop = lambda: False, hand_in: Callable[[ChainPart], None] | None = None
) -> JobOutcome:
    """Run a job to its end, or until `stop` says so; every finished solve is kept.

    `hand_in` takes the hops of a long chain as they come; the outcome has all of this run again.
    """
    solves: list[SolveRecord] = []
    parts = _Parts(job, hand_in)
    try:
        with threadpool_limits(1):
            require_one_thread()
            for record, chain in _solves(job, stop):
                solves.append(record)
                parts.add(record, chain)
    except Exception:
        # Its end says what went wrong.
        return _outcome(Ending.ERROR, solves, traceback.format_exc()[-LONGEST_ERROR:])
    if len(solves) < _n_solves(job):
        return _outcome(Ending.CANCELLED, solves, place=parts.place)
    return _outcome(parts.ending, solves)


def summary_ending(endings: Iterable[Ending]) -> Ending:
    """Return the ending of a job: the best of its solves'."""
    order = (Ending.FEASIBLE, Ending.INFEASIBLE, Ending.TIMEOUT, Ending.NUMERICAL)
    return min(endings, key=order.index, default=Ending.NUMERICAL)


def _n_solves(job: Job) -> int:
    """Return how many solves are left of a job."""
    if isinstance(job, MapJob):
        return 1
    return job.n_hops - (job.place.next_hop - job.address.hop if job.place else 0)


def _earlier(job: Job) -> tuple[Ending, ...]:
    return (job.place.ending,) if isinstance(job, HopJob) and job.place else ()


class _Parts:
    """Hands in the hops of a chain, at most every `HAND_IN_S` and never the last: the end comes at once."""

    def __init__(self, job: Job, hand_in: Callable[[ChainPart], None] | None) -> None:
        self._hand_in = hand_in
        self._endings = list(_earlier(job))
        self._solves: list[SolveRecord] = []
        self._n_left = _n_solves(job)
        self._due = time.monotonic() + HAND_IN_S
        #: Where the chain stands; None at its start.
        self.place: ChainPlace | None = None

    @property
    def ending(self) -> Ending:
        """The best so far."""
        return summary_ending(self._endings)

    def add(self, record: SolveRecord, chain: Chain | None) -> None:
        """Take a solve, and hand in what there is if it is time."""
        self._solves.append(record)
        self._endings.append(record.ending)
        self._n_left -= 1
        if chain is None or not self._n_left:
            return
        self.place = place_of(chain.state, record.hop + 1, self.ending)
        if self._hand_in is None or time.monotonic() < self._due:
            return
        self._hand_in(ChainPart(solves=tuple(self._solves), provenance=provenance(), place=self.place))
        self._solves, self._due = [], time.monotonic() + HAND_IN_S


def place_of(state: ChainState, next_hop: int, ending: Ending) -> ChainPlace:
    """Return where a chain stands, as a message."""
    best = state.incumbent
    assert state.width is not None
    about: dict[str, Any] = {"has_incumbent": best is not None}
    if best is not None:
        about |= {"objective_kg": finite_or_none(best.objective), "violation": finite_or_none(best.violation)}
        if np.isfinite(best.violation):
            about |= {"x": as_floats(best.x)}
    return ChainPlace(next_hop=next_hop, ending=ending, failures=state.failures, width=state.width, **about)


def state_at(place: ChainPlace | None) -> ChainState | None:
    """Return where a chain goes on, bit by bit as it was."""
    if place is None:
        return None
    incumbent = None
    if place.has_incumbent:
        # What was not finite ranks last whatever it was, and nothing hops from there.
        x = np.array(() if place.x is None else place.x)
        objective, worst = (np.nan if v is None else v for v in (place.objective_kg, place.violation))
        incumbent = Incumbent(x, objective, worst)
    return ChainState(incumbent, place.failures, place.width)


def _outcome(ending: Ending, solves: list[SolveRecord], error: str | None = None, **more: Any) -> JobOutcome:
    return JobOutcome(ending=ending, solves=tuple(solves), provenance=provenance(), error=error, **more)


def _solves(job: Job, stop: Stop) -> Iterator[tuple[SolveRecord, Chain | None]]:
    """Yield each solve, with the chain that it belongs to."""
    return _hops(job, stop) if isinstance(job, HopJob) else _solve_seed(job, stop)


def _hops(job: HopJob, stop: Stop) -> Iterator[tuple[SolveRecord, Chain]]:
    problem, transcription = prepared(job.problem, job.settings)
    chain = Chain(transcription, job.laws, state_at(job.place))
    first = job.place.next_hop if job.place else job.address.hop
    for hop in range(first, job.address.hop + job.n_hops):
        guess = chain.ask(hop_rng(job.rng_seed, hop_address(job, hop)))
        deadline = _Deadline(job.settings, problem, stop)
        stopwatch = Stopwatch()
        outcome = core.solve(transcription, guess, solve_settings(job.settings), deadline)
        times = stopwatch.read()
        if stop():
            # Cut short, it is not the result that this address stands for.
            return
        move = chain.tell(outcome)
        yield _record(job, hop, problem, outcome, times, move), chain


def _solve_seed(job: MapJob, stop: Stop) -> Iterator[tuple[SolveRecord, None]]:
    problem, seed_problem = precompiled(job.problem, job.settings), problem_from(job.seed_problem)
    seed, form = np.array(job.seed_x), _form(job.settings)
    deadline = _Deadline(job.settings, problem, stop)
    stopwatch = Stopwatch()
    settings = solve_settings(job.settings)
    solve = solve_recovery if job.settings.is_reference_frozen else solve_seed
    outcome = solve(seed_problem, seed, problem, job.mapping, settings, deadline, **form)
    times = stopwatch.read()
    if not stop():
        yield _record(job, job.address.hop, problem, outcome, times), None


def hop_address(job: Job, hop: int) -> HopAddress:
    """Return the address that the generator of a hop is made from."""
    place = job.address
    return HopAddress(KIND_NUMBERS[job.kind], place.search, place.case, place.chain, hop)


def solve_settings(settings: JobSettings) -> SolveSettings:
    """Return core's settings; what the job leaves open keeps core's default."""
    given: dict[str, Any] = {"cpu_seconds": settings.cpu_seconds, "recoveries": settings.recoveries}
    if settings.max_iterations is not None:
        given["max_iterations"] = settings.max_iterations
    return SolveSettings(**given)


def prepared(definition: dict[str, Any], settings: JobSettings) -> tuple[Problem, Transcription]:
    """Return a problem and its transcription, which each process builds and compiles once."""
    problem = problem_from(definition)
    return problem, _transcribed(problem, **_form(settings))


def precompiled(definition: dict[str, Any], settings: JobSettings) -> Problem:
    """Return a problem, in a process that has compiled all that its solve calls."""
    problem = problem_from(definition)
    if not _IS_COMPILED.is_set():
        _transcribed(problem, **_form(settings))
    return problem


#: Set once this process has compiled all that a solve calls, for whichever problem that was.
_IS_COMPILED = threading.Event()


def _form(settings: JobSettings) -> dict[str, Any]:
    """Return the options of a transcription, none of which changes the meaning of x."""
    return {"n_legs": settings.n_legs, "tolerance": settings.integrator_tolerance or TOLERANCE}


@lru_cache(maxsize=32)
def _transcribed(problem: Problem, n_legs: int, tolerance: float) -> Transcription:
    transcription = core.transcribe(problem, n_legs=n_legs, tolerance=tolerance)
    # One iteration compiles all that a solve calls, before any clock runs; its draw is no part of the search.
    guess = core.sample_guess(transcription, np.random.default_rng(0))
    core.solve(transcription, guess, SolveSettings(max_iterations=1))
    _IS_COMPILED.set()
    return transcription


class Stopwatch:
    """Processor time of this thread, and wall time, since it was made."""

    def __init__(self) -> None:
        self._start = (time.thread_time(), time.perf_counter())

    def read(self) -> tuple[float, float]:
        """Return (cpu_seconds, wall_seconds)."""
        return time.thread_time() - self._start[0], time.perf_counter() - self._start[1]


class _Deadline:
    """Stops a solve when asked to, or when it has run far longer than its cap of processor time.

    Pauses of the process do not count: what ends here is stored as a result of the search.
    """

    def __init__(self, settings: JobSettings, problem: Problem, stop: Stop) -> None:
        cap = settings.cpu_seconds * (1 + problem.k)
        self._longest_s = WALL_FACTOR * cap + WALL_MARGIN_S
        self._awake = Awake()
        self._stop = stop

    def __call__(self) -> bool:
        return self._stop() or self._awake() > self._longest_s


def _record(
    job: Job,
    hop: int,
    problem: Problem,
    outcome: Outcome,
    times: tuple[float, float],
    move: Any = None,
) -> SolveRecord:
    judged = _verify(problem, outcome)
    place = hop_address(job, hop)
    ending = Ending.FEASIBLE if judged else ENDINGS.get(outcome.status.name, Ending.INFEASIBLE)
    return SolveRecord(
        hop=hop,
        rng_key="/".join(map(str, (job.rng_seed, *place))),
        ending=ending,
        status=outcome.status.name,
        is_feasible=bool(outcome.is_feasible),
        objective_kg=finite_or_none(outcome.objective),
        violation=finite_or_none(outcome.violation),
        defects=tuple(tuple(map(finite_or_none, row)) for row in np.asarray(outcome.defects)),
        n_iterations=int(outcome.n_iterations),
        n_evaluations=int(outcome.n_evaluations),
        cpu_seconds=times[0],
        wall_seconds=times[1],
        move=move,
        **judged,
    )


def _verify(problem: Problem, outcome: Outcome) -> dict[str, Any]:
    """Return vector, facts and certificate of a solution, or nothing if it is none."""
    # The verifier lets pass what touches no surface.
    if outcome.status is ExitStatus.IMPACT or violation(outcome.defects, world_of(problem).loose) > 1.0:
        return {}
    stopwatch = Stopwatch()
    verification = core.verify(problem, outcome.x)
    if not verification.paper:
        return {}
    return {
        "x": as_floats(outcome.x),
        "trajectory": trajectory(problem, outcome.x, verification),
        "certificate": verification_record(verification, stopwatch.read()[0]),
    }


def as_floats(x: NDArray[np.float64]) -> tuple[float, ...]:
    """Return a vector as plain floats, which JSON carries exactly."""
    return tuple(np.asarray(x, dtype=np.float64).tolist())
