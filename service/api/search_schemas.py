"""The JSON of one search: how it is set up, how far it is, and what became of its solves."""

from service.api.schemas import Answer, CampaignState, CaseView, JobCounts, SearchState


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
