"""Which seeds may start which cases of a search."""

from collections.abc import Sequence

from service.spec.search_spec import SearchSpec

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
            f"{about}: expected outages of {_listed(search.durations)} days, got {source.id!r} with "
            f"{_listed(source.durations)}; set any_duration to allow it"
        )


def _listed(durations: set[float]) -> str:
    return ", ".join(f"{duration:g}" for duration in sorted(durations))
