"""Solutions as the API shows them: records, points, clusters, lineage, seeds and missed-thrust analyses."""

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from service.schemas.answer import Answer, CampaignState
from service.schemas.job import JobState
from service.schemas.problem import OutageView
from workers.messages import Job

#: Rows of defects: one per trajectory, (x, y, z) [km], (vx, vy, vz) [km/s], m [kg].
Defects = list[list[float]]


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


class RecordInFull(RecordWithVector):
    """A record, its decision vector, and whether it was certified."""

    #: Hash of the certificate that was found last, null where there is none.
    certificate_hash: str | None


class PointsView(Answer):
    """Solutions as points: columns of equal length, in order of id."""

    #: Solutions of the filter; more than there are points if they are a sample.
    n: int
    #: Places of those that none beats in both delta-v and time of flight, in order of delta-v.
    front: list[int]
    #: What `strategy` counts, from 0.
    strategies: list[str]
    id: list[str]
    strategy: list[int]
    k: list[int]
    strict: list[bool]
    delta_v_km_s: list[float]
    time_of_flight_days: list[float]
    initial_coast_days: list[float]
    shooting_days: list[float]
    final_coast_days: list[float]
    propellant_kg: list[float]
    cpu_seconds: list[float]


class ClusterView(Answer):
    """Solutions whose references are alike."""

    #: The one with the least delta-v, which the others are near to.
    best_id: str
    size: int
    #: How many of each strategy.
    strategies: dict[str, int]
    min_delta_v_km_s: float
    max_delta_v_km_s: float
    min_time_of_flight_days: float
    max_time_of_flight_days: float
    #: Mean and greatest scaled distance from the best.
    mean_distance: float
    max_distance: float


class ClusterPage(Answer):
    """The clusters with the least delta-v first."""

    items: list[ClusterView]
    n_clusters: int
    #: Solutions of the filter, and how many of them, the best, were compared.
    n: int
    n_compared: int
    #: Largest distance from the best of a cluster.
    threshold: float = Field(description="Scaled distance of docs/method.md, 0.05 where not asked otherwise")


class CampaignChoice(Answer):
    """A campaign by its name."""

    id: int
    name: str


class ChoicesView(Answer):
    """What a filter of solutions can be set to."""

    campaigns: list[CampaignChoice]
    searches: list[str]
    strategies: list[str]
    k: list[int]
    segments: list[int]
    durations_days: list[float]


class Child(LineageNode):
    """A solution that was found from this one as its seed."""

    mapping: str


class LineageGraph(Lineage):
    """All seeds behind a solution, and the solutions that it seeded itself."""

    #: The ones of most final mass, at most as many as were asked for.
    children: list[Child]
    #: All of them; one found by two mappings counts twice.
    n_children: int
    #: Solves that started from it, whatever came of them.
    n_mapped: int
    #: What runs its job again on this machine and compares every bit.
    command: str


class Reproduction(Answer):
    """The job that found a solution, as it was handed out, and what it gave."""

    id: str
    problem_hash: str
    job: Job
    #: The hop of the job that found it.
    hop: int
    x: list[float] = Field(description="Paper layout: days, throttle [-], angles [rad], kg")
    #: Name of the `core.nlp.ExitStatus` with which the solve ended.
    status: str
    cpu_seconds: float
    code_version: str
    python_version: str
    package_versions: dict[str, str]
    kernel_hashes: dict[str, str]
    host: str


#: Rows are segments, columns durations; null where there is no recovery, or nothing was tried yet.
Map = list[list[float | None]]


class SegmentRisk(Answer):
    """What outages that begin with one segment do."""

    segment: int
    #: When it begins, past departure.
    start_days: float
    #: Of the reference.
    throttle: float
    #: The longest outage with a recovery; 0 without one.
    longest_days: float
    #: Whether that is the longest of all that were tried, so that longer ones may have one too.
    is_open: bool
    #: That the one safe mode of the transfer begins in this very segment and has no recovery.
    lost_probability: float
    #: Whether it thrusts and does not take an outage of median length.
    is_fragile: bool


class SurvivabilityView(Answer):
    """Probabilities until the end of the last segment, by the Weibull laws of docs/method.md."""

    arc_days: float
    #: No safe mode, exactly one, and more, which no analysis of single outages covers.
    none: float
    one: float
    several: float
    #: A recovery, given exactly one: with the outages that were tried, and if those beyond do no harm either.
    recovered_given_one_least: float
    recovered_given_one_most: float
    #: None, or one with a recovery.
    survived_least: float
    survived_most: float


class MissedThrustView(Answer):
    """How one solution takes outages, its reference frozen; so far, while its campaign is active."""

    solution_id: str
    k: int
    campaign_id: int
    campaign_state: CampaignState
    #: Of its jobs: ended, and all that are planned.
    n_done: int
    n_jobs: int
    cpu_seconds: float
    final_mass_kg: float
    #: End of the reference's last burn, past departure.
    arrival_days: float
    #: Throttle of the reference in every segment, tried or not.
    throttles: list[float]
    durations_days: list[float]
    segments: list[SegmentRisk]
    #: Propellant beyond the reference's, and delay of the last burn's end, of the cheapest recovery.
    propellant_kg: Map
    delay_days: Map
    is_tried: list[list[bool]]
    #: Fragile segments, the weakest first.
    fragile: list[int]
    survivability: SurvivabilityView


class MissedThrustPage(Answer):
    """The missed-thrust analyses of a solution that have tried something, the newest first."""

    items: list[MissedThrustView]


Tolerance = Literal["strict", "paper", "all"]
_Id = Annotated[int, Field(ge=1, lt=2**63)]
_Bound = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]

#: Numbers of a solution that have a least and a most, as min_ and max_ of their names.
RANGES = (
    "delta_v_km_s",
    "time_of_flight_days",
    "initial_coast_days",
    "shooting_days",
    "final_coast_days",
    "propellant_kg",
    "k",
    "cpu_seconds",
)


class Filter(BaseModel):
    """What is None does not restrict; an outage is one with both the segment and the duration."""

    model_config = ConfigDict(frozen=True)

    campaign: _Id | None = Field(default=None, description="Id of a campaign")
    search: str | None = Field(default=None, max_length=80, description="Name of a search")
    strategy: str | None = Field(default=None, pattern=r"^S\(\d{1,3}(\|\d{1,3})?\)$", description="As S(1|0)")
    k: int | None = Field(default=None, ge=0, le=1000, description="Number of outages survived")
    segment: int | None = Field(
        default=None, ge=1, le=2000, description="Of an outage: the segment that it misses"
    )
    duration_days: float | None = Field(
        default=None, gt=0, le=1000, allow_inf_nan=False, description="Of the same outage: its length [d]"
    )
    tolerance: Tolerance = Field(default="all", description="What is strict is good at the paper's as well")
    strict: bool | None = Field(default=None, description="Only those that are, or are not, strict")
    min_delta_v_km_s: _Bound | None = None
    max_delta_v_km_s: _Bound | None = None
    min_time_of_flight_days: _Bound | None = None
    max_time_of_flight_days: _Bound | None = None
    min_initial_coast_days: _Bound | None = None
    max_initial_coast_days: _Bound | None = None
    min_shooting_days: _Bound | None = None
    max_shooting_days: _Bound | None = None
    min_final_coast_days: _Bound | None = None
    max_final_coast_days: _Bound | None = None
    min_propellant_kg: _Bound | None = None
    max_propellant_kg: _Bound | None = None
    min_k: _Bound | None = None
    max_k: _Bound | None = None
    min_cpu_seconds: _Bound | None = None
    max_cpu_seconds: _Bound | None = None

    def levels(self) -> set[tuple[str, bool]]:
        """Return tolerances that a solution has to hold, or not; `strict` is `tolerance` where it is true."""
        found: set[tuple[str, bool]] = set() if self.tolerance == "all" else {(self.tolerance, True)}
        return found if self.strict is None else found | {("strict", self.strict)}
