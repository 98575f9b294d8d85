"""The specification of a campaign: TOML or JSON in, validated and hashed data out.

SpecError(ValueError)   a specification that cannot be run; one line per field, with value and reason
"""

import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictInt,
    ValidationError,
    model_validator,
)

from core.problem import Outage, Problem, ProblemError, content_hash, problem_from, validation_message
from core.search import GUESS_LAWS, HOP_LAWS, MAPPINGS
from workers.job import HopLaws, Settings

#: What only one of the two kinds of search may set.
CHAIN_FIELDS = ("guesses", "guess_law", "hop_law", "hop_width", "max_failures", "hops")
SEED_FIELDS = ("seeds", "mapping")
BUDGETS = ("guesses", "core_seconds", "solutions")
STRATEGY = re.compile(r"S\((0|[1-9]\d{0,3})(?:\|(0|[1-9]\d{0,3}))?\)")


class SpecError(ValueError):
    """A specification that cannot be run; one line per field, with value and reason."""


def one_of(names: Any) -> AfterValidator:
    """Return a validator that admits the given names alone."""

    def check(value: str) -> str:
        if value not in names:
            raise ValueError(f"expected one of {', '.join(names)}, got {value!r}")
        return value

    return AfterValidator(check)


def shaped(pattern: str, shape: str) -> AfterValidator:
    """Return a validator that admits what a pattern matches, and says of the rest what was expected."""

    def check(value: str) -> str:
        if not re.fullmatch(pattern, value):
            raise ValueError(f"expected {shape}, got {value[:80]!r}")
        return value

    return AfterValidator(check)


NAME_SHAPE = "1 to 80 letters, digits, spaces or . _ -, a letter or digit first"
Name = Annotated[str, shaped(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,79}", NAME_SHAPE)]
Positive = Annotated[float, Field(gt=0, le=1e12)]
Count = Annotated[StrictInt, Field(ge=1, le=10_000_000)]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True)


class Seeds(_Strict):
    """Which strict solutions of another search this one starts from: all, or the first in an order."""

    #: Id of the search that finds them.
    source: Annotated[Name, Field(alias="from")]
    #: Least first; with an order or a limit the seeds are chosen when the source has finished.
    order: Literal["address", "delta_v", "time_of_flight"] | None = None
    limit: Count | None = None

    @property
    def is_immediate(self) -> bool:
        """Whether each new seed is mapped at once, since the set does not depend on who comes first."""
        return self.order is None and self.limit is None


class SearchSpec(_Strict):
    """One strategy with its outages, budget and options."""

    id: Name
    #: "S(k)": chains of hops from drawn guesses; "S(k|k')": seeds of P_k' mapped to P_k.
    strategy: Annotated[str, shaped(STRATEGY.pattern, "S(k) or S(k|k')")]
    outages: tuple[Outage, ...] = ()
    #: Budget, one of three: NLP solves, processor seconds, or different solutions.
    guesses: Count | None = None
    core_seconds: Positive | None = None
    solutions: Count | None = None
    seeds: Seeds | None = None
    mapping: Annotated[str, one_of(MAPPINGS)] = "reference"
    guess_law: Annotated[str, one_of(GUESS_LAWS)] = "uniform"
    hop_law: Annotated[str, one_of(HOP_LAWS)] = "uniform"
    hop_width: Annotated[float, Field(gt=0, le=1)] = HopLaws().hop_width
    max_failures: Count = HopLaws().max_failures
    #: Solves per chain; 1 is multistart.
    hops: Annotated[StrictInt, Field(ge=1, le=10_000)] = 1
    #: Cap per guess [s], scaled by 1 + k.
    cpu_seconds: Annotated[float, Field(gt=0, le=86400)] = Settings().cpu_seconds
    max_iterations: Annotated[StrictInt, Field(ge=1, le=1_000_000)] | None = None
    n_legs: Annotated[StrictInt, Field(ge=1, le=200)] = Settings().n_legs

    @property
    def k(self) -> int:
        """Number of outages that the strategy names."""
        return int(self._parts[0])

    @property
    def seed_k(self) -> int | None:
        """The k' of S(k|k'), or None."""
        return None if self._parts[1] is None else int(self._parts[1])

    @property
    def _parts(self) -> tuple[str, str | None]:
        match = STRATEGY.fullmatch(self.strategy)
        assert match is not None
        return match[1], match[2]

    @property
    def laws(self) -> HopLaws:
        """How chains draw."""
        return HopLaws(
            guess_law=self.guess_law,
            hop_law=self.hop_law,
            hop_width=self.hop_width,
            max_failures=self.max_failures,
        )

    @property
    def settings(self) -> Settings:
        """What shapes every solve."""
        return Settings(cpu_seconds=self.cpu_seconds, max_iterations=self.max_iterations, n_legs=self.n_legs)

    @model_validator(mode="after")
    def _outages_match(self) -> Self:
        if len(self.outages) != self.k:
            raise ValueError(f"outages: expected {self.k} for {self.strategy}, got {len(self.outages)}")
        return self

    @model_validator(mode="after")
    def _options_match(self) -> Self:
        foreign = SEED_FIELDS if self.seed_k is None else CHAIN_FIELDS
        for name in foreign:
            if name in self.model_fields_set:
                raise ValueError(
                    f"{name}: expected to be absent for {self.strategy}, got {self._shown(name)}"
                )
        if self.seed_k is not None and self.seeds is None:
            raise ValueError(f"seeds: expected a table with `from` for {self.strategy}, got none")
        if self.seed_k is not None and self.seed_k >= self.k:
            raise ValueError(f"strategy: expected k' < k, got {self.strategy}")
        return self

    @model_validator(mode="after")
    def _budget_given(self) -> Self:
        given = [name for name in BUDGETS if getattr(self, name) is not None]
        if self.seed_k is None and len(given) != 1:
            raise ValueError(f"budget: expected exactly one of {', '.join(BUDGETS)}, got {_listed(given)}")
        if len(given) > 1:
            raise ValueError(f"budget: expected at most one of core_seconds, solutions, got {_listed(given)}")
        return self

    def _shown(self, name: str) -> str:
        value = getattr(self, name)
        return "a table" if isinstance(value, BaseModel) else repr(value)


class CampaignSpec(_Strict):
    """Name of a campaign and the integer that fixes all its randomness."""

    name: Name
    rng_seed: Annotated[StrictInt, Field(ge=0, lt=2**63)]


def _problem(fields: Any) -> Any:
    try:
        problem = problem_from(fields)
    except ProblemError as error:
        raise ValueError(str(error)) from error
    if problem.outages:
        raise ValueError(f"problem.outages: expected none here, each search has its own, got {problem.k}")
    return problem


class Spec(_Strict):
    """A whole campaign: problem, searches, budgets."""

    campaign: CampaignSpec
    #: The reference problem P_0.
    problem: Annotated[Problem, BeforeValidator(_problem)]
    search: Annotated[tuple[SearchSpec, ...], Field(min_length=1, max_length=500)]

    @model_validator(mode="after")
    def _ids_differ(self) -> Self:
        ids = [search.id for search in self.search]
        for name in ids:
            if ids.count(name) > 1:
                raise ValueError(f"search: expected different ids, got {name!r} {ids.count(name)} times")
        return self

    @model_validator(mode="after")
    def _sources_fit(self) -> Self:
        by_id = {search.id: search for search in self.search}
        for search in self.search:
            if search.seeds is None:
                continue
            source = by_id.get(search.seeds.source)
            if source is None:
                known, given = ", ".join(by_id), search.seeds.source
                raise ValueError(f"search {search.id}: seeds.from: expected one of {known}, got {given!r}")
            if source.k != search.seed_k:
                raise ValueError(
                    f"search {search.id}: seeds.from: expected a search of S({search.seed_k}...) for "
                    f"{search.strategy}, got {source.id!r}, which is {source.strategy}"
                )
        return self

    @model_validator(mode="after")
    def _problems_possible(self) -> Self:
        for search in self.search:
            try:
                self.problem_of(search)
            except ProblemError as error:
                raise ValueError(f"search {search.id}: {error}") from error
        return self

    def problem_of(self, search: SearchSpec) -> Problem:
        """Return the P_k that a search is about."""
        return self.problem.with_outages((o.segment, o.duration_days) for o in search.outages)

    def as_fields(self) -> dict[str, Any]:
        """Return plain data that `spec_from` reads back into an equal specification."""
        fields = self.model_dump(mode="json", by_alias=True, exclude={"search"})
        searches = [s.model_dump(mode="json", by_alias=True, exclude_unset=True) for s in self.search]
        return fields | {"search": searches}

    @property
    def hash(self) -> str:
        """Identity of the specification: the same one is the same campaign."""
        whole = self.model_dump(mode="json", by_alias=True, exclude={"problem"})
        return content_hash({"problem": self.problem.hash} | whole)


def spec_from(fields: Any, *, allow_files: bool = False) -> Spec:
    """Return the specification that plain data describes.

    Files are named only by users of this machine: a path that comes over the network is refused unread.
    """
    if not isinstance(fields, Mapping):
        raise SpecError(f"spec: expected tables campaign, problem and search, got {type(fields).__name__}")
    if not allow_files:
        _refuse_files(fields.get("problem"))
    try:
        return Spec.model_validate(fields)
    except ValidationError as error:
        raise SpecError(validation_message("spec", error, Spec)) from error


def load_spec(path: Path) -> Spec:
    """Return the specification in a .toml or .json file."""
    try:
        text = path.read_text(encoding="utf-8")
        fields = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise SpecError(f"spec: expected a readable .toml or .json file, got {path}: {error}") from error
    return spec_from(fields, allow_files=True)


def _refuse_files(problem: Any) -> None:
    target = problem.get("target") if isinstance(problem, Mapping) else None
    if isinstance(target, Mapping) and (target.get("kind") == "spk" or "path" in target):
        raise SpecError(
            "spec.problem.target: expected a target without a file over the network, got kind spk"
        )


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "none"
