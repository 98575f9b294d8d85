"""Missed-thrust analysis: maps and probabilities from the results of its campaign."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from core.analysis.missed_thrust import (
    Attempt,
    MissedThrust,
    Survivability,
    attempt,
    fragile_segments,
    missed_thrust,
    survivability,
)
from core.transcription import layout_of
from service.schemas.campaign import CampaignView
from service.schemas.solution import Map, MissedThrustView, SegmentRisk, SurvivabilityView
from service.store.solutions import MissedThrustAnalysis
from service.store.store import Store


def views_of(
    store: Store, solution_id: str, campaign_id: int | None = None, limit: int = 1
) -> list[MissedThrustView]:
    """Return the newest analyses of a solution, or that of one campaign, as far as they are."""
    found = store.missed_thrust_analyses(solution_id, campaign_id, limit)
    return [_view(analysed, store.campaign(analysed.facts.id)) for analysed in found]


def _view(analysed: MissedThrustAnalysis, campaign: CampaignView) -> MissedThrustView:
    attempts = list(_attempts(analysed))
    problem, x = analysed.problem, np.array(analysed.x)
    found = missed_thrust(problem, x, [*attempts, *_own(analysed, attempts)])
    chance, fragile = survivability(problem, x, found), fragile_segments(problem, x, found)
    jobs = [search.jobs for search in campaign.searches]
    return MissedThrustView(
        solution_id=analysed.solution_id,
        k=problem.k,
        campaign_id=campaign.id,
        campaign_state=campaign.state,
        n_done=sum(count.done for count in jobs),
        n_jobs=sum(count.done + count.queued + count.running for count in jobs),
        cpu_seconds=sum(solve.cpu_seconds for solve in analysed.facts.solves),
        final_mass_kg=found.final_mass_kg,
        arrival_days=found.arrival_days,
        throttles=x[layout_of(problem).reference.controls][::3].tolist(),
        durations_days=found.durations_days.tolist(),
        segments=list(_risks(found, chance, fragile)),
        propellant_kg=_map(found.propellant_kg),
        delay_days=_map(found.delay_days),
        is_tried=found.is_tried.tolist(),
        fragile=fragile,
        survivability=_survivability(chance),
    )


def _attempts(analysed: MissedThrustAnalysis) -> Iterator[Attempt]:
    facts = analysed.facts
    for solve in facts.solves:
        x = np.array(facts.vectors[solve.solution_id]) if solve.solution_id is not None else None
        yield attempt(facts.problem.with_outages(solve.outages), x)


def _own(analysed: MissedThrustAnalysis, attempts: list[Attempt]) -> Iterator[Attempt]:
    """Yield the realizations that a robust solution brings along, each at the durations that it covers."""
    problem, layout = analysed.problem, layout_of(analysed.problem)
    tried = {one.outage for one in attempts}
    reference = analysed.x[: layout.reference.stop]
    for own in layout.trajectories[1:]:
        assert own.outage is not None
        alone = problem.with_outages([(own.outage.segment, own.outage.duration_days)])
        known = attempt(alone, np.concatenate([reference, analysed.x[own.offset : own.stop]]))
        for outage in tried:
            if outage.segment == own.outage.segment and outage.duration_days <= own.outage.duration_days:
                yield Attempt(outage, known.recovered)


def _risks(found: MissedThrust, chance: Survivability, fragile: list[int]) -> Iterator[SegmentRisk]:
    for row, segment in enumerate(found.segments.tolist()):
        yield SegmentRisk(
            segment=segment,
            start_days=float(found.starts_days[row]),
            throttle=float(found.throttles[row]),
            longest_days=float(found.longest_days[row]),
            is_open=bool(found.is_open[row]),
            lost_probability=float(chance.lost[segment]),
            is_fragile=segment in fragile,
        )


def _map(values: NDArray[np.float64]) -> Map:
    return [[float(cell) if np.isfinite(cell) else None for cell in row] for row in values]


def _survivability(chance: Survivability) -> SurvivabilityView:
    least, most = chance.recovered_given_one
    return SurvivabilityView(
        arc_days=chance.least.arc_days,
        none=chance.least.none,
        one=chance.least.one,
        several=chance.least.several,
        recovered_given_one_least=least,
        recovered_given_one_most=most,
        survived_least=chance.least.covered,
        survived_most=chance.most.covered,
    )
