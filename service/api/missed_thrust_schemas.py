"""The JSON of a missed-thrust analysis."""

from service.api.schemas import Answer, CampaignState

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
