"""Tables for the terminal: campaigns, workers and jobs, one solution, and certificates."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from math import hypot
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from core.analysis.metrics import feasibility_ratio
from core.world import world_from
from service.db.transitions import ENDED
from service.schemas.campaign import CampaignItem, CampaignView
from service.schemas.job import JobView, WorkerView
from service.schemas.search import SearchView
from service.schemas.solution import Record, RecordWithVector, SeedPage
from workers.certificate import CertificateDocument, CertifiedApproach, CertifiedThird, CertifiedTrajectory

if TYPE_CHECKING:
    from service.solutions.verification import Summary, Verified

SUMMARY_COLUMNS = ("search", "strategy", "solves", "loose, %", "strict, %", "found", "kg", "km/s", "CPU, s")

#: What users call each level of tolerance; files, the API and options call the loose one `paper`.
LEVELS = {"strict": "strict", "paper": "loose"}


def table(*columns: str, title: str | None = None) -> Table:
    """Return a table in the common style: light, so that eighty columns hold a campaign."""
    rows = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in columns:
        rows.add_column(column, overflow="fold")
    return rows


def summary(view: CampaignView) -> Table:
    """Return one row per search: shares of feasible solves, 95 % Wilson intervals, and the best found."""
    cpu = _duration(view.cpu_seconds)
    title = f"{view.name}: {view.state}, {view.n_solutions} solutions, {cpu} of CPU time"
    rows = table(*SUMMARY_COLUMNS, title=title)
    for search in view.searches:
        rows.add_row(
            search.name,
            search.strategy,
            _solves(search),
            ratio(search.n_paper, search.n_solves),
            ratio(search.n_strict, search.n_solves),
            str(search.n_solutions),
            _shown(search.best_propellant_kg, 2),
            _shown(search.best_delta_v_km_s, 4),
            _shown(search.cpu_seconds / search.n_strict if search.n_strict else None, 1),
        )
    strict = "least propellant and delta-v of strict solutions; CPU time per one"
    world = world_from(view.problem)
    rows.caption = f"shares with 95 % interval; {strict}\nloose: {world.loose}; strict: {world.strict}"
    rows.caption_justify = "left"
    return rows


def ratio(n_feasible: int, n_guesses: int) -> str:
    """Return a feasibility ratio and, on a line of its own, its interval, in percent."""
    if n_guesses == 0:
        return "-"
    share = feasibility_ratio(n_feasible, n_guesses)
    return f"{100 * share.value:.1f}\n{100 * share.low:.3g}-{100 * share.high:.3g}"


def progress(view: CampaignView) -> Table:
    """Return the progress of a campaign."""
    gone = _duration(view.elapsed_seconds)
    title = f"{view.name}: {gone} elapsed, {_left(view)} left, {view.rate_per_min:.1f} solves/min"
    rows = table("search", "strategy", "solves", "running", "strict", "best, kg", title=title)
    for search in view.searches:
        rows.add_row(
            search.name,
            search.strategy,
            _solves(search),
            str(search.jobs.running) if search.state == "active" else search.state,
            str(search.n_strict),
            _shown(search.best_propellant_kg, 2),
        )
    return rows


def _solves(search: SearchView) -> str:
    planned = "open" if search.n_guesses_planned is None else str(search.n_guesses_planned)
    return f"{search.n_solves}/{planned}"


def progress_line(view: CampaignView) -> str:
    """Return the same in one line, for logs: the running searches, and how many have ended."""
    parts = [
        f"{search.name} {_solves(search)} solves, {search.n_strict} strict"
        for search in view.searches
        if search.state == "active"
    ]
    n_ended = sum(search.state in ENDED for search in view.searches)
    parts.append(f"{n_ended} of {len(view.searches)} searches done, {view.n_solutions} solutions")
    return f"{_duration(view.elapsed_seconds)}: " + "; ".join(parts)


def campaign_list(items: Sequence[CampaignItem]) -> Table:
    """Return the campaigns, with rate and time left of those that run."""
    rows = table("id", "name", "state", "jobs", "solves", "found", "best, km/s", "1/min", "left")
    for item in items:
        best = _shown(item.best_delta_v_km_s, 4)
        counts = (f"{item.n_done}/{item.n_jobs}", str(item.n_solves), str(item.n_solutions))
        is_running = isinstance(item, CampaignView) and item.state == "active"
        rate = f"{item.rate_per_min:.1f}" if isinstance(item, CampaignView) and is_running else "-"
        left = _left(item) if isinstance(item, CampaignView) and is_running else "-"
        rows.add_row(str(item.id), item.name, item.state, *counts, best, rate, left)
    return rows


def _left(view: CampaignView) -> str:
    return "unknown" if view.eta_seconds is None else _duration(view.eta_seconds)


def worker_list(workers: Sequence[WorkerView]) -> Table:
    """Return workers, with the time until the first of their leases expires."""
    rows = table("worker", "executor", "slots", "jobs", "seen, s ago", "lease, s")
    now = datetime.now(UTC)
    for worker in workers:
        leases = [(held.lease_until - now).total_seconds() for held in worker.held]
        seen = max(0.0, (now - worker.seen_at).total_seconds())
        lease = f"{min(leases):.0f}" if leases else "-"
        counts = (str(worker.slots), str(len(worker.held)))
        rows.add_row(worker.name, worker.executor, *counts, f"{seen:.0f}", lease)
    return rows


def shares(campaign: CampaignView) -> Table:
    """Return the priorities and weights of the searches of a campaign."""
    rows = table("search", "strategy", "state", "priority", "weight", title=f"priority {campaign.priority}")
    for search in campaign.searches:
        share = (str(search.priority), f"{search.weight:g}")
        rows.add_row(search.name, search.strategy, search.state, *share)
    return rows


def dead_jobs(jobs: Sequence[JobView]) -> Table:
    """Return jobs that will not be retried, with the first line of the reason."""
    rows = table("dead job", "campaign", "attempts", "ending", "reason")
    for job in jobs:
        rows.add_row(
            str(job.id), str(job.campaign_id), str(job.attempt), job.ending or "-", Text(job.error or "-")
        )
    return rows


def seed_list(page: SeedPage) -> Table:
    """Return seeds in the order in which they would be mapped."""
    shown = f"{len(page.items)} pairs of seed and mapping, from {page.n_candidates} solutions"
    rows = table("seed", "k", "km/s", "days", "for", "mapping", "job", title=shown)
    for seed in page.items:
        target = " ".join(f"{outage.segment}:{outage.duration_days:g}" for outage in seed.outages)
        rows.add_row(
            seed.seed_id[:8],
            str(len(seed.seed_outages)),
            _shown(seed.delta_v_km_s, 4),
            _shown(seed.time_of_flight_days, 2),
            target,
            seed.mapping,
            "-" if seed.job_id is None else f"{seed.job_id} {seed.job_state}",
        )
    return rows


def solution_list(records: Sequence[Record]) -> Table:
    """Return solutions, one row each."""
    rows = table("id", "search", "k", "kg", "km/s", "days", "insertion", "defects", "seed")
    for record in records:
        rows.add_row(
            record.id[:8],
            record.search,
            str(record.k),
            _shown(record.propellant_kg, 2),
            _shown(record.delta_v_km_s, 4),
            _shown(record.time_of_flight_days, 2),
            record.insertion_epoch[:10],
            level_of(record),
            (record.seed_id or "-")[:8],
        )
    return rows


def level_of(record: Record) -> str:
    """Return the tolerance level of a solution, and whether it is marginal."""
    level = "strict" if record.strict else "loose" if record.paper else "infeasible"
    return f"{level}, marginal" if record.is_marginal else level


def _shown(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _duration(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))


#: Rows of a defect by their unit.
PARTS = {"km": slice(0, 3), "km/s": slice(3, 6), "kg": slice(6, 7)}


def print_record(console: Console, record: RecordWithVector) -> None:
    """Print a solution without its vector, which is in the JSON."""
    console.print(Text.assemble((record.id, "bold"), f"  {record.strategy}, verified as {level_of(record)}"))
    for name, words in _facts(record):
        console.print(Text.assemble((f"{name:<15}", "bold"), words), soft_wrap=True)
    console.print(_defects(record))


def _facts(record: RecordWithVector) -> Iterator[tuple[str, str]]:
    outages = [f"{outage.duration_days:g} d at segment {outage.segment}" for outage in record.outages]
    yield "outages", ", ".join(outages) or "none"
    spent = f"{record.delta_v_total_km_s:.4f} km/s from the wet mass on"
    yield "delta-v", f"{record.delta_v_km_s:.4f} km/s; {spent}"
    yield "propellant", f"{record.propellant_kg:.2f} kg; {record.objective_kg:.2f} kg arrive"
    parts = (record.initial_coast_days, record.shooting_days, record.final_coast_days)
    first, thrust, last = (f"{days:.2f}" for days in parts)
    shares = f"{first} coast, {thrust} thrust, {last} coast"
    yield "time of flight", f"{record.time_of_flight_days:.2f} d: {shares}"
    yield "insertion", f"{record.insertion_epoch} TDB"
    yield "arrival", f"{record.arrival_epoch} TDB"
    passes = [f"{altitude:,.0f} km over the {body}" for body, altitude in _lowest(record)]
    yield "lowest", ", ".join(passes) or "not computed; `coastarc solutions verify` does it"
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


def _lowest(record: RecordWithVector) -> list[tuple[str, float]]:
    """Return the bodies and how low a solution passes [km]; earlier versions and imports may say nothing."""
    known = record.verification.get("lowest_km")
    altitudes = known.items() if isinstance(known, dict) else ()
    return [(body, altitude) for body, altitude in altitudes if isinstance(altitude, float | int)]


def _defects(record: Record) -> Table:
    """Return the norms of the defects at the matchpoints, by the solver and by the verifier."""
    columns = [f"{by}\n{unit}" for by in ("solved", "verified") for unit in PARTS]
    rows = table("defects of", *columns)
    for i, pair in enumerate(zip(record.defects_solved, record.defects_verified, strict=True)):
        norms = [f"{norm:.1e}" for row in pair for norm in _norms(row)]
        rows.add_row(f"realization {i}" if i else "reference", *norms)
    return rows


def _norms(row: list[float]) -> list[float]:
    return [hypot(*row[part]) for part in PARTS.values()]


def verify_progress_line(items: "Sequence[Verified]", n: int, gone_s: float) -> str:
    """Return the progress of a verification."""
    n_failed = sum(not item.is_good for item in items)
    left = timedelta(seconds=round(gone_s / len(items) * (n - len(items))))
    return f"{len(items)} of {n} verified, {n_failed} failed, {gone_s / len(items):.1f} s each, {left} left"


def verified_list(items: "Sequence[Verified]") -> Table:
    """Return one row per solution."""
    passed = {
        "Earth": [one.earth_altitude_km for one in items],
        "Moon": [one.moon_altitude_km for one in items],
    }
    # Far from both there is nothing to tell of them.
    passed = {body: altitudes for body, altitudes in passed.items() if set(altitudes) != {None}}
    columns = ("arrival miss, km", *(f"{body}, km" for body in passed))
    rows = table("solution", "level", "good", *columns, "certificate")
    for item, *altitudes in zip(items, *passed.values(), strict=True):
        numbers = (item.arrival_miss_km, *altitudes)
        shown = ["-" if number is None else f"{number:,.3f}" for number in numbers]
        rows.add_row(
            item.solution_id[:8],
            LEVELS.get(item.level, item.level),
            "yes" if item.is_good else "NO",
            *shown,
            (item.hash or "-")[:8],
        )
    return rows


def summary_line(summary: "Summary") -> str:
    """Return the totals of a verification."""
    misses = sorted(item.arrival_miss_km for item in summary.items if item.arrival_miss_km is not None)
    parts = [f"{summary.n_verified} verified, {summary.n_failed} failed"]
    if summary.n_skipped:
        parts.append(f"{summary.n_skipped} skipped, found sound before")
    if misses:
        middle = misses[len(misses) // 2]
        parts.append(f"miss at arrival: median {middle:.3g} km, largest {misses[-1]:.3g} km")
    thirds = [item.third_apart_km for item in summary.items if item.third_apart_km is not None]
    if thirds:
        parts.append(f"heyoka differs by at most {max(thirds):.3g} km")
    if not summary.is_complete:
        parts.append("interrupted; results are kept, and --stale verifies the rest")
    return "; ".join(parts) + "."


def print_certificate(console: Console, found: CertificateDocument | None) -> None:
    """Print the certificate of a solution, or that it has none."""
    if found is None:
        console.print("certificate: none; make one with `coastarc solutions verify`", markup=False)
        return
    content = found.content
    verdict = "sound" if content.is_sound else "NOT SOUND"
    level = LEVELS.get(content.level, content.level) + (", marginal" if content.is_marginal else "")
    head = f": {found.hash}, {level}, {verdict}, {found.made_at:%Y-%m-%d %H:%M} UTC"
    if found.is_from_elsewhere:
        head += f", made elsewhere, on {found.made_on}"
    console.print(Text.assemble(("certificate", "bold"), head), soft_wrap=True)
    for reason in (*content.marks, content.failure):
        if reason:
            console.print(f"  {reason}", soft_wrap=True, markup=False)
    closest = (approach for trajectory in content.trajectories for approach in trajectory.closest)
    bodies = list(dict.fromkeys(approach.body for approach in closest))
    rows = table("trajectory", "defect, km", "miss at arrival", *bodies, "propellant", "arrives with")
    for trajectory in content.trajectories:
        rows.add_row(*_row(trajectory, bodies))
    rows.caption = "defect at the matchpoint; miss if nothing is corrected; lowest altitudes"
    rows.caption_justify = "left"
    console.print(rows)
    if content.third is not None:
        _print_heyoka_check(console, content.third, [trajectory.name for trajectory in content.trajectories])


def _print_heyoka_check(console: Console, third: CertifiedThird, names: Sequence[str]) -> None:
    """Print how far heyoka's trajectories are from SciPy's, and from the target."""
    console.print(
        f"propagated end to end by {third.integrator} {third.version}:", soft_wrap=True, markup=False
    )
    for name, flown in zip(names, third.trajectories, strict=True):
        apart = f"{_km(flown.apart[0])} from SciPy's, {_km(flown.arrival_miss[0])} from the target"
        console.print(f"  {name}: {flown.failure or apart}", soft_wrap=True, highlight=False, markup=False)


def _km(distance: float | None) -> str:
    return "-" if distance is None else f"{distance:.3g} km"


def _row(flown: CertifiedTrajectory, bodies: Sequence[str]) -> list[str]:
    miss, mass = flown.through.arrival_miss[0], flown.mass
    return [
        flown.name,
        "-" if flown.position_km is None else f"{flown.position_km:.2g}",
        flown.through.failure or f"{miss or 0.0:.3g} km",
        *(_altitude(flown.closest, body) for body in bodies),
        f"{mass.before_outage + mass.segments:.2f} kg",
        f"{mass.arrival:.2f} kg",
    ]


def _altitude(closest: Sequence[CertifiedApproach], body: str) -> str:
    return next((f"{one.altitude_km:,.0f} km" for one in closest if one.body == body), "-")
