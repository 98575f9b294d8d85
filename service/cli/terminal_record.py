"""One solution for the terminal: what it is, how well it holds, and where it comes from."""

from collections.abc import Iterator

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from service.cli.terminal import level_of, table
from service.schemas.solution import Record

#: Rows of a defect: what they are of, and their unit.
PARTS = {"km": slice(0, 3), "km/s": slice(3, 6), "kg": slice(6, 7)}


def print_record(console: Console, record: Record) -> None:
    """Print a solution but for its vector, which is in the JSON."""
    console.print(Text.assemble((record.id, "bold"), f"  {record.strategy}, verified as {level_of(record)}"))
    for name, words in _facts(record):
        console.print(Text.assemble((f"{name:<15}", "bold"), words), soft_wrap=True)
    console.print(_defects(record))


def _facts(record: Record) -> Iterator[tuple[str, str]]:
    outages = [f"{outage.duration_days:g} d at segment {outage.segment}" for outage in record.outages]
    yield "outages", ", ".join(outages) or "none"
    spent = f"{record.delta_v_total_km_s:.4f} km/s with what came before it"
    yield "delta-v", f"{record.delta_v_km_s:.4f} km/s; {spent}"
    yield "propellant", f"{record.propellant_kg:.2f} kg; {record.objective_kg:.2f} kg arrive"
    parts = (record.initial_coast_days, record.shooting_days, record.final_coast_days)
    first, thrust, last = (f"{days:.2f}" for days in parts)
    shares = f"{first} coast, {thrust} thrust, {last} coast"
    yield "time of flight", f"{record.time_of_flight_days:.2f} d: {shares}"
    yield "insertion", f"{record.insertion_epoch} TDB"
    yield "arrival", f"{record.arrival_epoch} TDB"
    lowest = (("Earth", record.earth_altitude_km), ("Moon", record.moon_altitude_km))
    passes = [f"{altitude:,.0f} km over the {body}" for body, altitude in lowest if altitude is not None]
    yield "lowest", ", ".join(passes) or "not looked at; `coastarc solutions verify` does"
    yield "problem", record.problem_hash
    yield "found by", f"search {record.search} of campaign {record.campaign_id}"
    yield "seed", f"{record.seed_id}, mapped by {record.mapping}" if record.seed_id else "none: drawn"
    yield "random key", record.rng_key
    effort = f"{record.n_iterations} iterations, {record.n_evaluations} evaluations"
    yield "solver", f"{record.status}: {effort}, {record.cpu_seconds:.1f} s of CPU"
    yield "on", f"{record.host}, {record.created_at:%Y-%m-%d %H:%M} UTC"
    yield "code", record.code_version
    yield "packages", ", ".join(f"{name} {version}" for name, version in record.package_versions.items())
    yield "kernels", ", ".join(f"{name} {digest}" for name, digest in record.kernel_hashes.items())


def _defects(record: Record) -> Table:
    """Return the norms of the defects at the matchpoints, solved beside verified."""
    columns = [f"{by}\n{unit}" for by in ("solved", "verified") for unit in PARTS]
    rows = table("defects of", *columns)
    for i, pair in enumerate(zip(record.defects_solved, record.defects_verified, strict=True)):
        norms = [f"{norm:.1e}" for row in pair for norm in _norms(row)]
        rows.add_row(f"realization {i}" if i else "reference", *norms)
    return rows


def _norms(row: list[float]) -> list[float]:
    return [float(np.linalg.norm(row[part])) for part in PARTS.values()]
