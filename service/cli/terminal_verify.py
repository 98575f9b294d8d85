"""Certificates for the terminal: how far a verification is, what it came to, and one certificate in full."""

from collections.abc import Sequence
from datetime import timedelta

from rich.console import Console
from rich.table import Table
from rich.text import Text

from service.cli.terminal import table
from service.solutions.verification import Summary, Verified
from workers.certify import CertificateDocument, CertifiedApproach, CertifiedThird, CertifiedTrajectory


def progress_line(items: Sequence[Verified], n: int, gone_s: float) -> str:
    """Return how far a verification is."""
    n_failed = sum(not item.is_good for item in items)
    left = timedelta(seconds=round(gone_s / len(items) * (n - len(items))))
    return f"{len(items)} of {n} verified, {n_failed} failed, {gone_s / len(items):.1f} s each, {left} left"


def verified_list(items: Sequence[Verified]) -> Table:
    """Return one row per solution."""
    rows = table("solution", "level", "good", "arrival miss, km", "Earth, km", "Moon, km", "certificate")
    for item in items:
        numbers = (item.arrival_miss_km, item.earth_altitude_km, item.moon_altitude_km)
        shown = ["-" if number is None else f"{number:,.3f}" for number in numbers]
        rows.add_row(
            item.solution_id[:8], item.level, "yes" if item.is_good else "NO", *shown, (item.hash or "-")[:8]
        )
    return rows


def summary_line(summary: Summary) -> str:
    """Return what a verification came to."""
    misses = sorted(item.arrival_miss_km for item in summary.items if item.arrival_miss_km is not None)
    parts = [f"{summary.n_verified} verified, {summary.n_failed} failed"]
    if summary.n_skipped:
        parts.append(f"{summary.n_skipped} left out, found sound before")
    if misses:
        middle = misses[len(misses) // 2]
        parts.append(f"miss at arrival: median {middle:.3g} km, largest {misses[-1]:.3g} km")
    thirds = [item.third_apart_km for item in summary.items if item.third_apart_km is not None]
    if thirds:
        parts.append(f"heyoka is at most {max(thirds):.3g} km away")
    if not summary.is_complete:
        parts.append("interrupted; what was done is kept, and --stale goes on with the rest")
    return "; ".join(parts) + "."


def print_certificate(console: Console, found: CertificateDocument | None) -> None:
    """Print the certificate of a solution, or that it has none."""
    if found is None:
        console.print("certificate: none; make one with `coastarc solutions verify`", markup=False)
        return
    content = found.content
    verdict = "sound" if content.is_sound else "NOT SOUND"
    level = f"{content.level}, marginal" if content.is_marginal else content.level
    head = f": {found.hash}, {level}, {verdict}, {found.made_at:%Y-%m-%d %H:%M} UTC"
    if found.is_from_elsewhere:
        head += f", made elsewhere, on {found.made_on}"
    console.print(Text.assemble(("certificate", "bold"), head), soft_wrap=True)
    for reason in (*content.marks, content.failure):
        if reason:
            console.print(f"  {reason}", soft_wrap=True, markup=False)
    rows = table("trajectory", "defect, km", "miss at arrival", "Earth", "Moon", "propellant", "arrives with")
    for trajectory in content.trajectories:
        rows.add_row(*_row(trajectory))
    rows.caption = "defect at the matchpoint; miss if nothing is corrected; lowest altitudes"
    rows.caption_justify = "left"
    console.print(rows)
    if content.third is not None:
        _print_third(console, content.third, [trajectory.name for trajectory in content.trajectories])


def _print_third(console: Console, third: CertifiedThird, names: Sequence[str]) -> None:
    """Print how far the third flights are from the second, and from the target."""
    console.print(f"flown through by {third.integrator} {third.version}:", soft_wrap=True, markup=False)
    for name, flown in zip(names, third.trajectories, strict=True):
        told = f"{_km(flown.apart[0])} from SciPy's flight, {_km(flown.arrival_miss[0])} from the target"
        console.print(f"  {name}: {flown.failure or told}", soft_wrap=True, highlight=False, markup=False)


def _km(distance: float | None) -> str:
    return "-" if distance is None else f"{distance:.3g} km"


def _row(flown: CertifiedTrajectory) -> list[str]:
    miss, mass = flown.through.arrival_miss[0], flown.mass
    return [
        flown.name,
        "-" if flown.position_km is None else f"{flown.position_km:.2g}",
        flown.through.failure or f"{miss or 0.0:.3g} km",
        *(_altitude(flown.closest, body) for body in ("Earth", "Moon")),
        f"{mass.before_outage + mass.segments:.2f} kg",
        f"{mass.arrival:.2f} kg",
    ]


def _altitude(closest: Sequence[CertifiedApproach], body: str) -> str:
    return next((f"{one.altitude_km:,.0f} km" for one in closest if one.body == body), "-")
