"""The missed-thrust analyses of a solution, read from the campaigns that made them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.orm import Session

from core.analysis.facts import CampaignFacts
from core.problem import Problem, problem_from
from service.db.tables import CampaignRow
from service.missed_thrust.analysis_spec import analysis_name
from service.spec.search_spec import SearchSpec
from service.store.facts import campaign_facts
from service.store.records import definition_and_vector
from service.store.specs import spec_of


@dataclass(frozen=True, slots=True, eq=False)
class Analysed:
    """A solution and what its analysis has found so far."""

    solution_id: str
    problem: Problem
    x: NDArray[np.float64]
    facts: CampaignFacts


def find_analyses(
    session: Session, solution_id: str, campaign_id: int | None = None, limit: int = 1
) -> list[Analysed]:
    """Return the newest analyses of a solution, or that of one campaign."""
    definition, x = definition_and_vector(session, solution_id)
    named = select(CampaignRow).where(CampaignRow.name == analysis_name(solution_id))
    if campaign_id is not None:
        named = named.where(CampaignRow.id == campaign_id)
    found = [
        Analysed(solution_id, problem_from(definition), x, campaign_facts(session, campaign.id))
        for campaign in session.scalars(named.order_by(CampaignRow.id.desc()).limit(limit))
        if _is_of(spec_of(campaign).search[0], solution_id)
    ]
    return [one for one in found if one.facts.solves]


def _is_of(search: SearchSpec, solution_id: str) -> bool:
    """Return whether a search analyses a solution: anybody may give a campaign such a name."""
    return search.reference == "frozen" and search.seeds is not None and search.seeds.solution == solution_id
