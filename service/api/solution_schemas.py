"""The JSON of one solution in full, and of many at once: points, clusters, and what can be chosen between."""

from pydantic import Field

from service.api.schemas import Answer, RecordWithVector


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
