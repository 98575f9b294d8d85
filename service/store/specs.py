"""The specification of a stored campaign, parsed once per process."""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from service.db.tables import CampaignRow, SearchRow
from service.search_spec import SearchSpec
from service.spec import Spec, spec_from


@dataclass(frozen=True)
class _Stored:
    """A specification as stored, known by its hash: comparing it whole would cost more than it saves."""

    hash: str
    fields: Any = field(compare=False)


def spec_of(campaign: CampaignRow) -> Spec:
    """Return the specification of a campaign."""
    return _parsed(_Stored(campaign.spec_hash, campaign.spec))


def search_spec(campaign: CampaignRow, search: SearchRow) -> SearchSpec:
    """Return the part of a specification that a search stands for."""
    return spec_of(campaign).search[search.position]


@lru_cache(maxsize=64)
def _parsed(stored: _Stored) -> Spec:
    # The files that it names were checked when it was submitted.
    return spec_from(stored.fields, allow_files=True)
