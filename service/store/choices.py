"""What a filter of solutions can be set to, from the few rows that name it."""

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.tables import CampaignRow, CaseRow, ProblemRow, SearchRow
from service.schemas.solution import CampaignChoice, ChoicesView

#: Campaigns that are listed, the newest.
CAMPAIGNS = 200


def list_choices(session: Session, campaign: int | None) -> ChoicesView:
    """Return the names of campaigns, and what there is in one of them or in all."""
    newest = select(CampaignRow.id, CampaignRow.name).order_by(CampaignRow.id.desc()).limit(CAMPAIGNS)
    searches = select(SearchRow.name, SearchRow.strategy).distinct()
    problems = select(ProblemRow.k, ProblemRow.definition)
    if campaign is not None:
        searches = searches.where(SearchRow.campaign_id == campaign)
        cases = (
            select(CaseRow.problem_hash)
            .join(SearchRow, SearchRow.id == CaseRow.search_id)
            .where(SearchRow.campaign_id == campaign)
        )
        problems = problems.where(ProblemRow.hash.in_(cases))
    named, found = session.execute(searches).all(), session.execute(problems).all()
    outages = [outage for _, definition in found for outage in definition["outages"]]
    return ChoicesView(
        campaigns=[CampaignChoice(id=key, name=name) for key, name in session.execute(newest)],
        searches=sorted({name for name, _ in named}),
        strategies=sorted({strategy for _, strategy in named}),
        k=sorted({k for k, _ in found}),
        segments=sorted({outage["segment"] for outage in outages}),
        durations_days=sorted({outage["duration_days"] for outage in outages}),
    )
