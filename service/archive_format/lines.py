"""The lines of a portable file: JSON that refers to everything by hash and address, never by row id.

A campaign is a table of its own; jobs and solves follow line by line in the order in which they came to be,
and a solve names its job by the number of its line.  Problems, cases and links between seeds are left out:
they follow from the specification and from the jobs.  Floats are written so that every bit comes back.
"""

import json
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictInt

from service.db.tables import CAMPAIGN_STATES, ENDINGS, JOB_STATES, SEARCH_STATES

#: States of a campaign that does nothing by itself, and of a job that nobody holds.
RESTING = ("paused", "done", "cancelled")


def _one_of(*names: str) -> AfterValidator:
    def check(text: str) -> str:
        if text not in names:
            raise ValueError(f"expected one of {', '.join(names)}, got {text[:80]!r}")
        return text

    return AfterValidator(check)


def _storable(text: str) -> str:
    # PostgreSQL has no place for it.
    if "\0" in text:
        raise ValueError("expected a text without zero bytes")
    return text


def _plain(content: dict[str, Any]) -> dict[str, Any]:
    if "\\u0000" in json.dumps(content, allow_nan=False):
        raise ValueError("expected texts without zero bytes")
    return content


Hash = Annotated[str, Field(pattern="^[0-9a-f]{32}$")]
Text = Annotated[str, Field(max_length=100_000), AfterValidator(_storable)]
Count = Annotated[StrictInt, Field(ge=0, lt=2**63)]
Whole = Annotated[StrictInt, Field(ge=-(2**63), lt=2**63)]
Moment = Annotated[float, Field(ge=0)]
Numbers = Annotated[tuple[float, ...], Field(max_length=100_000)]
#: null where a state was not finite.
Gaps = Annotated[tuple[float | None, ...], Field(max_length=100_000)]
Plain = Annotated[dict[str, Any], AfterValidator(_plain)]
Resting = Annotated[str, _one_of(*RESTING)]
JobState = Annotated[str, _one_of(*(state for state in JOB_STATES if state != "running"))]
SearchStateName = Annotated[str, _one_of(*SEARCH_STATES)]
EndingName = Annotated[str, _one_of(*ENDINGS)]

assert set(RESTING) < set(CAMPAIGN_STATES)


class Line(BaseModel):
    """Data of a known form: no other fields, no number that is not finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def written(self) -> bytes:
        """Return the one way in which it is written."""
        return canonical(self.model_dump(mode="json", by_alias=True))


class SourceLine(Line):
    """The search of a campaign that seeds come from."""

    campaign: Hash
    search: Text


class SearchLine(Line):
    """A search as it stands; its options are in the specification."""

    name: Text
    state: SearchStateName
    priority: Whole
    weight: Annotated[float, Field(gt=0)]
    source: SourceLine | None


class CampaignLine(Line):
    """A campaign: its specification, and its searches in the same order."""

    spec_hash: Hash
    spec: Plain
    state: Resting
    priority: Whole
    created_at: Moment
    finished_at: Moment | None
    searches: Annotated[tuple[SearchLine, ...], Field(min_length=1, max_length=500)]


class AttemptLine(Line):
    """One dispatch of a job that has ended."""

    attempt: Count
    worker: Text
    started_at: Moment
    ended_at: Moment
    ending: EndingName
    next_state: Text | None
    error: Text | None
    provenance: Hash | None


class JobLine(Line):
    """A job by its address, with its attempts."""

    search: Count
    kind: Literal["hop", "map"]
    case: Count
    chain: Hash
    hop: Count
    n_hops: Count
    seed: Hash | None
    mapping: Text | None
    state: JobState
    priority: Whole
    attempt: Count
    n_failures: Count
    worker: Text | None
    ending: EndingName | None
    created_at: Moment
    updated_at: Moment
    attempts: Annotated[tuple[AttemptLine, ...], Field(max_length=10_000)]

    @property
    def address(self) -> tuple[int, str, int, str, int]:
        """Where in its campaign it stands."""
        return (self.search, self.kind, self.case, self.chain, self.hop)


class SolveLine(Line):
    """A solve, feasible or not."""

    job: Count
    attempt: Count
    hop: Count
    rng_key: Text
    ending: EndingName
    status: Text
    is_feasible: bool
    paper: bool
    strict: bool
    objective_kg: float | None
    violation: float | None
    defects: Gaps
    n_iterations: Count
    n_evaluations: Count
    cpu_seconds: Annotated[float, Field(ge=0)]
    wall_seconds: Annotated[float, Field(ge=0)]
    move: Text | None
    solution: Hash | None
    created_at: Moment


class ProvenanceLine(Line):
    """Code, packages, kernels and host of attempts."""

    hash: Hash
    content: Plain


class SolutionLine(Line):
    """A solution with what its verification found."""

    id: Hash
    problem: Hash
    x: Numbers
    objective_kg: float
    propellant_kg: float
    delta_v_km_s: float
    delta_v_total_km_s: float
    shooting_days: float
    initial_coast_days: float
    final_coast_days: float
    time_of_flight_days: float
    insertion_epoch: Text
    arrival_epoch: Text
    defects: Gaps
    paper: bool
    strict: bool
    verification: Plain


class CertificateLine(Line):
    """A certificate of a solution, with where and when it was made, and when it was last found again."""

    solution: Hash
    hash: Hash
    content: Plain
    made_on: Text
    made_at: Moment
    cpu_seconds: Annotated[float, Field(ge=0)]
    checked_at: Moment


class Member(Line):
    """An entry of the file with size and digest, to detect damage and change."""

    n_bytes: Count
    blake2b: Hash


class Manifest(Line):
    """What the file is: its format, the campaign that was asked for, and all its entries."""

    format: Literal["coastarc campaign"]
    version: StrictInt
    campaign: Hash
    members: dict[str, Member]


def canonical(content: Any) -> bytes:
    """Return plain data in the one way in which it is written: keys sorted, no spaces, floats shortest."""
    text = json.dumps(content, allow_nan=False, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return text.encode() + b"\n"
