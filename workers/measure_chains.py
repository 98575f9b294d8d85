"""How often, how fast and at what price seeds become solutions that survive outages.

What mapped seeds come to: one row per case and mapping, one per strategy and mapping.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from core.nlp import SolveSettings
from core.problem import Problem
from core.search import MAPPINGS
from workers.executor import Executor
from workers.measure_solves import (
    Case,
    Measurement,
    Solution,
    costs,
    failures,
    in_order,
    measured,
    outcomes,
    seed_job,
    share,
    spread,
    warm,
)
from workers.messages import MapJob


@dataclass(frozen=True, slots=True)
class ChainPlan:
    """The seeds, cases and mappings that are to be combined, each with each."""

    #: Solutions of P_0.
    seeds: tuple[Solution, ...]
    cases: tuple[Case, ...]
    #: Where a case is fed by another, the first of these that solved that one gives the seed.
    mappings: tuple[str, ...] = MAPPINGS
    duration_days: float = 1.0
    limits: SolveSettings = field(default_factory=SolveSettings)

    def __post_init__(self) -> None:
        """Sort the cases, and check the plan."""
        _check_seeds(self.seeds)
        check_mappings(self.mappings)
        object.__setattr__(self, "cases", tuple(in_order(list(self.cases))))
        for case in self.cases:
            self.problem(case)

    @property
    def reference(self) -> Problem:
        """P_0."""
        return self.seeds[0].problem

    def problem(self, case: Case) -> Problem:
        """Return P_k of a case."""
        return case.problem(self.reference, self.duration_days)


def check_mappings(mappings: tuple[str, ...]) -> None:
    """Check the names of mappings."""
    for mapping in mappings:
        if mapping not in MAPPINGS:
            raise ValueError(f"mapping: expected one of {', '.join(MAPPINGS)}, got {mapping!r}")


def _check_seeds(seeds: tuple[Solution, ...]) -> None:
    if not seeds:
        raise ValueError("seeds: expected at least one solution of P_0, got none")
    for seed in seeds:
        if seed.problem.k:
            raise ValueError(f"seeds: expected solutions of P_0, got one of P_{seed.problem.k}")
    if len({seed.number for seed in seeds}) < len(seeds):
        raise ValueError("seeds: expected different numbers, got one twice")


@dataclass(frozen=True, slots=True)
class Link:
    """One seed that is to be mapped."""

    case: Case
    mapping: str
    #: Under the number of the solution of P_0 that it descends from.
    seed: Solution
    #: The case whose solution the seed is; None for a solution of P_0.
    seed_case: Case | None


@dataclass(frozen=True, slots=True)
class SolvedLink:
    """One seed, and what its solve measured."""

    link: Link
    measurement: Measurement
    #: The decision vector of a strict solution [days, rad, kg].
    x: tuple[float, ...] | None

    @property
    def change_kg(self) -> float | None:
        """Propellant that the outages cost above that of the seed; negative where it sank [kg]."""
        if self.x is None or self.measurement.propellant_kg is None:
            return None
        return self.measurement.propellant_kg - self.link.seed.propellant_kg


def warm_up_links(executor: Executor, plan: ChainPlan) -> None:
    """Let every process compile and load what each mapping needs, before anything is timed."""
    case, seed = plan.cases[0], plan.seeds[0]
    assert case.k_from == 0  # Cases that need no other come first.
    warm(executor, [_job(plan, Link(case, mapping, seed, None), 0) for mapping in plan.mappings])


def solve_links(executor: Executor, plan: ChainPlan) -> Iterator[SolvedLink]:
    """Solve every seed for every case by every mapping, and yield each as it ends.

    The seeds take turns, so that a run that is cut short has seen all cases.  A case with seeds from another
    waits until all of those are solved.
    """
    solved: list[SolvedLink] = []
    for k_from in sorted({case.k_from for case in plan.cases}):
        links = list(_links(plan, k_from, solved))
        jobs = ((number, _job(plan, link, number)) for number, link in enumerate(links))
        for number, outcome in outcomes(executor, jobs):
            link = links[number]
            one = SolvedLink(link, *measured(plan.problem(link.case), outcome))
            solved.append(one)
            yield one


def n_links(plan: ChainPlan) -> int:
    """Return how many seeds there are to map at most."""
    feeders = [
        1 if case.k_from == 0 else sum(case.is_fed_by(other) for other in plan.cases) for case in plan.cases
    ]
    return len(plan.seeds) * len(plan.mappings) * sum(feeders)


def _links(plan: ChainPlan, k_from: int, solved: list[SolvedLink]) -> Iterator[Link]:
    cases = [case for case in plan.cases if case.k_from == k_from]
    for seed in plan.seeds:
        for case in cases:
            for mapping in plan.mappings:
                if k_from == 0:
                    yield Link(case, mapping, seed, None)
                else:
                    yield from (Link(case, mapping, *fed) for fed in _feeders(plan, case, seed, solved))


def _feeders(
    plan: ChainPlan, case: Case, root: Solution, solved: list[SolvedLink]
) -> Iterator[tuple[Solution, Case]]:
    """Return the solutions that descend from a seed and feed a case: one per feeding case."""
    for feeder in (other for other in plan.cases if case.is_fed_by(other)):
        found = [
            one
            for one in solved
            if one.x is not None and one.link.case == feeder and one.link.seed.number == root.number
        ]
        found.sort(key=lambda one: plan.mappings.index(one.link.mapping))
        if found:
            yield solution_of_link(plan, found[0]), feeder


def solution_of_link(plan: ChainPlan, one: SolvedLink) -> Solution:
    """Return a strict solution under the number of the seed of P_0 that it descends from."""
    assert one.x is not None and one.measurement.propellant_kg is not None
    problem, found = plan.problem(one.link.case), one.measurement
    return Solution(one.link.seed.number, problem, one.x, one.measurement.propellant_kg, found.is_optimal)


def _job(plan: ChainPlan, link: Link, number: int) -> MapJob:
    seed = link.seed
    return seed_job(plan.problem(link.case), seed.problem, seed.x, link.mapping, number, plan.limits)


def by_case(plan: ChainPlan, solved: Sequence[SolvedLink]) -> list[dict[str, Any]]:
    """Return what each case came to by each mapping, in the order of the plan."""
    rows = []
    for case in plan.cases:
        for mapping in plan.mappings:
            own = [one for one in solved if one.link.case == case and one.link.mapping == mapping]
            rows.append({"case": case.name, "group": case.group, "mapping": mapping} | row(own))
    return rows


def by_group(plan: ChainPlan, solved: Sequence[SolvedLink]) -> list[dict[str, Any]]:
    """Return what each strategy came to by each mapping, over all its cases."""
    rows = []
    for group in dict.fromkeys(case.group for case in plan.cases):
        for mapping in plan.mappings:
            own = [one for one in solved if one.link.case.group == group and one.link.mapping == mapping]
            least = [row(_of(own, name))["strict"]["value"] for name in _names(own)]
            rows.append(
                {"group": group, "mapping": mapping, "least_share_of_a_case": min(least, default=None)}
                | row(own)
            )
    return rows


def _names(solved: Iterable[SolvedLink]) -> list[str]:
    return list(dict.fromkeys(one.link.case.name for one in solved))


def _of(solved: Iterable[SolvedLink], name: str) -> list[SolvedLink]:
    return [one for one in solved if one.link.case.name == name]


def row(solved: Sequence[SolvedLink]) -> dict[str, Any]:
    """Return the numbers of a set of mapped seeds as plain data; CPU times in s, propellant in kg."""
    found = [one.measurement for one in solved]
    strict = [one for one in found if one.strict]
    return {
        "paper": share(sum(one.paper for one in found), len(found)),
        "strict": share(len(strict), len(found)),
        "optimal": share(sum(one.is_optimal for one in strict), len(strict)),
        "costs": costs(found),
        "cpu_seconds": spread(one.cpu_seconds for one in found),
        "cpu_seconds_of_strict": spread(one.cpu_seconds for one in strict),
        "iterations": spread(one.n_iterations for one in found),
        "change_kg": spread(one.change_kg for one in solved),
        "propellant_kg": spread(one.propellant_kg for one in strict),
        "stationarity": spread(one.stationarity for one in strict),
        "failed_by": failures(found),
        "faults": sorted({one.fault for one in found if one.fault}),
    }


def as_fields(one: SolvedLink) -> dict[str, Any]:
    """Return one mapped seed as plain data."""
    link = one.link
    return {
        "case": link.case.name,
        "mapping": link.mapping,
        "seed": link.seed.number,
        "seed_case": link.seed_case.name if link.seed_case else None,
        "seed_propellant_kg": link.seed.propellant_kg,
        "change_kg": one.change_kg,
    } | asdict(one.measurement)
