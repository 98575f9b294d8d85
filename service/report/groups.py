"""A campaign's solves by strategy, mapping and duration, grouped and summed up once for all sections."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from core.analysis.campaign_statistics import (
    CampaignFacts,
    Findings,
    SolveFacts,
    Summary,
    cost_of,
    findings_of,
    solutions,
    summarized,
)
from core.analysis.metrics import Ratio, Spread, feasibility_ratio, spread
from service.report.estimates import strategy_key

#: Strategy with its mapping, and duration of the outages [days], None where a case mixes durations.
Key = tuple[str, float | None]
#: The mapping of the paper: a strategy without further words uses it.
PAPERS_MAPPING = "reference"


@dataclass(frozen=True, slots=True, eq=False)
class Groups:
    """Everything that several sections ask for."""

    findings: Findings
    #: By number of outages, then without seeds first, then by duration; solves in order of address.
    solves: Mapping[Key, Sequence[SolveFacts]]
    #: Of the same groups, at the strict tolerance.
    summaries: Mapping[Key, Summary]


@dataclass(frozen=True, slots=True)
class Tally:
    """The part of a summary that takes one look at the solves: for groups as many as cases."""

    n_solves: int
    n_paper: int
    n_strict: int
    paper_ratio: Ratio
    strict_ratio: Ratio
    core_hours: float
    #: Of strict solutions; delta-v of the transfer.
    delta_v_km_s: Spread
    propellant_kg: Spread


def tally_of(solves: Sequence[SolveFacts]) -> Tally:
    """Return counts, ratios, cost and spreads of a group of solves."""
    found = solutions(solves, "strict")
    n_solves, n_paper, n_strict = len(solves), len(solutions(solves, "paper")), len(found)
    return Tally(
        n_solves=n_solves,
        n_paper=n_paper,
        n_strict=n_strict,
        paper_ratio=feasibility_ratio(n_paper, n_solves),
        strict_ratio=feasibility_ratio(n_strict, n_solves),
        core_hours=cost_of(solves).core_hours,
        delta_v_km_s=spread([v for one in found if (v := one.delta_v_km_s) is not None]),
        propellant_kg=spread([v for one in found if (v := one.propellant_kg) is not None]),
    )


def groups_of(facts: CampaignFacts) -> Groups:
    """Return the groups of a campaign."""
    findings = findings_of(facts)
    solves = _by_strategy(facts.solves)
    summaries = {key: replace(summarized(findings, group), strategy=key[0]) for key, group in solves.items()}
    return Groups(findings, solves, summaries)


def labelled(strategy: str, mapping: str | None) -> str:
    """Return a strategy with the form of its mapping, unless that is the paper's own.

    What the paper did not do has another name than what it did, and gets none of its numbers.
    """
    if mapping is None or mapping == PAPERS_MAPPING:
        return strategy
    form, _, sources = mapping.partition("(")
    return f"{strategy} {form}{' from realizations' if sources and form == PAPERS_MAPPING else ''}"


def _by_strategy(solves: Iterable[SolveFacts]) -> dict[Key, list[SolveFacts]]:
    found: dict[Key, list[SolveFacts]] = {}
    # A hundred thousand solves have some dozen cases: each is asked for its duration once.
    durations: dict[tuple[tuple[int, float], ...], float | None] = {}
    for solve in solves:
        if solve.outages not in durations:
            durations[solve.outages] = solve.duration_days
        label = labelled(solve.strategy, solve.mapping)
        found.setdefault((label, durations[solve.outages]), []).append(solve)
    ordered = sorted(found, key=lambda key: (*strategy_key(key[0]), key[0], key[1] or 0.0))
    return {key: found[key] for key in ordered}
