"""The JSON of the API: every answer of a route is one of these, and the CLI prints the same.

Units stand in the names; epochs are TDB calendar text, `created_at` is UTC.
"""

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

#: Rows of defects: one per trajectory, (x, y, z) [km], (vx, vy, vz) [km/s], m [kg].
Defects = list[list[float]]
SearchState = Literal["waiting", "active", "paused", "done", "cancelled"]
CampaignState = Literal["active", "paused", "done", "cancelled"]
JobState = Literal["queued", "running", "done", "dead", "cancelled"]
Ending = Literal["feasible", "infeasible", "numerical", "timeout", "error", "crash", "lost", "cancelled"]


class Answer(BaseModel):
    """A body that the service sends."""

    model_config = ConfigDict(from_attributes=True, ser_json_inf_nan="null")


class Fault(Answer):
    """A refusal as `application/problem+json` (RFC 9457)."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str
    #: What a program reads where the status leaves open what was wrong, as "stale_attempt".
    code: str | None = None


class OutageView(Answer):
    """One interval without thrust."""

    segment: int
    duration_days: float


class CaseView(Answer):
    """One of the problems that a search is about."""

    problem_hash: str
    outages: list[OutageView]


class JobCounts(Answer):
    """How many jobs are in each state."""

    queued: int = 0
    running: int = 0
    done: int = 0
    dead: int = 0
    cancelled: int = 0


class SearchView(Answer):
    """A search and how far it is."""

    #: Row id; `name` is the id of the campaign's specification.
    id: int
    name: str
    strategy: str
    state: SearchState
    #: Lower goes first; those of equal priority share the workers by weight.
    priority: int
    weight: float
    k: int
    #: The problems that it is about.
    cases: list[CaseView]
    #: The mappings of its seeds, separated by commas.
    mapping: str | None
    #: Name of the search that the seeds come from.
    seeds_from: str | None
    #: Solves per chain; with one there is nothing to hop from.
    hops: int
    jobs: JobCounts
    #: Solves planned so far; None while a budget in core seconds or solutions is open.
    n_guesses_planned: int | None
    n_solves: int
    #: Solves that the verifier found feasible at the paper's and at the strict tolerance.
    n_paper: int
    n_strict: int
    #: Different solutions in the archive.
    n_solutions: int
    endings: dict[str, int]
    #: Solves by name of their `core.nlp.ExitStatus`.
    statuses: dict[str, int]
    best_solution_id: str | None
    best_delta_v_km_s: float | None
    best_propellant_kg: float | None
    best_final_mass_kg: float | None
    cpu_seconds: float


class CampaignItem(Answer):
    """A campaign in a list."""

    id: int
    name: str
    state: CampaignState
    #: Lower goes first.
    priority: int
    created_at: datetime
    finished_at: datetime | None
    rng_seed: int
    n_jobs: int
    #: Jobs that ended: done, dead or cancelled.
    n_done: int
    n_solves: int
    n_solutions: int
    best_delta_v_km_s: float | None


class CampaignView(CampaignItem):
    """A campaign with its searches."""

    #: The reference problem P_0 with every field written out.
    problem: dict[str, Any]
    searches: list[SearchView]
    rate_per_min: float
    #: None while it cannot be told.
    eta_seconds: float | None
    elapsed_seconds: float
    cpu_seconds: float


#: One group: the fields of a record of core.analysis, parts as field_part; null where there is no number.
MetricsRow = dict[str, str | int | float | None]


class MetricsView(Answer):
    """What the strategies of a campaign are worth: the tables of its report."""

    campaign_id: int
    by_strategy: list[MetricsRow]
    by_mapping: list[MetricsRow]
    seed_yields: list[MetricsRow]
    seed_chains: list[MetricsRow]
    paired_changes: list[MetricsRow]


class Record(Answer):
    """A solution with all that is needed to judge and to reproduce it."""

    id: str = Field(description="Solution hash: problem hash and bytes of x")
    campaign_id: int
    search_id: int
    search: str
    strategy: str
    problem_hash: str
    k: int
    outages: list[OutageView]
    #: Final mass of the reference [kg], which is maximised.
    objective_kg: float
    propellant_kg: float
    delta_v_km_s: float
    delta_v_total_km_s: float
    shooting_days: float
    initial_coast_days: float
    final_coast_days: float
    time_of_flight_days: float
    arrival_epoch: str
    insertion_epoch: str
    defects_solved: Defects
    defects_verified: Defects
    paper: bool
    strict: bool
    status: str
    n_iterations: int
    n_evaluations: int
    cpu_seconds: float
    wall_seconds: float
    #: rng_seed/kind/search/case/chain/hop: all that the generator of the guess was made from.
    rng_key: str
    seed_id: str | None
    mapping: str | None
    code_version: str
    package_versions: dict[str, str]
    kernel_hashes: dict[str, str]
    host: str
    created_at: datetime
    #: Whether the level differs with the tolerance of the verifier's integrator, and is the lower of the two;
    #: null where that was not asked yet.
    is_marginal: bool | None = None
    #: Lowest that any of its trajectories passes the surface [km]; null where that was not looked at yet.
    earth_altitude_km: float | None = None
    moon_altitude_km: float | None = None


class RecordWithVector(Record):
    """A record and its decision vector."""

    x: list[float] = Field(description="Paper layout: days, throttle [-], angles [rad], kg")
    #: How the re-flight was done: integrator, tolerance, target error, closest approaches.
    verification: dict[str, Any]


class RecordPage(Answer):
    """Solutions in order of delta-v; `next` is the `after` of the next page."""

    items: list[Record]
    next: str | None


class LineageNode(Answer):
    """A solution in a lineage."""

    id: str
    search: str
    strategy: str
    k: int
    delta_v_km_s: float
    strict: bool


class LineageEdge(Answer):
    """`seed_id` was mapped to the guess that became `solution_id`."""

    seed_id: str
    solution_id: str
    mapping: str


class Lineage(Answer):
    """All seeds behind a solution."""

    id: str
    nodes: list[LineageNode]
    edges: list[LineageEdge]


class ProblemItem(Answer):
    """A problem in a list."""

    hash: str
    k: int
    outages: list[OutageView]
    n_segments: int


class ProblemView(ProblemItem):
    """A problem with every field written out."""

    definition: dict[str, Any]


class ProblemPage(Answer):
    """Problems."""

    items: list[ProblemItem]


class PriorityWanted(BaseModel):
    """Another priority; lower goes first."""

    model_config = ConfigDict(extra="forbid")

    priority: int = Field(ge=-1_000_000, le=1_000_000)


class WeightWanted(BaseModel):
    """Another weight; a search of weight 2 gets twice the processor time of one of weight 1."""

    model_config = ConfigDict(extra="forbid")

    weight: float = Field(ge=1e-3, le=1e6, allow_inf_nan=False)


class SeedView(Answer):
    """A solution that would seed a problem, and how."""

    seed_id: str
    seed_problem_hash: str
    seed_outages: list[OutageView]
    delta_v_km_s: float
    time_of_flight_days: float
    strict: bool
    #: The case that it would be mapped to: its problem and its outages.
    problem_hash: str
    outages: list[OutageView]
    #: The one concrete mapping.
    mapping: str
    #: The job that does it, where a search is asked about and has planned it.
    job_id: int | None = None
    job_state: JobState | None = None


class SeedPage(Answer):
    """Seeds in the order in which they would be mapped."""

    items: list[SeedView]
    #: Solutions that may be seeds, before the limit.
    n_candidates: int
    #: Whether there are more pairs of seed and mapping than are listed.
    is_cut: bool


class JobView(Answer):
    """A job: a block of hops of one chain, or one seed mapped and solved."""

    id: int
    campaign_id: int
    search_id: int
    #: Its name.
    search: str
    kind: Literal["hop", "map"]
    state: JobState
    attempt: int
    n_failures: int
    #: Waits until then after a failure.
    not_before: datetime | None
    #: Who holds it, and until when if it sends no heartbeat.
    worker: str | None
    lease_until: datetime | None
    #: To be stopped by its worker.
    is_cancelling: bool
    ending: Ending | None
    #: The first line of what went wrong, for endings `error` and `crash`.
    error: str | None
    n_hops: int
    seed_id: str | None
    created_at: datetime
    updated_at: datetime


class JobPage(Answer):
    """Jobs in order of id; `next` is the `after` of the next page."""

    items: list[JobView]
    next: int | None


class HeldView(Answer):
    """A job that a worker holds."""

    job_id: int
    attempt: int
    lease_until: datetime


class WorkerView(Answer):
    """A dispatcher with its executor, as it described itself last."""

    name: str
    host: str
    executor: str
    slots: int
    code_version: str
    python_version: str
    #: Processors that its processes keep busy, and their memory, where it measures that.
    cpu_cores: float | None
    memory_bytes: int | None
    #: All that its machine has.
    host_memory_bytes: int | None
    created_at: datetime
    seen_at: datetime
    #: Whether it was seen within the time of a lease.
    is_alive: bool
    held: list[HeldView]


class WorkerPage(Answer):
    """Workers, those seen last first."""

    items: list[WorkerView]


class EventView(Answer):
    """Something that happened; `id` grows."""

    id: int
    campaign_id: int
    kind: Literal["job", "solution", "search", "campaign"]
    created_at: datetime
    data: dict[str, Any]


class EventPage(Answer):
    """Events in order of id."""

    items: list[EventView]


class Health(Answer):
    """Whether the service is alive, or ready, and the reason if not."""

    status: Literal["ok", "unavailable"]
    checks: dict[str, str]
