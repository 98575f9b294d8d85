"""What a search that names its seeds one by one is refused for."""

from collections.abc import Sequence

from core.problem import Problem
from core.search.refinement import check_refinement
from service.scheduler.plan import Candidate, PlannedJob
from service.search_spec import SearchSpec
from service.spec import SpecError


def require_all(search: SearchSpec, known: Sequence[Candidate], jobs: Sequence[PlannedJob]) -> None:
    """Raise SpecError unless every seed that a search names is there, and one at least fits its outages."""
    assert search.seeds is not None and search.seeds.only is not None
    missing = set(search.seeds.only) - {seed.id for seed in known}
    if missing:
        raise SpecError(
            f"search {search.id}: seeds.only: expected {search.seeds.tolerance} solutions of "
            f"{search.seeds.full_name}, got {min(missing)}"
        )
    if not jobs:
        raise SpecError(f"search {search.id}: seeds.only: expected solutions that fit its outages, got none")


def require_coarser(problem: Problem, finer: Problem, about: str) -> None:
    """Raise SpecError unless a problem is another one with a fraction of its segments."""
    try:
        check_refinement(problem, finer)
    except ValueError as error:
        raise SpecError(f"{about}: {error}") from error
