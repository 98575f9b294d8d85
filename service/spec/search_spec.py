"""One search of a specification: its strategy, the cases it is about, its budget and its options."""

import re
from dataclasses import fields
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, StrictInt, model_validator

from core.problem import MOST_OUTAGE_DAYS, Outage
from core.search.settings import GUESS_LAWS, HOP_LAWS, REFINED, SHAPES, HopSettings, check_mapping
from workers.messages import JobSettings

#: What only one of the two kinds of search may set.
LAWS = tuple(field.name for field in fields(HopSettings))
CHAIN_FIELDS = (*LAWS, "hops")
SEED_FIELDS = ("seeds", "mapping", "reference")
BUDGETS = ("guesses", "core_seconds", "solutions")
STRATEGY = re.compile(r"S\((0|[1-9]\d{0,3})(?:\|(0|[1-9]\d{0,3}))?\)")
#: Cases of one search, at most.
MOST_CASES = 2000


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
#: What says when work is done, and not what it finds.
SHARING = ("weight", "priority")
Weight = Annotated[float, Field(ge=1e-3, le=1e6)]
Priority = Annotated[StrictInt, Field(ge=-1_000_000, le=1_000_000)]
Segments = Annotated[tuple[Annotated[StrictInt, Field(ge=1)], ...], Field(max_length=2000)]


class Strict(BaseModel):
    """Fields as a user writes them: no other ones, no number that is not finite."""

    # Built when it is first used: a list needs few of all models.
    model_config = ConfigDict(
        defer_build=True, frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True
    )


def _listed_mappings(given: Any) -> Any:
    """Return one mapping, an assignment or several mappings as several."""
    if isinstance(given, str):
        return (given,)
    is_list = isinstance(given, list | tuple) and given
    if is_list and all(isinstance(entry, int) and not isinstance(entry, bool) for entry in given):
        return (f"reference({','.join(map(str, given))})",)
    return given


def _check_mapping(name: str) -> str:
    check_mapping(name)
    return name


Mappings = Annotated[
    tuple[Annotated[str, AfterValidator(_check_mapping)], ...],
    Field(min_length=1, max_length=100),
    BeforeValidator(_listed_mappings),
]
#: Which seeds go first.
SeedOrder = Literal["address", "chain", "delta_v", "time_of_flight", "diversity"]


class Seeds(Strict):
    """Which solutions of another search this one starts from, and for which of its cases."""

    #: Id of the search that finds them, and the name or id of its campaign if that is another one ...
    source: Annotated[Name | None, Field(alias="from")] = None
    campaign: Name | None = None
    #: ... or the id of one solution of the archive, of which S(k|0) takes the reference alone.
    solution: Annotated[str, shaped("[0-9a-f]{32}", "32 hexadecimal digits, a whole id")] | None = None
    #: Least first, or each as far as possible from those before it.
    order: SeedOrder | None = None
    limit: Count | None = None
    #: Each seed for every case, for one case in turn, or for the cases that hold all its outages.
    pairing: Literal["every", "round-robin", "contained"] = "every"
    #: Level at which a solution is good enough to be a seed.
    tolerance: Literal["strict", "paper"] = "strict"
    #: Whether seeds may come from outages of another duration.
    any_duration: bool = False

    @property
    def full_name(self) -> str:
        """The source as users read it."""
        if self.source is None:
            return f"solution {self.solution}"
        return self.source if self.campaign is None else f"{self.campaign}/{self.source}"

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.source is None) == (self.solution is None):
            given = "none" if self.source is None else "both"
            raise ValueError(f"expected one of `from` and `solution`, got {given}")
        if self.solution is not None and self.campaign is not None:
            raise ValueError("campaign: expected beside `from`, got it beside `solution`")
        return self


class SearchSpec(Strict):
    """One strategy with its cases, budget and options."""

    id: Name
    #: "S(k)": chains of hops from drawn guesses; "S(k|k')": seeds of P_k' mapped to P_k.
    strategy: Annotated[str, shaped(STRATEGY.pattern, "S(k) or S(k|k')")]
    #: The outages of the one case, or the segments of each of several cases, whose outages last equally long.
    outages: tuple[Outage, ...] = ()
    cases: Annotated[tuple[Segments, ...], Field(max_length=MOST_CASES)] | None = None
    duration_days: Annotated[float, Field(gt=0, le=MOST_OUTAGE_DAYS)] | None = None
    #: Budget: NLP solves over all cases, processor seconds, different solutions; whichever comes first.
    guesses: Count | None = None
    core_seconds: Positive | None = None
    solutions: Count | None = None
    seeds: Seeds | None = None
    mapping: Mappings = ("reference",)
    #: "frozen": the seed's reference is flown as it is, and recoveries from the outages alone are solved.
    reference: Literal["free", "frozen"] = "free"
    #: "any": realizations as they close, as in the paper; "cheapest": each with the cheapest recovery found.
    recoveries: Literal["cheapest", "any"] = JobSettings().recoveries
    guess_law: Annotated[str, one_of(GUESS_LAWS)] = HopSettings().guess_law
    hop_law: Annotated[str, one_of(HOP_LAWS)] = HopSettings().hop_law
    #: None: the law's own.
    hop_width: Annotated[float, Field(gt=0, le=1)] | None = None
    hop_shape: Annotated[float, Field(ge=SHAPES[0], le=SHAPES[1])] | None = None
    adaptive: bool = False
    time_hop_probability: Annotated[float, Field(ge=0, le=1)] = 0.0
    max_failures: Count = HopSettings().max_failures
    #: Solves per chain; 1 is multistart.
    hops: Annotated[StrictInt, Field(ge=1, le=10_000)] = 1
    #: Cap per guess [s], scaled by 1 + k.
    cpu_seconds: Annotated[float, Field(gt=0, le=86400)] = JobSettings().cpu_seconds
    max_iterations: Annotated[StrictInt, Field(ge=1, le=1_000_000)] | None = None
    n_legs: Annotated[StrictInt, Field(ge=1, le=200)] = JobSettings().n_legs
    #: None: core's own.
    integrator_tolerance: Annotated[float, Field(ge=1e-14, le=1e-3)] | None = None
    #: Part of the workers, beside searches of equal priority.
    weight: Weight = 1.0
    #: Lower goes first; None: the end of a seed chain first.
    priority: Priority | None = None

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
    def outage_sets(self) -> tuple[tuple[tuple[int, float], ...], ...]:
        """The cases, each as its outages (segment, duration [d])."""
        if self.cases is None:
            return (tuple((outage.segment, outage.duration_days) for outage in self.outages),)
        duration = self.duration_days or 0.0
        return tuple(tuple((segment, duration) for segment in sorted(case)) for case in self.cases)

    @property
    def durations(self) -> set[float]:
        """The durations of all its outages [d]."""
        return {duration for case in self.outage_sets for _, duration in case}

    @property
    def is_immediate(self) -> bool:
        """Whether each new seed is mapped at once, since the jobs do not depend on who comes first."""
        seeds = self.seeds
        chooses = seeds is None or seeds.order is not None or seeds.limit is not None
        return not chooses and self.guesses is None and seeds is not None and seeds.pairing != "round-robin"

    @property
    def is_refinement(self) -> bool:
        """Whether its seeds are the same flights in fewer segments."""
        return REFINED in self.mapping

    @property
    def laws(self) -> HopSettings:
        """How chains draw."""
        return HopSettings(**{name: getattr(self, name) for name in LAWS})

    @property
    def settings(self) -> JobSettings:
        """What shapes every solve."""
        names = set(JobSettings.model_fields) - {"is_reference_frozen"}
        given = {name: getattr(self, name) for name in names}
        return JobSettings(**given, is_reference_frozen=self.reference == "frozen")

    @model_validator(mode="after")
    def _cases_match(self) -> Self:
        if self.cases is None:
            if self.duration_days is not None:
                raise ValueError("duration_days: expected beside cases, got it without")
            return self._require_k(len(self.outages), "outages")
        if self.outages:
            raise ValueError("cases: expected instead of outages, got both")
        if self.duration_days is None:
            raise ValueError("duration_days: expected beside cases, got none")
        if not self.cases:
            raise ValueError("cases: expected at least one, got none")
        if len(set(self.outage_sets)) < len(self.cases):
            raise ValueError("cases: expected different ones, got one of them twice")
        for case in self.cases:
            self._require_k(len(case), f"case {list(case)}")
        return self

    def _require_k(self, n_outages: int, thing: str) -> Self:
        if n_outages != self.k:
            raise ValueError(f"{thing}: expected {self.k} for {self.strategy}, got {n_outages}")
        return self

    @model_validator(mode="after")
    def _options_match(self) -> Self:
        foreign = SEED_FIELDS if self.seed_k is None else CHAIN_FIELDS
        for name in foreign:
            if name in self.model_fields_set:
                raise ValueError(f"{name}: expected to be absent for {self.strategy}, got {self._show(name)}")
        if self.seed_k is not None and self.seeds is None:
            raise ValueError(
                f"seeds: expected a table with `from` or `solution` for {self.strategy}, got none"
            )
        if self.is_refinement:
            return self._refinement_fits()
        if self.seed_k is not None and (self.seed_k > self.k or self.seed_k == self.k == 0):
            raise ValueError(f"strategy: expected k' < k, or k' = k for longer outages, got {self.strategy}")
        return self

    def _refinement_fits(self) -> Self:
        if self.mapping != (REFINED,) or self.seed_k != self.k:
            raise ValueError(
                f"mapping: expected {REFINED} alone and k' = k, "
                f"got {', '.join(self.mapping)} for {self.strategy}"
            )
        if self.seeds is None or self.seeds.solution is None:
            raise ValueError(f"seeds.solution: expected one for the mapping {REFINED}, got none")
        return self

    @model_validator(mode="after")
    def _laws_fit(self) -> Self:
        _ = self.laws
        return self

    @model_validator(mode="after")
    def _budget_given(self) -> Self:
        if self.seed_k is not None:
            # It ends with its seeds.
            return self
        if all(getattr(self, name) is None for name in BUDGETS):
            raise ValueError(f"budget: expected at least one of {', '.join(BUDGETS)}, got none")
        n = len(self.outage_sets)
        if self.guesses is not None and self.guesses < n:
            raise ValueError(f"guesses: expected at least one for each of {n} cases, got {self.guesses}")
        return self

    def _show(self, name: str) -> str:
        value = getattr(self, name)
        return "a table" if isinstance(value, BaseModel) else repr(value)
