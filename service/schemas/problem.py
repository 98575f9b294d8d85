"""Problems and specifications as the API shows them: sizes, outages, relatives, planned jobs."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from service.schemas.answer import Answer


class OutageView(Answer):
    """One interval without thrust."""

    segment: int
    duration_days: float


class CaseView(Answer):
    """One of the problems that a search is about."""

    problem_hash: str
    outages: list[OutageView]


class ProblemItem(Answer):
    """A problem in a list."""

    hash: str
    k: int
    outages: list[OutageView]
    n_segments: int


class ToleranceView(Answer):
    """Largest norms of the defects of a trajectory that counts as closed."""

    position_km: float
    velocity_km_s: float
    mass_kg: float


class WorldView(Answer):
    """What a problem flies in, by the names that people read."""

    center: str
    #: Those that pull besides.
    bodies: list[str]
    #: Units of the numerics.
    length_km: float
    time_days: float
    mass_kg: float
    strict: ToleranceView
    loose: ToleranceView


class ProblemView(ProblemItem):
    """A problem with every field written out."""

    definition: dict[str, Any]
    world: WorldView


class ProblemPage(Answer):
    """Problems."""

    items: list[ProblemItem]


class TrajectoryShape(Answer):
    """One trajectory of a problem: the reference, or the realization of an outage."""

    #: None for the reference.
    outage: OutageView | None
    n_segments: int
    #: Its first column in the Jacobian, and how many it has of its own.
    first_variable: int
    n_variables: int
    #: The segment, from 1, at whose start its halves meet.
    matchpoint: int
    #: The half of the reference that it leaves; None for the reference.
    leaves: Literal["forward", "backward"] | None


class LawView(Answer):
    """A Weibull law of a time."""

    scale_days: float
    shape: float
    mean_days: float
    median_days: float


class ArcChance(Answer):
    """How likely it is that none, exactly one, or several safe modes begin on an arc."""

    arc_days: float
    none: float
    one: float
    several: float


class DurationChance(Answer):
    """How likely it is that an outage lasts at most so long."""

    days: float
    at_most: float


class ProblemStructure(Answer):
    """All that follows from the definition of a problem alone, and so never changes."""

    hash: str
    n_variables: int
    n_defects: int
    #: Entries of the Jacobian that are stored, and with mass rows as dense as the others.
    n_nonzeros: int
    n_dense: int
    trajectories: list[TrajectoryShape]
    #: Stored entries as (row, first column, number of columns).
    runs: list[tuple[int, int, int]]
    #: Gaps of up to so many columns in a row are drawn filled, so that there are at most 5000 runs.
    filled_gap: int
    #: Where the transfer begins: end of the spiral, or the given state.
    departure_epoch: str
    departure_mass_kg: float
    #: Laws of the time between safe modes, and of the duration of the outage that one causes.
    between: LawView
    recovery: LawView
    #: For arcs up to the longest that the bounds allow, T_i + T_s.
    chances: list[ArcChance]
    #: For outages of the problem and some more, in order.
    durations: list[DurationChance]


class BestSolution(Answer):
    """One of the best solutions of a problem."""

    id: str
    campaign_id: int
    search: str
    strategy: str
    objective_kg: float
    propellant_kg: float
    delta_v_km_s: float
    shooting_days: float
    initial_coast_days: float
    time_of_flight_days: float
    strict: bool


class Relative(Answer):
    """A problem with one outage more or less, and the same otherwise."""

    hash: str
    k: int
    outages: list[OutageView]
    #: The outage that only one of the two has.
    outage: OutageView
    n_solutions: int
    best_delta_v_km_s: float | None


class ProblemFamily(Answer):
    """What was found for a problem, and for those that differ in one outage."""

    n_solutions: int
    #: The ones of most final mass.
    best: list[BestSolution]
    #: At most 50 each, those of early outages first; `n_fewer` and `n_more` count all.
    fewer: list[Relative]
    more: list[Relative]
    n_fewer: int
    n_more: int


class SpecToCheck(BaseModel):
    """A specification as somebody writes it."""

    model_config = ConfigDict(extra="forbid")

    #: TOML, or JSON if it begins with a brace.
    text: str = Field(max_length=400_000)


class FaultView(Answer):
    """An error in a specification."""

    #: Names, and places in lists from 0 on, as in search.1.strategy; empty where it is about the whole.
    path: str
    #: Counted from 1; null where the text says nothing about it.
    line: int | None
    message: str


class PlannedSearch(Answer):
    """What one search will do."""

    id: str
    strategy: str
    n_cases: int
    #: At most; null where a budget in core seconds or solutions is the only bound.
    n_guesses_most: int | None
    #: Time that all of its solves are allowed; null where their number is open.
    core_hours_most: float | None
    seeds_from: str | None


class SpecPlan(Answer):
    """What would be run."""

    name: str
    rng_seed: int
    n_segments: int
    searches: list[PlannedSearch]
    n_cases: int
    n_guesses_most: int | None
    core_hours_most: float | None


class SpecCheck(Answer):
    """Faults, or the fields to submit and what would be run."""

    faults: list[FaultView]
    #: What `POST /campaigns` takes; null while there are faults.
    fields: dict[str, Any] | None
    plan: SpecPlan | None
    #: What to know before it is run: thrust that cannot suffice, and untested ground.
    remarks: list[str]


class SpecText(Answer):
    """The specification of a campaign, or one to begin with."""

    name: str
    toml: str


class SpecTemplates(Answer):
    """Specifications to begin with."""

    items: list[SpecText]
