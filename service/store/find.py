"""Rows by what users call them."""

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.db.tables import CampaignRow
from service.store.errors import UnknownRow


def find_campaign(session: Session, name_or_id: str) -> int:
    """Return the campaign of an id, or the newest of a name."""
    found = None
    if name_or_id.isdecimal() and len(name_or_id) < 19:
        found = session.scalar(select(CampaignRow.id).where(CampaignRow.id == int(name_or_id)))
    if found is None:
        # A campaign may be called "7".
        found = session.scalar(select(func.max(CampaignRow.id)).where(CampaignRow.name == name_or_id))
    if found is None:
        raise UnknownRow("campaign", name_or_id, "none with this id or name; see `coastarc status`")
    return found


def campaign_state(session: Session, campaign_id: int) -> str:
    """Return the state of a campaign."""
    state = session.scalar(select(CampaignRow.state).where(CampaignRow.id == campaign_id))
    if state is None:
        raise UnknownRow("campaign", campaign_id)
    return state
