"""Searches as the API shows them: how one is set up, how far it is, and what became of its solves."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from service.schemas.answer import Answer, CampaignState
from service.schemas.problem import CaseView

SearchState = Literal["waiting", "active", "paused", "done", "cancelled"]


class JobCounts(Answer):
    """How many jobs are in each state."""

    queued: int = 0
    running: int = 0
    done: int = 0
    dead: int = 0
    cancelled: int = 0


class RatioView(Answer):
    """A share of solves with its 95 % interval."""

    value: float | None
    low: float
    high: float


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
    #: Solves that the verifier found feasible at the loose and at the strict tolerance.
    n_paper: int
    n_strict: int
    #: Strict solves over all solves.
    strict_ratio: RatioView
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


#: One group: the fields of a record of core.analysis, parts as field_part; null where there is no number.
MetricsRow = dict[str, str | int | float | None]


class MetricsView(Answer):
    """Statistics of the strategies of a campaign: the tables of its report."""

    campaign_id: int
    by_strategy: list[MetricsRow]
    by_mapping: list[MetricsRow]
    seed_yields: list[MetricsRow]
    seed_chains: list[MetricsRow]
    paired_changes: list[MetricsRow]


class PriorityRequest(BaseModel):
    """Another priority; lower goes first."""

    model_config = ConfigDict(extra="forbid")

    priority: int = Field(ge=-1_000_000, le=1_000_000)


class WeightRequest(BaseModel):
    """Another weight; a search of weight 2 gets twice the processor time of one of weight 1."""

    model_config = ConfigDict(extra="forbid")

    weight: float = Field(ge=1e-3, le=1e6, allow_inf_nan=False)


class LawsView(Answer):
    """How chains draw their starts and their hops, with what a law has by itself written out."""

    guess_law: str
    hop_law: str
    #: Scale of the hop law at the start of a chain, in widths of the bounds.
    width: float
    #: Exponent of its tail, where it has one.
    shape: float | None
    adaptive: bool
    #: Least and greatest width, where it is adaptive.
    width_range: tuple[float, float] | None
    time_hop_probability: float
    #: Rejected hops in a row after which a chain starts afresh.
    max_failures: int


class SeedRules(Answer):
    """Which solutions seed a search, and how they are mapped."""

    #: Name of the search that finds them, and of its campaign if that is another one.
    source: str | None
    campaign: str | None
    #: Instead of a search: the one solution that is mapped.
    solution: str | None
    order: str | None
    limit: int | None
    pairing: str
    tolerance: str
    any_duration: bool
    mapping: list[str]


class BudgetView(Answer):
    """What ends a search, whichever comes first; None where nothing is set."""

    guesses: int | None
    core_seconds: float | None
    solutions: int | None


class SearchDetail(Answer):
    """One search of a campaign."""

    campaign_id: int
    campaign: str
    campaign_state: CampaignState
    id: int
    name: str
    strategy: str
    state: SearchState
    priority: int
    weight: float
    k: int
    seed_k: int | None
    cases: list[CaseView]
    #: Solves per chain; 1 is multistart.
    hops: int
    budget: BudgetView
    #: For chains; None where all guesses come from seeds.
    laws: LawsView | None
    #: For guesses that come from seeds.
    seeds: SeedRules | None
    #: Caps of a solve, before they are scaled by 1 + k.
    solve_cpu_seconds: float
    max_iterations: int | None
    jobs: JobCounts
    n_guesses_planned: int | None
    n_solves: int
    n_paper: int
    n_strict: int
    cpu_seconds: float
    #: The strict solution with the most final mass.
    best_solution_id: str | None
    best_delta_v_km_s: float | None


class SeedOfSearch(Answer):
    """A solution that a search has mapped."""

    id: str
    search: str
    strategy: str
    delta_v_km_s: float
    time_of_flight_days: float


class HopColumns(Answer):
    """Solves, one list per field; all are equally long, and in order of case, chain and hop."""

    id: list[int]
    case: list[int]
    #: Number of the chain in its case; of a mapped seed its place in `seeds`.
    chain: list[int]
    hop: list[int]
    #: accepted, rejected or restarted; None for a mapped seed.
    move: list[str | None]
    #: Width of the hop; None for a guess that was drawn afresh or mapped.
    width: list[float | None]
    mapping: list[str | None]
    ending: list[str]
    status: list[str]
    #: strict, paper, or None where the verifier found it feasible at neither.
    verdict: list[str | None]
    objective_kg: list[float | None]
    delta_v_km_s: list[float | None]
    violation: list[float | None]
    n_iterations: list[int]
    cpu_seconds: list[float]
    solution_id: list[str | None]


class HopsView(Answer):
    """The solves of a search: all, or whole chains drawn evenly from all."""

    solves: HopColumns
    #: The seeds that `chain` counts.
    seeds: list[SeedOfSearch]
    n_shown: int
    n_all: int
    #: What to ask for next with `after`: the id of the latest solve of the archive.
    last: int
