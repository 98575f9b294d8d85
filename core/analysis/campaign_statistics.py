"""Statistics of a campaign: solves in groups, each with its ratios, costs, distinct solutions and delta-v.

Everything is computed from stored facts; nothing is propagated or solved.  Masses in kg, delta-v in km/s.
Undefined values (a cost without solutions, the mean of an empty group) are NaN in the records and None in
the rows made of them.  docs/method.md, section 9.
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from math import isfinite, nan
from operator import attrgetter
from typing import Any, NamedTuple, TypeVar

from core.analysis.campaign_facts import CampaignFacts, Level, SolveFacts
from core.analysis.metrics import Ratio, Spread, feasibility_ratio, spread
from core.analysis.similarity import DISTINCT, Array, clusters, feature_rows

_T = TypeVar("_T")

#: The paper's flat charge per guess [core-hours for P_0; P_k costs 1 + k times as much].
CHARGE_HOURS = 0.5
#: Attributes of `SolveFacts` that make the groups of the main table.
BY_STRATEGY = ("strategy", "duration_days")
_SECONDS_PER_HOUR = 3600.0


class Cost(NamedTuple):
    """A cost by three measures, failures included."""

    #: CPU time spent.
    core_hours: float
    #: CPU limits of the solves.
    cap_hours: float
    #: The paper's charge, 0.5 h (1 + k) per guess.
    charged_hours: float

    def per(self, n: int) -> "Cost":
        """Return a total per solution, NaN without solutions; eq. (M1)."""
        return Cost(*(hours / n if n else nan for hours in self))

    def rate(self, n: int | None) -> float:
        """Return n per core-hour spent, NaN where either is unknown."""
        return nan if n is None or not self.core_hours else n / self.core_hours


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """The facts of a campaign, with indices of its solutions."""

    facts: CampaignFacts
    #: The solve that first found each solution, by solution id.
    found_by: Mapping[str, SolveFacts]
    #: Row of each solution in the features, by solution id.
    row_of: Mapping[str, int]
    #: (n_solutions, 2 + 3 N) features of the references [-].
    features: Array


@dataclass(frozen=True, slots=True)
class Summary:
    """A group of solves; an attribute in which its solves differ is None."""

    search: str | None
    strategy: str | None
    duration_days: float | None
    mapping: str | None
    #: Segments of the outages, as in "4-48"; empty for P_0.
    case: str | None
    #: Tolerance that distinct solutions, delta-v and propellant are counted at.
    level: Level
    n_cases: int
    n_solves: int
    n_paper: int
    n_strict: int
    paper_ratio: Ratio
    strict_ratio: Ratio
    #: Of all its solves, and of each solution.
    cost: Cost
    cost_per_paper: Cost
    cost_per_strict: Cost
    #: Clusters of references, counted within each case, and clusters per core-hour spent; None
    #: and NaN where the facts are without vectors.
    n_distinct: int | None
    distinct_per_core_hour: float
    #: Of the transfer, then with the spiral.
    delta_v_km_s: Spread
    delta_v_total_km_s: Spread
    propellant_kg: Spread


@dataclass(frozen=True, slots=True)
class SeedYield:
    """What the seeds of P_k' gave for P_k, all durations and mappings together unless grouped."""

    #: k' of the seeds; None where guesses were drawn.
    seed_k: int | None
    k: int
    #: Different seeds that were used.
    n_seeds: int
    n_solves: int
    n_paper: int
    n_strict: int
    strict_ratio: Ratio
    #: CPU time per strict solution [s].
    core_seconds_per_strict: float


def findings_of(facts: CampaignFacts) -> Findings:
    """Return the facts of a campaign, with indices of its solutions.

    Parameters
    ----------
    facts : CampaignFacts
        Solves in order of address; `vectors` holds all solutions to be compared for distinctness, or none.
    """
    found_by: dict[str, SolveFacts] = {}
    for solve in facts.solves:
        if solve.solution_id is not None:
            found_by.setdefault(solve.solution_id, solve)
    row_of = {name: row for row, name in enumerate(facts.vectors)}
    return Findings(facts, found_by, row_of, feature_rows(facts.problem, list(facts.vectors.values())))


def group_solves(
    solves: Iterable[SolveFacts], by: Sequence[str] = BY_STRATEGY
) -> dict[tuple[Hashable, ...], list[SolveFacts]]:
    """Group solves by the values of some of their attributes, groups and members in the given order.

    Parameters
    ----------
    solves : iterable of SolveFacts
        In order of address.
    by : sequence of str
        Attributes of `SolveFacts`: search, strategy, duration_days, mapping, outages and so on.
    """
    groups: dict[tuple[Hashable, ...], list[SolveFacts]] = {}
    values_of = attrgetter(*by)
    for solve in solves:
        values = values_of(solve)
        groups.setdefault(values if len(by) > 1 else (values,), []).append(solve)
    return groups


def summaries(
    findings: Findings, by: Sequence[str] = BY_STRATEGY, level: Level = "strict"
) -> tuple[Summary, ...]:
    """Return the summary of each group of a campaign's solves.

    Parameters
    ----------
    findings : Findings
        Of the campaign.
    by : sequence of str
        Attributes of `SolveFacts` that make the groups.
    level : "paper" or "strict"
        Tolerance of the solutions whose delta-v and distinctness are computed.
    """
    return tuple(
        summarize(findings, group, level) for group in group_solves(findings.facts.solves, by).values()
    )


def summarize(findings: Findings, solves: Sequence[SolveFacts], level: Level = "strict") -> Summary:
    """Return the summary of one group of solves, which may be empty.

    Parameters
    ----------
    findings : Findings
        Of the campaign that the solves belong to.
    solves : sequence of SolveFacts
        In order of address.
    level : "paper" or "strict"
        Tolerance of the solutions whose delta-v and distinctness are computed.

    References
    ----------
    docs/method.md, "Metrics".
    """
    n_paper, n_strict = len(solutions(solves, "paper")), len(solutions(solves, "strict"))
    cost, found = cost_of(solves), solutions(solves, level)
    is_complete = bool(findings.row_of) or not findings.found_by
    n_distinct = count_distinct(findings, found) if is_complete else None
    return Summary(
        **columns_of_group(solves),
        level=level,
        n_cases=len({solve.outages for solve in solves}),
        n_solves=len(solves),
        n_paper=n_paper,
        n_strict=n_strict,
        paper_ratio=feasibility_ratio(n_paper, len(solves)),
        strict_ratio=feasibility_ratio(n_strict, len(solves)),
        cost=cost,
        cost_per_paper=cost.per(n_paper),
        cost_per_strict=cost.per(n_strict),
        n_distinct=n_distinct,
        distinct_per_core_hour=cost.rate(n_distinct),
        delta_v_km_s=spread([v for one in found if (v := one.delta_v_km_s) is not None]),
        delta_v_total_km_s=spread([v for one in found if (v := one.delta_v_total_km_s) is not None]),
        propellant_kg=spread([v for one in found if (v := one.propellant_kg) is not None]),
    )


def solutions(solves: Iterable[SolveFacts], level: Level) -> list[SolveFacts]:
    """Return the solves that found a solution at a level, in their order.

    Parameters
    ----------
    solves : iterable of SolveFacts
        In order of address.
    level : "paper" or "strict"
        Tolerance.
    """
    return [solve for solve in solves if (solve.strict if level == "strict" else solve.paper)]


def cost_of(solves: Sequence[SolveFacts]) -> Cost:
    """Return the total cost of solves.

    Parameters
    ----------
    solves : sequence of SolveFacts
        Failures included.
    """
    return Cost(
        sum(solve.cpu_seconds for solve in solves) / _SECONDS_PER_HOUR,
        sum(solve.cap_seconds for solve in solves) / _SECONDS_PER_HOUR,
        sum(CHARGE_HOURS * (1 + solve.k) for solve in solves),
    )


def count_distinct(findings: Findings, found: Iterable[SolveFacts], threshold: float = DISTINCT) -> int:
    """Count distinct solutions, eqs. (M2) and (M3); those of different cases are always distinct.

    Parameters
    ----------
    findings : Findings
        Has their references.
    found : iterable of SolveFacts
        Solves with a solution, in order of address.
    threshold : float
        Largest distance of solutions that count as one [-].

    References
    ----------
    docs/method.md, "Metrics".
    """
    by_case: dict[tuple[tuple[int, float], ...], list[int]] = {}
    for solve in found:
        if solve.solution_id is not None:
            by_case.setdefault(solve.outages, []).append(findings.row_of[solve.solution_id])
    found_clusters = (clusters(findings.features[rows], threshold) for rows in by_case.values())
    return sum(int(numbers.max()) + 1 for numbers in found_clusters)


def seed_yields(solves: Iterable[SolveFacts]) -> tuple[SeedYield, ...]:
    """Return the matrix of yields, one entry for each pair k' -> k that occurs, in order of k' and k.

    Parameters
    ----------
    solves : iterable of SolveFacts
        Of a campaign, or of one duration or mapping of it.
    """
    groups = group_solves(solves, ("seed_k", "k"))
    found = [_seed_yield(group) for group in groups.values()]
    return tuple(sorted(found, key=lambda one: (-1 if one.seed_k is None else one.seed_k, one.k)))


def _seed_yield(solves: Sequence[SolveFacts]) -> SeedYield:
    n_strict = len(solutions(solves, "strict"))
    return SeedYield(
        seed_k=solves[0].seed_k,
        k=solves[0].k,
        n_seeds=len({solve.seed_id for solve in solves} - {None}),
        n_solves=len(solves),
        n_paper=len(solutions(solves, "paper")),
        n_strict=n_strict,
        strict_ratio=feasibility_ratio(n_strict, len(solves)),
        core_seconds_per_strict=cost_of(solves).per(n_strict).core_hours * _SECONDS_PER_HOUR,
    )


def case_name(outages: Sequence[tuple[int, float]]) -> str:
    """Return the segments of the outages of a case, as in "4-48"; with durations where they differ.

    Parameters
    ----------
    outages : sequence of (int, float)
        Segment and duration [d] of each.
    """
    is_even = len({duration for _, duration in outages}) <= 1
    return "-".join(f"{segment}" if is_even else f"{segment}:{days:g}d" for segment, days in outages)


def columns_of_group(solves: Sequence[SolveFacts]) -> dict[str, Any]:
    """Return the columns that identify a group, None where its solves differ.

    Parameters
    ----------
    solves : sequence of SolveFacts
        The group.
    """
    return {
        "search": shared(solve.search for solve in solves),
        "strategy": shared(solve.strategy for solve in solves),
        "duration_days": shared(solve.duration_days for solve in solves),
        "mapping": shared(solve.mapping for solve in solves),
        "case": shared(case_name(solve.outages) for solve in solves),
    }


def shared(values: Iterable[_T]) -> _T | None:
    """Return the common value, or None if the values differ or there are none.

    Parameters
    ----------
    values : iterable
        Anything that can be hashed.
    """
    different = set(values)
    return different.pop() if len(different) == 1 else None


def row(record: Any, prefix: str = "") -> dict[str, str | int | float | None]:
    """Return a record as one row of a table: nested fields as "field_part", NaN and infinities as None.

    Parameters
    ----------
    record : dataclass or named tuple
        Of this package, such as `Summary`.
    prefix : str
        Goes before every name.
    """
    names = [field.name for field in fields(record)] if is_dataclass(record) else list(record._fields)
    cells: dict[str, str | int | float | None] = {}
    for name in names:
        value = getattr(record, name)
        if is_dataclass(value) or hasattr(value, "_fields"):
            cells |= row(value, f"{prefix}{name}_")
        else:
            # The value of a ratio has the name of its field.
            key = f"{prefix}{name}".removesuffix("_value")
            cells[key] = None if isinstance(value, float) and not isfinite(value) else value
    return cells
