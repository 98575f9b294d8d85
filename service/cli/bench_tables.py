"""Tables of what `coastarc bench` measured."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from core.analysis.metrics import delta_v_km_s
from core.orbits import departure_state
from core.orbits.reach import reach_of
from core.problem import Problem
from service.cli import terminal
from workers.measure_solves import FailureView, SolvedGuess, spread


def percent(part: Mapping[str, Any]) -> str:
    """Return a share and its interval [%]."""
    if not part["of"]:
        return "-"
    return f"{100 * part['value']:.1f} ({100 * part['low']:.0f}-{100 * part['high']:.0f})"


def number(value: float | None, digits: int = 1) -> str:
    """Return a number, or a dash for none."""
    return "-" if value is None else f"{value:.{digits}f}"


def shares(summary: Mapping[str, Any]) -> Table:
    """Return counts, shares and costs of the kinds of solutions."""
    rows = terminal.table("guesses that became", "of", "%, 95 % interval", "CPU s each")
    costs = summary["costs"]
    for name, key, cost in (
        ("loose solutions", "paper", None),
        ("strict solutions", "strict", costs["cpu_seconds_per_strict"]),
        ("strict and locally optimal solutions", "optimal", costs["cpu_seconds_per_optimal"]),
    ):
        part = summary[key]
        rows.add_row(f"{part['n']} {name}", str(part["of"]), percent(part), number(cost, 2))
    rows.caption = "CPU time of all guesses, failures included; verification apart"
    rows.caption_justify = "left"
    return rows


def distributions(summary: Mapping[str, Any]) -> Table:
    """Return the spread of times, iterations and propellant of successes and of failures."""
    rows = terminal.table("", "", "min", "quarter", "median", "3 quarters", "max")
    for group in ("successes", "failures"):
        for name, key, digits in (
            ("CPU s", "cpu_seconds", 2),
            ("iterations", "iterations", 0),
            ("propellant, kg", "propellant_kg", 2),
        ):
            spread = summary[group][key]
            if spread is not None:
                rows.add_row(group, name, *(number(value, digits) for value in spread.values()))
    return rows


def failures(failed_by: Mapping[str, int]) -> str:
    """Return why solves failed, in one line."""
    listed = ", ".join(f"{count} {name}" for name, count in failed_by.items())
    return f"failures: {listed or 'none'}"


def reasons(listed: Sequence[FailureView]) -> Table:
    """Return how many guesses failed in which way, how far from closed, and what held them back."""
    rows = terminal.table("failure", "", "km", "m/s", "at their bounds")
    for one in listed:
        rows.add_row(
            f"{one.n} {one.failure}",
            one.reason,
            "-" if one.defect_km is None else f"{one.defect_km:.3g}",
            "-" if one.defect_m_s is None else f"{one.defect_m_s:.3g}",
            ", ".join(one.at_bounds) or "none",
        )
    rows.caption = "medians of the largest defects; fields whose bounds hold the first of them back"
    rows.caption_justify = "left"
    return rows


def thrust_line(problem: Problem, solved: Sequence[SolvedGuess]) -> str:
    """Return what the thrust reaches beside what it has to."""
    reach = reach_of(problem)
    used = spread(
        delta_v_km_s(problem.spacecraft, start, start - one.measurement.propellant_kg)
        for start in (departure_state(problem.departure, problem.spacecraft).mass_kg,)
        for one in solved
        if one.measurement.strict and one.measurement.propellant_kg is not None
    )
    least = f"; no transfer needs less than {reach.needed_km_s:.3g} km/s" if reach.needed_km_s else ""
    median = f"; strict solutions use {used['median']:.3g} km/s (median)" if used else ""
    return f"thrust: at most {reach.reachable_km_s:.3g} km/s{least}{median}"


def chains(listed: list[dict[str, Any]], key: str) -> Table:
    """Return mapped seeds, one row per case or group and mapping."""
    titles = (key, "mapping", "seeds", "strict, %", "optimal, %", "CPU s each", "median s", "of strict")
    rows = terminal.table(*titles, "change in kg", "failures")
    for row in listed:
        change = row["change_kg"]
        spread = (
            "-" if change is None else " ".join(f"{change[name]:+.2f}" for name in ("min", "median", "max"))
        )
        failed = ", ".join(f"{count} {name}" for name, count in row["failed_by"].items())
        rows.add_row(
            row[key],
            row["mapping"],
            str(row["strict"]["of"]),
            percent(row["strict"]),
            percent(row["optimal"]),
            number(row["costs"]["cpu_seconds_per_strict"], 2),
            *(
                number(times and times["median"], 2)
                for times in (row["cpu_seconds"], row["cpu_seconds_of_strict"])
            ),
            spread,
            failed,
        )
    rows.caption = (
        "strict of seeds and locally optimal of strict, 95 % interval; CPU time of all seeds per strict "
        "solution, medians of all and of strict; least, median and greatest propellant above the seed's"
    )
    rows.caption_justify = "left"
    return rows
