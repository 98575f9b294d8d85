"""The specification of a stored campaign, parsed once per process."""

import json
from functools import lru_cache

from service.db.tables import CampaignRow, SearchRow
from service.search_spec import SearchSpec
from service.spec import Spec, spec_from


def spec_of(campaign: CampaignRow) -> Spec:
    """Return the specification of a campaign."""
    return _parsed(json.dumps(campaign.spec, sort_keys=True))


def search_spec(campaign: CampaignRow, search: SearchRow) -> SearchSpec:
    """Return the part of a specification that a search stands for."""
    return spec_of(campaign).search[search.position]


@lru_cache(maxsize=64)
def _parsed(text: str) -> Spec:
    # The files that it names were checked when it was submitted.
    return spec_from(json.loads(text), allow_files=True)
