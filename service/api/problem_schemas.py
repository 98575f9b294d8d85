"""What a problem looks like: its matrix, its outages and how likely they are; and its relatives."""

from typing import Literal

from service.api.schemas import Answer, OutageView


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
