"""Caches of parsed specifications and problem definitions.

What never changes once it is stored, kept in memory under the hash that names it.
"""

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from sqlalchemy.orm import Session

from core.problem import problem_from
from service.db.tables import CampaignRow, ProblemRow, SearchRow
from service.spec import Spec, spec_from
from service.spec.search_spec import SearchSpec
from service.store.errors import UnknownRowError

if TYPE_CHECKING:
    from core.transcription import Layout
    from service.validation import ProblemFacts

T = TypeVar("T")


class Cache(Generic[T]):
    """An LRU cache of at most `most` entries."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._lock = threading.Lock()
        self._things: OrderedDict[str, T] = OrderedDict()

    def get(self, key: str, make: Callable[[], T]) -> T:
        """Return the thing of a hash, made if it is not here."""
        with self._lock:
            if key in self._things:
                self._things.move_to_end(key)
                return self._things[key]
        # Outside the lock: making one may wait for the database.
        thing = make()
        with self._lock:
            self._things[key] = thing
            if len(self._things) > self._most:
                self._things.popitem(last=False)
        return thing


_specs: Cache[Spec] = Cache(64)
_definitions: Cache[dict[str, Any]] = Cache(512)
_facts: "Cache[ProblemFacts]" = Cache(512)


def spec_of(campaign: CampaignRow) -> Spec:
    """Return the specification of a campaign."""
    # The files that it names were checked when it was submitted.
    return _specs.get(campaign.spec_hash, lambda: spec_from(campaign.spec, allow_files=True))


def spec_fields(session: Session, campaign_id: int) -> dict[str, Any]:
    """Return the specification of a campaign as plain data."""
    campaign = session.get(CampaignRow, campaign_id)
    if campaign is None:
        raise UnknownRowError("campaign", campaign_id)
    return spec_of(campaign).as_fields()


def search_spec(campaign: CampaignRow, search: SearchRow) -> SearchSpec:
    """Return the part of a specification that a search stands for."""
    return spec_of(campaign).search[search.position]


def definition_of(session: Session, problem_hash: str) -> dict[str, Any]:
    """Return a problem with every field written out; not to be changed."""
    return _definitions.get(problem_hash, lambda: session.get_one(ProblemRow, problem_hash).definition)


def facts_of_problem(session: Session, problem_hash: str) -> "ProblemFacts":
    """Return what the figures of a problem's solutions follow from."""
    # Imported here, since it needs the numerics and those who only read specifications do not.
    from service.validation import facts_of

    return _facts.get(
        problem_hash, lambda: facts_of(problem_from(definition_of(session, problem_hash)), problem_hash)
    )


def layout_of_problem(session: Session, problem_hash: str) -> "Layout":
    """Return where everything is in the decision vector of a problem."""
    return facts_of_problem(session, problem_hash).layout
