"""A campaign's solves by strategy and duration, grouped and summed up once for all sections."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from core.analysis.facts import CampaignFacts, SolveFacts
from core.analysis.study import Findings, Summary, findings_of, summarized
from service.report.estimates import strategy_key

#: Strategy and duration of the outages [days], None where a case mixes durations.
Key = tuple[str, float | None]


@dataclass(frozen=True, slots=True, eq=False)
class Groups:
    """Everything that several sections ask for."""

    findings: Findings
    #: By number of outages, then without seeds first, then by duration; solves in order of address.
    solves: Mapping[Key, Sequence[SolveFacts]]
    #: Of the same groups, at the strict tolerance.
    summaries: Mapping[Key, Summary]


def groups_of(facts: CampaignFacts) -> Groups:
    """Return the groups of a campaign."""
    findings = findings_of(facts)
    solves = _by_strategy(facts.solves)
    return Groups(findings, solves, {key: summarized(findings, group) for key, group in solves.items()})


def _by_strategy(solves: Iterable[SolveFacts]) -> dict[Key, list[SolveFacts]]:
    found: dict[Key, list[SolveFacts]] = {}
    # A hundred thousand solves have some dozen cases: each is asked for its duration once.
    durations: dict[tuple[tuple[int, float], ...], float | None] = {}
    for solve in solves:
        if solve.outages not in durations:
            durations[solve.outages] = solve.duration_days
        found.setdefault((solve.strategy, durations[solve.outages]), []).append(solve)
    return {key: found[key] for key in sorted(found, key=lambda key: (*strategy_key(key[0]), key[1] or 0.0))}
