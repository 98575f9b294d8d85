"""Validation of solves and solutions.

One set of rules for all that comes from elsewhere: outcomes of workers, portable files, and the rows of an
archive in `coastarc db check`.  What follows from a vector or from an address is worked out again: hashes,
masses, times, delta-v, epochs, keys of random numbers.  What only a flight or a clock can tell is held
against bounds alone: defects against their levels, processor time against its limit.  Only the defects
themselves, times, counts, moves and provenance are believed; `coastarc solutions verify` flies again.

UnsoundError(ValueError)   something that cannot be so

The identity of a solution, which is the same in every archive.
"""

import hashlib
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from core.analysis.metrics import total_delta_v_km_s, transfer_delta_v_km_s
from core.constants import SECONDS_PER_DAY
from core.epochs import seconds_past_j2000
from core.nlp import ExitStatus, SolveSettings
from core.orbits import departure_state
from core.problem import Problem
from core.search import HopAddress
from core.tolerances import Tolerance, violation
from core.transcription import Layout, checked_vector, layout_of
from core.verification.verify import BOUND_SLACK, holds
from core.world import world_of
from workers.messages import (
    KIND_NUMBERS,
    RESULTS,
    Ending,
    JobOutcome,
    JobSettings,
    SolveRecord,
    wall_limit_of,
)

Array = NDArray[np.float64]


def solution_hash(problem_hash: str, x: Any) -> str:
    """Return the identity of a solution: its problem and every bit of its vector."""
    vector = np.ascontiguousarray(x, dtype="<f8")
    return hashlib.blake2b(bytes.fromhex(problem_hash) + vector.tobytes(), digest_size=16).hexdigest()


#: Figures are worked out again; other machines round otherwise, and epochs are kept to a millisecond.
RELATIVE, EPOCH_S = 1e-9, 2e-3
#: A job past its wall limit is killed, which takes a moment: how far its processor time may exceed it.
CPU_MARGIN = 1.05
#: A seed may be solved in several steps, each with the iterations of a solve: many more than there are.
ITERATION_MARGIN = 20
_STATUSES = frozenset(ExitStatus.__members__)


class UnsoundError(ValueError):
    """An inconsistent solve or solution."""


@dataclass(frozen=True, slots=True, eq=False)
class ProblemFacts:
    """What the figures of a problem's solutions follow from, worked out once."""

    problem: Problem
    hash: str
    layout: Layout
    #: At departure [TDB s past J2000], [kg].
    start_et: float
    start_mass_kg: float
    #: The box of x.
    bounds: tuple[Array, Array]

    @property
    def n_defects(self) -> int:
        """Numbers in the defects of a solve."""
        return 7 * (1 + self.problem.k)


def facts_of(problem: Problem, problem_hash: str | None = None) -> ProblemFacts:
    """Return what the figures of a problem's solutions follow from."""
    start, layout = departure_state(problem.departure, problem.spacecraft), layout_of(problem)
    mass_kg = float(start.mass_kg)
    bounds = layout.bounds(problem, mass_kg)
    return ProblemFacts(problem, problem_hash or problem.hash, layout, float(start.et), mass_kg, bounds)


@dataclass(frozen=True, slots=True, eq=False)
class JobFacts:
    """What the solves of a job have to agree with."""

    about: ProblemFacts
    rng_seed: int
    #: That of its first hop.
    address: HopAddress
    n_hops: int
    settings: JobSettings

    @property
    def hops(self) -> range:
        """The hops that it may hand in."""
        return range(self.address.hop, self.address.hop + self.n_hops)

    @property
    def is_map(self) -> bool:
        """Whether it maps a seed."""
        return self.address.kind == KIND_NUMBERS["map"]

    @property
    def cpu_limit_s(self) -> float:
        """Processor time that none of its solves can have taken [s]."""
        return CPU_MARGIN * wall_limit_of(self.settings, self.about.problem.k, self.n_hops)

    def rng_key(self, hop: int) -> str:
        """Return the key of the random numbers of a hop."""
        return "/".join(map(str, (self.rng_seed, *self.address._replace(hop=hop))))


class SolveLike(Protocol):
    """A solve as a message, a line or a row."""

    @property
    def hop(self) -> int: ...  # noqa: D102
    @property
    def rng_key(self) -> str: ...  # noqa: D102
    @property
    def ending(self) -> str: ...  # noqa: D102
    @property
    def cpu_seconds(self) -> float: ...  # noqa: D102
    @property
    def move(self) -> str | None: ...  # noqa: D102


def require_solve(thing: str, job: JobFacts, solve: SolveLike, n_defects: int, has_solution: bool) -> None:
    """Refuse a solve that no run of its job can have made, whichever version ran it."""
    if solve.hop not in job.hops:
        first, last = job.hops[0], job.hops[-1]
        raise UnsoundError(f"{thing}: expected a hop of its job, {first} to {last}, got {solve.hop}")
    if solve.rng_key != (key := job.rng_key(solve.hop)):
        raise UnsoundError(f"{thing}: expected rng_key {key} of its address, got {solve.rng_key[:80]!r}")
    if solve.ending not in RESULTS or (solve.ending == Ending.FEASIBLE) != has_solution:
        got = f"{Ending(solve.ending).value} {'with' if has_solution else 'without'} one"
        raise UnsoundError(f"{thing}: expected ending feasible with a solution, another without, got {got}")
    if n_defects != job.about.n_defects:
        raise UnsoundError(f"{thing}: expected {job.about.n_defects} defects, got {n_defects}")
    if not 0.0 <= solve.cpu_seconds <= job.cpu_limit_s:
        raise UnsoundError(
            f"{thing}: expected cpu_seconds from 0 to the wall limit of its job, {job.cpu_limit_s:.0f}, "
            f"got {solve.cpu_seconds:g}"
        )
    if (solve.move is None) != job.is_map:
        raise UnsoundError(f"{thing}: expected a move from a hop, none from a map job, got {solve.move}")


def require_solution(
    thing: str,
    about: ProblemFacts,
    x: object,
    said: Mapping[str, Any],
    defects: Array,
    levels: tuple[bool, bool],
) -> Array:
    """Return a vector, or refuse one of another shape, or with figures, epochs or levels not its own."""
    try:
        vector = checked_vector(about.layout, x)
    except ValueError as error:
        raise UnsoundError(f"{thing}: {error}") from error
    for name, expected in figures(about, vector).items():
        if not math.isclose(expected, said[name], rel_tol=RELATIVE, abs_tol=RELATIVE):
            raise UnsoundError(f"{thing}: expected {name} {expected} from its vector, got {said[name]}")
    _require_epochs(thing, about, said)
    if defects.size != about.n_defects:
        raise UnsoundError(f"{thing}: expected {about.n_defects} defects, got {defects.size}")
    rows, (paper, strict) = defects.reshape(-1, 7), levels
    world = world_of(about.problem)
    if not paper or not holds(rows, world.loose) or (strict and not holds(rows, world.strict)):
        raise UnsoundError(f"{thing}: expected defects within its level, got larger ones")
    return vector


def require_hash(thing: str, about: ProblemFacts, x: Array, solution_id: str) -> None:
    """Refuse a solution under another hash than its own."""
    if solution_hash(about.hash, x) != solution_id:
        raise UnsoundError(f"{thing}: expected the hash of its problem and its vector, got another")


def figures(about: ProblemFacts, x: Array) -> dict[str, float]:
    """Return what the archive keeps of a vector's reference, masses [kg], times [days], delta-v [km/s]."""
    own, problem = about.layout.reference, about.problem
    final_kg = float(x[own.final_mass])
    times = [float(x[place]) for place in (own.shooting_time, own.initial_coast, own.final_coast)]
    if not 0.0 < final_kg:
        raise UnsoundError(f"decision vector: expected a final mass above 0 kg, got {final_kg:g}")
    return {
        "objective_kg": final_kg,
        "propellant_kg": about.start_mass_kg - final_kg,
        "delta_v_km_s": transfer_delta_v_km_s(problem, about.start_mass_kg, final_kg),
        "delta_v_total_km_s": total_delta_v_km_s(problem, final_kg),
        "shooting_days": times[0],
        "initial_coast_days": times[1],
        "final_coast_days": times[2],
        "time_of_flight_days": sum(times),
    }


def _require_epochs(thing: str, about: ProblemFacts, said: Mapping[str, Any]) -> None:
    arrival = about.start_et + said["time_of_flight_days"] * SECONDS_PER_DAY
    insertion = arrival - said["final_coast_days"] * SECONDS_PER_DAY
    for name, expected in (("arrival_epoch", arrival), ("insertion_epoch", insertion)):
        try:
            is_so = abs(seconds_past_j2000(said[name]) - expected) < EPOCH_S
        except ValueError:
            is_so = False
        if not is_so:
            raise UnsoundError(f"{thing}: expected {name} from its vector, got {said[name][:40]!r}")


def require_outcome(job: JobFacts, outcome: JobOutcome, done: Mapping[int, str]) -> None:
    """Refuse an inconsistent outcome of a worker.

    `done` has the endings of the hops that earlier reports on the same job brought, by hop: a report may
    bring the first hops of a chain, the rest of it, or all again.
    """
    hops = [record.hop for record in outcome.solves]
    if any(later <= earlier for earlier, later in pairwise(hops)):
        raise UnsoundError(f"solves: expected each hop once and in order, got {_shorten(hops)}")
    if outcome.solves and outcome.provenance is None:
        raise UnsoundError("provenance: expected that of the solves, got none")
    require_records(job, outcome.solves)
    found = {Ending(ending) for ending in done.values()} | {record.ending for record in outcome.solves}
    if outcome.ending in RESULTS:
        _require_result(job, outcome, done.keys() | set(hops), found)


def _require_result(job: JobFacts, outcome: JobOutcome, hops: Collection[int], found: set[Ending]) -> None:
    # A process that hung has no solve to show for its time, and is no bug.
    is_hung = outcome.ending is Ending.TIMEOUT and not outcome.solves
    if not is_hung and (missing := set(job.hops) - set(hops)):
        raise UnsoundError(
            f"solves: expected all {job.n_hops} of a job that ended {outcome.ending.value}, got none of hop "
            f"{min(missing)}"
        )
    if (outcome.ending is Ending.FEASIBLE) != (Ending.FEASIBLE in found) and not is_hung:
        raise UnsoundError(
            f"ending: expected feasible with a feasible solve and another without, got {outcome.ending.value}"
        )


def require_records(job: JobFacts, records: Sequence[SolveRecord]) -> None:
    """Refuse solves of a worker, whole reports or parts, that no run of its job can have made."""
    for record in records:
        _require_record(job, record)
    if (total := math.fsum(record.cpu_seconds for record in records)) > job.cpu_limit_s:
        raise UnsoundError(
            f"solves: expected cpu_seconds that add up to the wall limit of the job at most, "
            f"{job.cpu_limit_s:.0f}, got {total:g}"
        )


def _require_record(job: JobFacts, record: SolveRecord) -> None:
    thing, about = f"hop {record.hop}", job.about
    parts = [part is not None for part in (record.x, record.trajectory, record.certificate)]
    if any(parts) != all(parts):
        raise UnsoundError(f"{thing}: expected x, trajectory and certificate together, got {sum(parts)} of 3")
    if any(len(row) != 7 for row in record.defects):
        raise UnsoundError(f"{thing}: expected defects in rows of 7, got rows of other lengths")
    require_solve(thing, job, record, 7 * len(record.defects), all(parts))
    if record.status not in _STATUSES:
        raise UnsoundError(f"{thing}: expected a status that is known, got {record.status[:80]!r}")
    if job.hops[0] == record.hop and record.move not in (None, "accepted"):
        raise UnsoundError(f"{thing}: expected the first move of a chain accepted, got {record.move}")
    limit = job.settings.max_iterations or SolveSettings().max_iterations
    most = ITERATION_MARGIN * (limit + 100) * (1 + about.problem.k)
    if record.n_iterations > most:
        raise UnsoundError(f"{thing}: expected n_iterations up to {most}, got {record.n_iterations}")
    _require_feasibility(thing, record, world_of(about.problem).strict)
    if record.x is not None:
        _require_found(thing, about, record)


def _require_feasibility(thing: str, record: SolveRecord, strict: Tolerance) -> None:
    if record.is_feasible != (record.violation is not None and record.violation <= 1.0):
        raise UnsoundError(
            f"{thing}: expected is_feasible where the violation is at most 1, got {record.is_feasible} "
            f"at {record.violation}"
        )
    defects = np.array(record.defects, dtype=np.float64)
    if record.is_feasible and not violation(defects, strict) <= 1.0 + RELATIVE:
        raise UnsoundError(
            f"{thing}: expected defects within the strict tolerance, got is_feasible beyond it"
        )


def _require_found(thing: str, about: ProblemFacts, record: SolveRecord) -> None:
    assert record.trajectory is not None and record.certificate is not None
    flown, verdict = record.trajectory, record.certificate
    if any(len(row) != 7 for row in verdict.defects):
        raise UnsoundError(f"{thing}: certificate: expected defects in rows of 7, got rows of other lengths")
    said = flown.model_dump() | {"objective_kg": flown.final_mass_kg}
    defects = np.array(verdict.defects, dtype=np.float64).ravel()
    x = require_solution(thing, about, record.x, said, defects, (verdict.paper, verdict.strict))
    lower, upper = about.bounds
    # As the verifier does: IPOPT itself relaxes bounds a little.
    slack = 2 * BOUND_SLACK * (upper - lower)
    if np.any(outside := (x < lower - slack) | (x > upper + slack)):
        place = int(np.argmax(outside))
        raise UnsoundError(
            f"{thing}: expected x[{place}] within its bounds, {lower[place]:g} to {upper[place]:g}, "
            f"got {x[place]!r}"
        )
    if record.objective_kg is None or not math.isclose(
        record.objective_kg, flown.final_mass_kg, rel_tol=RELATIVE
    ):
        raise UnsoundError(
            f"{thing}: expected objective_kg {flown.final_mass_kg} from its vector, got {record.objective_kg}"
        )


def _shorten(hops: Sequence[int]) -> str:
    listed = ", ".join(map(str, hops[:8]))
    return f"{listed}, ... ({len(hops)})" if len(hops) > 8 else listed
