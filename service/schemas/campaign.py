"""Campaigns as the API shows them: lists, progress, history, and what became of an imported file."""

from datetime import datetime
from typing import Any

from service.schemas.answer import Answer, CampaignState
from service.schemas.search import RatioView, SearchView


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
    #: None while it is unknown.
    eta_seconds: float | None
    elapsed_seconds: float
    cpu_seconds: float


class Outcomes(Answer):
    """Solves by how they ended, each counted once."""

    #: Feasible at the strict tolerance, and at the loose one alone.
    strict: int = 0
    paper: int = 0
    infeasible: int = 0
    timeout: int = 0
    numerical: int = 0


class CampaignCard(CampaignItem):
    """A campaign in a list, with how far it is and what it has found."""

    outcomes: Outcomes
    #: Solves planned so far; None while a budget in core seconds or solutions is open.
    n_guesses_planned: int | None
    n_searches: int
    #: The strategies of its searches, in their order, each once.
    strategies: list[str]
    rate_per_min: float
    #: None while it is unknown.
    eta_seconds: float | None
    elapsed_seconds: float
    cpu_seconds: float
    #: Best delta-v so far at moments as far apart as each other, from the start on [km/s].
    sparkline_km_s: list[float | None]
    #: Solves that rate and sparkline are about: fewer than all just after a start.
    n_read: int


class CampaignCards(Answer):
    """Campaigns, the newest first."""

    items: list[CampaignCard]


class OutcomeBinsView(Answer):
    """Solves by outcome and by the time at which they were stored; the first bin begins with the campaign."""

    width_seconds: int
    strict: list[int]
    paper: list[int]
    infeasible: list[int]
    timeout: list[int]
    numerical: list[int]


class StepView(Answer):
    """A solution that was better than all before it of its strategy."""

    #: Spent by the strategy until then, failures included.
    core_hours: float
    delta_v_km_s: float
    solution_id: str


class StrategyView(Answer):
    """What one strategy has spent and found."""

    strategy: str
    k: int
    seed_k: int | None
    n_solves: int
    n_paper: int
    n_strict: int
    paper_ratio: RatioView
    strict_ratio: RatioView
    core_hours: float
    steps: list[StepView]


class ChainView(Answer):
    """What seeds of P_k' gave for P_k; `seed_k` is null where guesses are drawn."""

    seed_k: int | None
    k: int
    #: Different seeds that were tried.
    n_seeds: int
    n_solves: int
    n_strict: int
    strict_ratio: RatioView
    core_seconds_per_strict: float | None


class BoxView(Answer):
    """Delta-v of the different strict solutions of one strategy and duration of outages."""

    strategy: str
    k: int
    duration_days: float | None
    n_solutions: int
    least_km_s: float
    lower_quartile_km_s: float
    median_km_s: float
    upper_quartile_km_s: float
    greatest_km_s: float
    #: Some of them, evenly by rank; all where there are few.
    sample_km_s: list[float]


class HistoryView(Answer):
    """The history of a campaign."""

    campaign_id: int
    #: Solves in all, and those that have been read: fewer just after a start.
    n_solves: int
    n_read: int
    outcomes: OutcomeBinsView
    strategies: list[StrategyView]
    chains: list[ChainView]
    delta_v: list[BoxView]


class ImportView(Answer):
    """A campaign that came as a file; all zero, and no names, if everything was there already."""

    #: That of the campaign that the file is about, as it is called here.
    campaign_id: int
    #: By name, with those that only give seeds.
    new_campaigns: list[str]
    n_solves: int
    n_solutions: int
    n_certificates: int
