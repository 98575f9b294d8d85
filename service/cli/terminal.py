"""What a campaign came to, as tables for the terminal."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

from rich import box
from rich.table import Table
from rich.text import Text

from core.analysis.metrics import feasibility_ratio
from service.db.transitions import ENDED
from service.schemas.campaign import CampaignItem, CampaignView
from service.schemas.job import JobView, WorkerView
from service.schemas.search import SearchView
from service.schemas.solution import Record, SeedPage

SUMMARY_COLUMNS = ("search", "strategy", "solves", "paper, %", "strict, %", "found", "kg", "km/s", "CPU, s")


def table(*columns: str, title: str | None = None) -> Table:
    """Return a table in the house's style: light, so that eighty columns hold a campaign."""
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
    rows.caption = f"shares with 95 % interval; {strict}"
    rows.caption_justify = "left"
    return rows


def ratio(n_feasible: int, n_guesses: int) -> str:
    """Return a feasibility ratio and, on a line of its own, its interval, in percent."""
    if n_guesses == 0:
        return "-"
    share = feasibility_ratio(n_feasible, n_guesses)
    return f"{100 * share.value:.1f}\n{100 * share.low:.3g}-{100 * share.high:.3g}"


def progress(view: CampaignView) -> Table:
    """Return what changes while a campaign runs."""
    gone = _duration(view.elapsed_seconds)
    title = f"{view.name}: {gone} gone, {_left(view)} left, {view.rate_per_min:.1f} solves/min"
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
    """Return the same in one line, for logs: the searches that go on, and how many have ended."""
    parts = [
        f"{search.name} {_solves(search)} solves, {search.n_strict} strict"
        for search in view.searches
        if search.state == "active"
    ]
    n_ended = sum(search.state in ENDED for search in view.searches)
    parts.append(f"{n_ended} of {len(view.searches)} searches done, {view.n_solutions} solutions")
    return f"{_duration(view.elapsed_seconds)}: " + "; ".join(parts)


def campaign_list(items: Sequence[CampaignItem]) -> Table:
    """Return the campaigns, with rate and time left of those that go on."""
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
    """Return workers and how long their shortest leases still run."""
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
    """Return in which order and by which weights the searches of a campaign share the workers."""
    rows = table("search", "strategy", "state", "priority", "weight", title=f"priority {campaign.priority}")
    for search in campaign.searches:
        share = (str(search.priority), f"{search.weight:g}")
        rows.add_row(search.name, search.strategy, search.state, *share)
    return rows


def dead_jobs(jobs: Sequence[JobView]) -> Table:
    """Return jobs that were given up, with the first line of the reason."""
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
    """Return the tolerance that a solution holds, and whether only just."""
    level = "strict" if record.strict else "paper" if record.paper else "infeasible"
    return f"{level}, marginal" if record.is_marginal else level


def _shown(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _duration(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))
