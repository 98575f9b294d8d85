"""What mapped seeds come to: one row per case and mapping, one per strategy and mapping."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from workers.bench_chain import ChainPlan, SolvedLink
from workers.bench_summary import costs, failures, share, spread


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
