"""The JSON of specifications: as text, checked, and as what would be run."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from service.api.schemas import Answer


class SpecToCheck(BaseModel):
    """A specification as somebody writes it."""

    model_config = ConfigDict(extra="forbid")

    #: TOML, or JSON if it begins with a brace.
    text: str = Field(max_length=400_000)


class FaultView(Answer):
    """Something that has to be changed before the specification can be run."""

    #: Names, and places in lists from 0 on, as in search.1.strategy; empty where it is about the whole.
    path: str
    #: Counted from 1; null where the text says nothing about it.
    line: int | None
    message: str


class PlannedSearch(Answer):
    """What one search will do."""

    id: str
    strategy: str
    n_cases: int
    #: At most; null where a budget in core seconds or solutions is the only bound.
    n_guesses_most: int | None
    #: Time that all of its solves are allowed; null where their number is open.
    core_hours_most: float | None
    seeds_from: str | None


class SpecPlan(Answer):
    """What would be run."""

    name: str
    rng_seed: int
    n_segments: int
    searches: list[PlannedSearch]
    n_cases: int
    n_guesses_most: int | None
    core_hours_most: float | None


class SpecCheck(Answer):
    """Faults, or the fields to submit and what would be run."""

    faults: list[FaultView]
    #: What `POST /campaigns` takes; null while there are faults.
    fields: dict[str, Any] | None
    plan: SpecPlan | None


class SpecText(Answer):
    """The specification of a campaign, or one to begin with."""

    name: str
    toml: str


class SpecTemplates(Answer):
    """Specifications to begin with."""

    items: list[SpecText]
