"""The messages between the coordinator and whatever runs jobs: frozen, validated, JSON both ways.

A job says everything that its run needs, so that it gives the same result wherever and however often
it runs.  Decision vectors are in the paper layout and public units (days, throttle [-], rad, kg).

A source of jobs is the coordinator behind five calls that carry these messages alone; what it raises:

SourceError(WorkerError)    a source that did not do what it was asked
    UnreachableError        no answer now; the same may be asked again
        FaultyError         it failed over this very question
    RefusedError            it rejects this worker: its token, its version
    UnacceptableError       it rejects this report, however often it comes
    StaleAttemptError       lease lost: the report changes nothing
"""

import hashlib
import json
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Any, Generic, Literal, NamedTuple, Protocol, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from core.errors import UserError
from core.search.settings import HopSettings


class WorkerError(RuntimeError):
    """Something that carries, hands out or runs jobs cannot do its work."""


#: `HopAddress.kind` of the two kinds of job; part of every generator's key, so never renumbered.
KIND_NUMBERS = {"hop": 0, "map": 1}

#: The wall clock is a safety net for a solver that does not get its processor: this many times its cap of
#: processor time, and a margin [s] ...
WALL_FACTOR = 4.0
WALL_MARGIN_S = 60.0
#: ... and, before the process of a job that cannot even look at a clock is killed, once more time to compile
#: and to verify [s].
HANG_MARGIN_S = 300.0
#: Longest error of an outcome, and longest details of a certificate as JSON.
LONGEST_ERROR, LONGEST_DETAILS = 100_000, 100_000
#: Most solves of an outcome: those of the longest chain.
MOST_SOLVES = 10_000


class Ending(StrEnum):
    """How a solve or an attempt ended; the first four are results, the others are not."""

    FEASIBLE = "feasible"
    INFEASIBLE = "infeasible"
    NUMERICAL = "numerical"
    TIMEOUT = "timeout"
    ERROR = "error"
    CRASH = "crash"
    LOST = "lost"
    CANCELLED = "cancelled"


#: Endings that are results; a job whose attempt ended so is done.
RESULTS = (Ending.FEASIBLE, Ending.INFEASIBLE, Ending.NUMERICAL, Ending.TIMEOUT)


class Message(BaseModel):
    """Data that crosses a process boundary: finite numbers, bounded texts and lists, no other fields."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def _plain(details: dict[str, Any]) -> dict[str, Any]:
    try:
        text = json.dumps(details, allow_nan=False)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"expected plain JSON with finite numbers, got {error}") from error
    if len(text) > LONGEST_DETAILS or "\\u0000" in text:
        raise ValueError(
            f"expected at most {LONGEST_DETAILS} characters of JSON without zero bytes, got {len(text)}"
        )
    return details


#: What fits into a column of the database.
RowId = Annotated[int, Field(ge=1, lt=2**63)]
Count = Annotated[int, Field(ge=0, lt=2**63)]
#: What a solve may count, and how long it may have taken [s]: far beyond all that happens, and so small that
#: sums over an archive stay numbers of the database.
Effort = Annotated[int, Field(ge=0, le=10**12)]
Seconds = Annotated[float, Field(ge=0, le=1e9)]
#: Masses [kg], times [days] and velocities [km/s] likewise.
Figure = Annotated[float, Field(ge=-1e12, le=1e12)]
#: A limit also refuses texts that are no Unicode.
Short = Annotated[
    str, Field(pattern=r"^[^\x00-\x1f\x7f]{1,200}$", description="1 to 200 characters, none of control")
]
Printed = Annotated[str, Field(pattern=r"^[!-~][ -~]{0,199}$", description="1 to 200 printable characters")]


class Address(Message):
    """Where in its campaign a solve stands; with the rng_seed it fixes every number drawn."""

    search: Annotated[int, Field(ge=0)]
    case: Annotated[int, Field(ge=0)] = 0
    #: Number of the chain, or for a map job the solution hash of its seed read as an integer.
    chain: Annotated[int, Field(ge=0)]
    hop: Annotated[int, Field(ge=0)] = 0


class JobSettings(Message):
    """What shapes a solve besides its guess; caps are scaled by 1 + k inside `core.solve`."""

    #: Far above what the iterations take, so that counts shape a result and the clock only guards it.
    cpu_seconds: Annotated[float, Field(gt=0, le=86400, allow_inf_nan=False)] = 120.0
    max_iterations: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    n_legs: Annotated[int, Field(ge=1, le=200)] = 10
    #: Of the integrator while propellant is saved, in canonical units; None for core's own.
    integrator_tolerance: Annotated[float, Field(ge=1e-14, le=1e-3)] | None = None
    #: Whether a seed's reference is flown as it is, and only its realizations are solved.
    is_reference_frozen: bool = False
    #: A name of `core.nlp.RECOVERIES`.
    recoveries: Literal["cheapest", "any"] = "any"


class ChainPlace(Message):
    """Where a chain stands between two hops: all that the next depends on besides its address."""

    next_hop: Annotated[int, Field(ge=1)]
    #: Best of the endings so far.
    ending: Ending
    failures: Annotated[int, Field(ge=0)]
    width: Annotated[float, Field(gt=0, le=1)]
    #: Whether there is an incumbent; only one with finite numbers has a vector to hop from.
    has_incumbent: bool
    x: tuple[float, ...] | None = None
    objective_kg: float | None = None
    violation: float | None = None


class HopJob(Message):
    """A chain of monotonic basin hopping: `n_hops` solves from one start."""

    kind: Literal["hop"] = "hop"
    problem: dict[str, Any]
    rng_seed: Annotated[int, Field(ge=0)]
    address: Address
    n_hops: Annotated[int, Field(ge=1)]
    laws: HopSettings = HopSettings()
    settings: JobSettings = JobSettings()
    #: Where to go on, if earlier attempts have handed in hops.
    place: ChainPlace | None = None


class MapJob(Message):
    """One seed, mapped to one guess and solved."""

    kind: Literal["map"] = "map"
    problem: dict[str, Any]
    rng_seed: Annotated[int, Field(ge=0)]
    address: Address
    seed_id: str
    seed_problem: dict[str, Any]
    seed_x: tuple[float, ...]
    mapping: str
    settings: JobSettings = JobSettings()


Job = Annotated[HopJob | MapJob, Field(discriminator="kind")]


def wall_limit_s(job: HopJob | MapJob) -> float:
    """Return how long a job may take at most before its process counts as hung [s]."""
    k = len(job.problem.get("outages", ()))
    return wall_limit_of(job.settings, k, job.n_hops if isinstance(job, HopJob) else 1)


def wall_limit_of(settings: JobSettings, k: int, n_solves: int) -> float:
    """Return the limit for so many solves of a P_k [s]."""
    return n_solves * (WALL_FACTOR * settings.cpu_seconds * (1 + k) + WALL_MARGIN_S) + HANG_MARGIN_S


def job_digest(job: HopJob | MapJob) -> str:
    """Return a digest that identifies a job, across archives too."""
    # Where an attempt begins is none of it.
    text = job.model_dump_json(exclude={"place"})
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


class Provenance(Message):
    """What produced a result."""

    code_version: Short
    python_version: Short
    package_versions: Annotated[dict[Short, Short], Field(max_length=1000)]
    #: SHA-256 of the SPICE kernels by file name.
    kernel_hashes: Annotated[dict[Short, Short], Field(max_length=1000)]
    host: Short


class Trajectory(Message):
    """Key figures of a solution; masses and times are those of the reference."""

    final_mass_kg: Figure
    #: Used in the transfer, that is since the departure state.
    propellant_kg: Figure
    delta_v_km_s: Figure
    #: Counted from the wet mass: spiral and transfer.
    delta_v_total_km_s: Figure
    shooting_days: Figure
    initial_coast_days: Figure
    final_coast_days: Figure
    time_of_flight_days: Figure
    insertion_epoch: Short
    arrival_epoch: Short


class VerificationRecord(Message):
    """The verifier's verdict on a solve, as it is stored with it; a certificate says far more."""

    paper: bool
    strict: bool
    #: One row per trajectory: (x, y, z) [km], (vx, vy, vz) [km/s], m [kg].
    defects: tuple[tuple[float, ...], ...]
    details: Annotated[dict[str, Any], AfterValidator(_plain)] = {}
    cpu_seconds: Seconds


class SolveRecord(Message):
    """One NLP solve, feasible or not; every one of them counts as a guess."""

    hop: Count
    rng_key: Short
    ending: Ending
    #: Name of a `core.nlp.ExitStatus`.
    status: Short
    is_feasible: bool
    objective_kg: Figure | None
    violation: Annotated[float, Field(ge=0)] | None
    defects: tuple[tuple[float | None, ...], ...]
    n_iterations: Effort
    n_evaluations: Effort
    cpu_seconds: Seconds
    wall_seconds: Seconds
    #: What the chain did with it; None for a map job.
    move: Literal["accepted", "rejected", "restarted"] | None = None
    #: Only when the verifier found it feasible at the loose tolerance or better.
    x: tuple[float, ...] | None = None
    trajectory: Trajectory | None = None
    certificate: VerificationRecord | None = None


class Ended(Message):
    """How an attempt at a job ended, but for its solves."""

    ending: Ending
    provenance: Provenance | None = None
    #: A traceback for `error`, the last words of the process for `crash`.
    error: Annotated[str, Field(max_length=LONGEST_ERROR)] | None = None
    #: Where a chain stands that was stopped between two hops.
    place: ChainPlace | None = None


class JobOutcome(Ended):
    """How an attempt at a job ended, with one record per solve that it finished."""

    solves: Annotated[tuple[SolveRecord, ...], Field(max_length=MOST_SOLVES)] = ()


class Reached(Message):
    """How far a chain is that goes on, but for its solves."""

    provenance: Provenance
    #: Where the chain stands after them.
    place: ChainPlace


class ChainPart(Reached):
    """The next hops of a chain that goes on, handed in so that a loss does not cost them."""

    solves: Annotated[tuple[SolveRecord, ...], Field(min_length=1)]


class SealedSolve(NamedTuple):
    """A solve as JSON, and its hop, by which it is told from others."""

    hop: int
    text: str


H = TypeVar("H", bound=Message)


class Sealed(NamedTuple, Generic[H]):
    """An outcome or a part of a chain on its way; its solves are read where they are stored."""

    head: H
    solves: tuple[SealedSolve, ...] = ()

    def to_json(self) -> str:
        """Return the message that was sealed, as JSON."""
        solves = ",".join(solve.text for solve in self.solves)
        return f'{self.head.model_dump_json()[:-1]},"solves":[{solves}]}}'


def sealed(head: type[H], message: JobOutcome | ChainPart) -> Sealed[H]:
    """Return a message with its solves sealed; `head` is the class of what stays open."""
    opened = head.model_construct(**{name: getattr(message, name) for name in head.model_fields})
    return Sealed(opened, tuple(SealedSolve(one.hop, one.model_dump_json()) for one in message.solves))


def packed(message: Sealed[Any]) -> tuple[Any, ...]:
    """Return a sealed message as plain data, for a pipe."""
    return message.head.model_dump(mode="json"), message.solves


def unpacked(head: type[H], data: Sequence[Any]) -> Sealed[H]:
    """Return a sealed message from plain data."""
    return Sealed(head.model_validate(data[0]), tuple(SealedSolve(*solve) for solve in data[1]))


class Ticket(NamedTuple):
    """One attempt at one job."""

    job_id: int
    attempt: int

    def to_json(self, **fields: str) -> str:
        """Return a message about it as JSON, its fields given as JSON."""
        texts = {"job_id": str(self.job_id), "attempt": str(self.attempt)} | fields
        return "{" + ",".join(f'"{name}":{text}' for name, text in texts.items()) + "}"


class OfAttempt(Message):
    """A message about one attempt at one job; the attempt is the fencing token of its reports."""

    job_id: int
    attempt: int

    @property
    def ticket(self) -> Ticket:
        """The attempt, to tell it from others."""
        return Ticket(self.job_id, self.attempt)


class Claim(OfAttempt):
    """A job handed out."""

    job: Job


class HeldJob(OfAttempt):
    """A job that a worker holds."""

    job_id: RowId
    attempt: RowId


#: The tickets of one heartbeat, at most.
MOST_HELD = 5000
HeldJobs = Annotated[tuple[HeldJob, ...], Field(max_length=MOST_HELD)]


class WorkerInfo(Message):
    """What a dispatcher says about itself with every claim and heartbeat."""

    #: Unique among all that work for a coordinator, and the same for as long as it holds jobs.
    name: Printed
    host: Printed
    #: inline, process or ray.
    executor: Printed
    slots: Annotated[int, Field(ge=0, le=1_000_000)]
    #: `workers.provenance.code_version()`; another one than the coordinator's is refused.
    code_version: Printed
    #: As in "3.11.7"; another minor version than the coordinator's is refused.
    python_version: Annotated[str, Field(pattern=r"^\d{1,3}\.\d{1,3}\.[!-~]{1,40}$")]
    #: Of its process tree, and of its machine; shown to people, and never part of a result.
    cpu_cores: Annotated[float, Field(ge=0, le=1_000_000)] | None = None
    memory_bytes: Count | None = None
    host_memory_bytes: Count | None = None


class ClaimRequest(Message):
    """Asks for jobs that fit into the executor now."""

    worker: WorkerInfo
    n_jobs: Annotated[int, Field(ge=0, le=1000)]
    #: Only those of one campaign.
    campaign_id: RowId | None = None


class ClaimAnswer(Message):
    """Jobs that are the worker's until `lease_s` after this, or after its last heartbeat."""

    claims: tuple[Claim, ...]
    lease_s: float
    #: How often to send a heartbeat.
    heartbeat_s: float


class HeartbeatRequest(Message):
    """All jobs that a worker holds, in one call."""

    worker: WorkerInfo
    held: HeldJobs = ()
    #: Without, leases stay as they are, nothing is written, and only the answer counts.
    extend: bool = True


class HeartbeatAnswer(Message):
    """The state of each held job; those to cancel are extended too, so that they can stop gracefully."""

    extended: tuple[HeldJob, ...] = ()
    to_cancel: tuple[HeldJob, ...] = ()
    #: Lease lost, or finished: stop, and report nothing.
    not_held: tuple[HeldJob, ...] = ()


class CompleteRequest(HeldJob):
    """How an attempt ended."""

    outcome: JobOutcome
    #: `job_digest` of what was claimed, of a report that waited in a file: another archive may have a job of
    #: the same number.
    job_digest: Annotated[str, Field(pattern="^[0-9a-f]{32}$")] | None = None


class HandInRequest(HeldJob):
    """Hops of a chain that an attempt still works on."""

    part: ChainPart


class HandInAnswer(OfAttempt):
    """Where the chain begins if this attempt is lost; later than was handed in if that came twice."""

    next_hop: int


#: The reports of one request, at most.
MOST_REPORTS = 100


class CompleteManyRequest(Message):
    """How several attempts ended."""

    reports: Annotated[tuple[CompleteRequest, ...], Field(min_length=1, max_length=MOST_REPORTS)]


class CompleteAnswer(OfAttempt):
    """The job's state after a report; the same report again gets the same answer."""

    #: The state that the job got by this report.
    state: Literal["done", "queued", "dead", "cancelled"]


class CompleteManyAnswer(Message):
    """The answers to several reports, in their order."""

    answers: tuple[CompleteAnswer, ...]


class Finished(NamedTuple):
    """An attempt that ended, whatever the ending: a `CompleteRequest` whose solves are sealed."""

    ticket: Ticket
    outcome: Sealed[Ended]
    job_digest: str | None = None

    def to_json(self) -> str:
        """Return the request as JSON."""
        return self.ticket.to_json(job_digest=json.dumps(self.job_digest), outcome=self.outcome.to_json())


class HandedIn(NamedTuple):
    """Hops of a chain that an attempt still works on: a `HandInRequest` whose solves are sealed."""

    ticket: Ticket
    part: Sealed[Reached]

    def to_json(self) -> str:
        """Return the request as JSON."""
        return self.ticket.to_json(part=self.part.to_json())


class SourceError(UserError, WorkerError):
    """A source that did not do what it was asked."""


class UnreachableError(SourceError):
    """No answer now; the request may be repeated after `wait_s`."""

    def __init__(self, detail: str, wait_s: float = 0.0, status: int | None = None) -> None:
        super().__init__(detail)
        self.wait_s = wait_s
        #: None where nobody answered.
        self.status = status


class FaultyError(UnreachableError):
    """The source failed on this request, and may fail on it every time."""


class RefusedError(SourceError):
    """The source refuses this worker, because of its token or its version."""


class UnacceptableError(SourceError):
    """A report that the source rejects, however often it is sent."""


class StaleAttemptError(SourceError):
    """A report on an attempt that no longer holds its job, or that another token claimed; nothing changes."""


class JobSource(Protocol):
    """Five calls, each of which may be repeated when its answer got lost, and each raises `SourceError`."""

    def claim(self, request: ClaimRequest) -> ClaimAnswer:
        """Return jobs, which are then this worker's for the time of a lease."""

    def heartbeat(self, request: HeartbeatRequest) -> HeartbeatAnswer:
        """Extend the leases of what is held; return what is to be cancelled, and what is lost."""

    def hand_in(self, part: HandedIn) -> HandInAnswer:
        """Report hops of a chain that goes on."""

    def complete(self, report: Finished) -> CompleteAnswer:
        """Report an outcome."""

    def complete_many(self, reports: Sequence[Finished]) -> CompleteManyAnswer:
        """Report several outcomes; all are taken, or what is raised holds for one of them and none is."""
