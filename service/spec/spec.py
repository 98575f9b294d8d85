"""The specification of a campaign: TOML or JSON in, validated and hashed data out.

SpecError(ValueError)   a specification that cannot be run; one line per field, with value and reason

Which seeds may start which cases of a search is decided here too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, StrictInt, ValidationError, model_validator

from core.errors import UserError
from core.plain_data import NAMES_OF_PLANETS, content_hash, read_table_file
from core.problem import Problem, ProblemError, beside, problem_from, validation_message
from core.search.settings import expand_mapping
from service.spec.search_spec import SHARING, Name, Priority, SearchSpec, Strict
from workers.messages import JobSettings

#: The outages (segment, duration [d]) of one problem.
Case = Sequence[tuple[int, float]]


def targets(search: SearchSpec, seed_case: Case, number: int) -> list[int]:
    """Return the cases that a seed is mapped to.

    Parameters
    ----------
    search : SearchSpec
        The search that takes the seed.
    seed_case : sequence of (int, float)
        The outages of the seed.
    number : int
        Its place among the seeds, which decides where the cases take turns.
    """
    assert search.seeds is not None
    fitting = [index for index, case in enumerate(search.outage_sets) if _fits(search, seed_case, case)]
    if search.seeds.pairing == "round-robin" and fitting:
        return [fitting[number % len(fitting)]]
    return fitting


def _fits(search: SearchSpec, seed_case: Case, case: Case) -> bool:
    assert search.seeds is not None
    if search.is_refinement:
        # Both in the segments of the search.
        return sorted(seed_case) == sorted(case)
    if search.seed_k == search.k:
        return _outlasts(seed_case, case)
    return search.seeds.pairing != "contained" or set(seed_case) <= set(case)


def _outlasts(seed_case: Case, case: Case) -> bool:
    """Return whether outages begin at the same segments and last longer."""
    before, after = sorted(seed_case), sorted(case)
    if [segment for segment, _ in before] != [segment for segment, _ in after] or before == after:
        return False
    return all(old <= new for (_, old), (_, new) in zip(before, after, strict=True))


def first_pair(search: SearchSpec, source: SearchSpec) -> tuple[Case, Case] | None:
    """Return the first case of a source, and the first of a search that its seeds are mapped to."""
    for seed_case in source.outage_sets:
        if found := targets(search, seed_case, 0):
            return seed_case, search.outage_sets[found[0]]
    return None


def require_seedable(search: SearchSpec, source: SearchSpec) -> None:
    """Raise ValueError unless the solutions of a source can be seeds of a search."""
    about = f"search {search.id}: seeds.from"
    if source.k != search.seed_k:
        raise ValueError(
            f"{about}: expected a search of S({search.seed_k}...) for {search.strategy}, got {source.id!r}, "
            f"which is {source.strategy}"
        )
    if first_pair(search, source) is None:
        wanted = (
            "the same segments and longer outages" if search.k == source.k else "a case that holds its own"
        )
        raise ValueError(f"{about}: expected {wanted}, got no such pair of cases from {source.id!r}")
    assert search.seeds is not None
    is_free = search.seeds.any_duration or search.seed_k == search.k or not source.k
    if not is_free and source.durations != search.durations:
        raise ValueError(
            f"{about}: expected outages of {_join(search.durations)} days, got {source.id!r} with "
            f"{_join(source.durations)}; set any_duration to allow it"
        )


def _join(durations: set[float]) -> str:
    return ", ".join(f"{duration:g}" for duration in sorted(durations))


class SpecError(UserError, ValueError):
    """A specification that cannot be run; one line per field, with value and reason."""


class CampaignSpec(Strict):
    """Name of a campaign, the integer that fixes all its randomness, and whether it goes first."""

    name: Name
    rng_seed: Annotated[StrictInt, Field(ge=0, lt=2**63)]
    #: Lower goes first.
    priority: Priority = 0


def _problem(fields: Any) -> Any:
    try:
        problem = problem_from(fields)
    except ProblemError as error:
        raise ValueError(str(error)) from error
    if problem.outages:
        raise ValueError(f"problem.outages: expected none here, each search has its own, got {problem.k}")
    return problem


class Spec(Strict):
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
    def _problems_possible(self) -> Self:
        for search in self.search:
            try:
                self.problems_of(search)
            except ProblemError as error:
                raise ValueError(f"search {search.id}: {error}") from error
        return self

    @model_validator(mode="after")
    def _sources_fit(self) -> Self:
        by_id = {search.id: search for search in self.search}
        for search in self.search:
            if search.seeds is None or search.seeds.campaign is not None or search.seeds.source is None:
                # What another campaign holds is known to the archive alone.
                continue
            source = by_id.get(search.seeds.source)
            if source is None:
                known, given = ", ".join(by_id), search.seeds.source
                raise ValueError(f"search {search.id}: seeds.from: expected one of {known}, got {given!r}")
            self.require_source(search, source)
        return self

    def require_source(self, search: SearchSpec, source: SearchSpec) -> None:
        """Raise ValueError unless seeds of a source can be mapped to the cases of a search."""
        require_seedable(search, source)
        if search.is_refinement:
            # Its seeds are of another problem, which the archive knows.
            return
        pair = first_pair(search, source)
        assert pair is not None
        problems = [self.problem.with_outages(case) for case in pair]
        try:
            for mapping in search.mapping:
                expand_mapping(mapping, *problems)
        except ValueError as error:
            raise ValueError(f"search {search.id}: {error}") from error

    @model_validator(mode="after")
    def _each_seed_once(self) -> Self:
        mapped: dict[tuple[Any, ...], str] = {}
        for search in self.search:
            for case in search.outage_sets if search.seeds else ():
                for mapping in search.mapping:
                    use = (search.seeds and search.seeds.full_name, case, mapping)
                    if other := mapped.get(use):
                        raise ValueError(
                            f"search {search.id}: expected each seed, mapping and case once in a campaign, "
                            f"got {mapping} to {list(case)} in {other} as well"
                        )
                    mapped[use] = search.id
        return self

    @property
    def in_order(self) -> list[tuple[int, SearchSpec]]:
        """The searches with their positions, sources before what they feed."""
        return sorted(enumerate(self.search), key=lambda entry: (self._depth(entry[1]), entry[0]))

    def _depth(self, search: SearchSpec) -> int:
        source = self.source_of(search)
        return 0 if source is None else 1 + self._depth(source)

    def problems_of(self, search: SearchSpec) -> list[Problem]:
        """Return the P_k that a search is about, one per case."""
        return self.problem.with_cases(search.outage_sets)

    def source_of(self, search: SearchSpec) -> SearchSpec | None:
        """Return the search of this campaign that the seeds of another come from."""
        if search.seeds is None or search.seeds.campaign is not None or search.seeds.source is None:
            return None
        return next(one for one in self.search if one.id == search.seeds.source)

    def as_fields(self) -> dict[str, Any]:
        """Return plain data that `spec_from` reads back into an equal specification."""
        fields = self.model_dump(mode="json", by_alias=True, exclude={"search"})
        searches = [s.model_dump(mode="json", by_alias=True, exclude_unset=True) for s in self.search]
        return fields | {"search": searches}

    @property
    def hash(self) -> str:
        """Identity of the specification: what finds the same is the same campaign."""
        left_out: Any = {"problem": True, "campaign": {"priority"}, "search": self._without_effect()}
        whole = self.model_dump(mode="json", by_alias=True, exclude=left_out)
        return content_hash({"problem": self.problem.hash} | whole)

    def _without_effect(self) -> dict[int, Any]:
        """Return the fields of each search that do not count for the hash.

        What came with later versions counts where it is used, so that older campaigns keep their hashes.
        """
        left_out: dict[int, Any] = {}
        for position, search in enumerate(self.search):
            left_out[position] = dict.fromkeys(SHARING, True)
            if search.reference == "free":
                left_out[position]["reference"] = True
            if search.recoveries == JobSettings().recoveries:
                left_out[position]["recoveries"] = True
            if search.integrator_tolerance is None:
                left_out[position]["integrator_tolerance"] = True
            if search.seeds is not None and search.seeds.solution is None:
                left_out[position]["seeds"] = {"solution"}
        return left_out


def spec_from(fields: Any, *, allow_files: bool = False) -> Spec:
    """Return the specification that plain data describes.

    Files are named only by users of this machine: a path that comes over the network is refused unread.
    """
    if not isinstance(fields, Mapping):
        raise SpecError(f"spec: expected tables campaign, problem and search, got {type(fields).__name__}")
    if not allow_files:
        _refuse_files("spec.problem", fields.get("problem"))
    try:
        return Spec.model_validate(fields)
    except ValidationError as error:
        raise SpecError(validation_message("spec", error, Spec)) from error


def load_spec(path: Path) -> Spec:
    """Return the specification in a .toml or .json file."""
    try:
        fields = read_table_file(path)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SpecError(f"spec: expected a readable .toml or .json file, got {path}: {reason}") from error
    if isinstance(fields, dict) and "problem" in fields:
        # Whoever reads the archive later, in another folder, has to find the target too.
        fields["problem"] = beside(fields["problem"], path.parent)
    return spec_from(fields, allow_files=True)


def problem_without_files(fields: Any) -> Problem:
    """Return the problem that plain data from the network describes, with its outages."""
    _refuse_files("problem", fields)
    try:
        return problem_from(fields)
    except ProblemError as error:
        raise SpecError(str(error)) from error


_WHERE = "use `coastarc run` where the file is"


def _refuse_files(name: str, problem: Any) -> None:
    world = problem.get("world") if isinstance(problem, Mapping) else None
    if isinstance(world, Mapping) and world.get("kernel") is not None:
        raise SpecError(
            f"{name}.world: expected a world without a file over the network, got a kernel; {_WHERE}"
        )
    target = problem.get("target") if isinstance(problem, Mapping) else None
    if isinstance(target, Mapping) and target.get("path") in NAMES_OF_PLANETS:
        return
    if isinstance(target, Mapping) and (target.get("kind") == "spk" or "path" in target):
        raise SpecError(
            f"{name}.target: expected a target without a file over the network, got kind spk; {_WHERE}"
        )


@dataclass(frozen=True, slots=True)
class SeedChoices:
    """How seeds are chosen and mapped; None leaves it to the search."""

    order: str | None = None
    limit: int | None = None
    tolerance: str | None = None
    mapping: tuple[str, ...] | None = None

    def applied(self, fields: dict[str, Any]) -> SearchSpec:
        """Return the search of some fields with these choices, checked like any other."""
        given = {"order": self.order, "limit": self.limit, "tolerance": self.tolerance}
        fields["seeds"] |= {name: value for name, value in given.items() if value is not None}
        if self.mapping is not None:
            fields["mapping"] = self.mapping
        try:
            return SearchSpec.model_validate(fields)
        except ValidationError as error:
            raise SpecError(validation_message("seeds", error, SearchSpec)) from error
