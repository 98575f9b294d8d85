"""What a campaign came to, as tables for the terminal."""

from datetime import timedelta

from rich.console import Console
from rich.table import Table

from core.analysis.metrics import feasibility_ratio
from service.api.schemas import CampaignItem, CampaignView, Record, SearchView

SUMMARY_COLUMNS = (
    "search",
    "strategy",
    "state",
    "solves",
    "feasible, paper tolerance",
    "feasible, strict",
    "solutions",
    "propellant, best",
    "delta-v, best",
    "CPU per solution",
)


def summary(view: CampaignView) -> Table:
    """Return one row per search: ratios with their 95 % Wilson intervals, and the best found."""
    title = (
        f"{view.name}: {view.state}, {view.n_solutions} solutions, {_duration(view.cpu_seconds)} of CPU time"
    )
    table = Table(*SUMMARY_COLUMNS, title=title, title_justify="left")
    for search in view.searches:
        table.add_row(*_summary_row(search))
    return table


def _summary_row(search: SearchView) -> tuple[str, ...]:
    return (
        search.name,
        search.strategy,
        search.state,
        f"{search.n_solves}/{search.n_guesses_planned if search.n_guesses_planned is not None else 'open'}",
        ratio(search.n_paper, search.n_solves),
        ratio(search.n_strict, search.n_solves),
        str(search.n_solutions),
        _shown(search.best_propellant_kg, "kg", 2),
        _shown(search.best_delta_v_km_s, "km/s", 4),
        _shown(search.cpu_seconds / search.n_strict if search.n_strict else None, "s", 1),
    )


def ratio(n_feasible: int, n_guesses: int) -> str:
    """Return a feasibility ratio with its interval, in percent."""
    if n_guesses == 0:
        return "-"
    share = feasibility_ratio(n_feasible, n_guesses)
    return f"{100 * share.value:.1f} % ({100 * share.low:.1f}-{100 * share.high:.1f})"


def progress(view: CampaignView) -> Table:
    """Return what changes while a campaign runs."""
    left = "unknown" if view.eta_seconds is None else _duration(view.eta_seconds)
    gone = _duration(view.elapsed_seconds)
    title = f"{view.name}: {gone} gone, {left} left, {view.rate_per_min:.1f} solves/min"
    table = Table(
        "search", "strategy", "solves", "running", "strict", "best", title=title, title_justify="left"
    )
    for search in view.searches:
        planned = "open" if search.n_guesses_planned is None else str(search.n_guesses_planned)
        table.add_row(
            search.name,
            search.strategy,
            f"{search.n_solves}/{planned}",
            str(search.jobs.running) if search.state == "active" else search.state,
            str(search.n_strict),
            _shown(search.best_propellant_kg, "kg", 2),
        )
    return table


def progress_line(view: CampaignView) -> str:
    """Return the same in one line, for logs."""
    parts = [f"{s.name} {s.n_solves} solves, {s.n_strict} strict" for s in view.searches]
    return f"{_duration(view.elapsed_seconds)}: " + "; ".join(parts)


def campaign_list(items: list[CampaignItem]) -> Table:
    """Return the campaigns."""
    table = Table("id", "name", "state", "jobs", "solves", "solutions", "delta-v, best")
    for item in items:
        best = _shown(item.best_delta_v_km_s, "km/s", 4)
        jobs = f"{item.n_done}/{item.n_jobs}"
        table.add_row(
            str(item.id), item.name, item.state, jobs, str(item.n_solves), str(item.n_solutions), best
        )
    return table


def solution_list(records: list[Record]) -> Table:
    """Return solutions, one row each."""
    table = Table("id", "search", "propellant", "delta-v", "flight time", "insertion", "tolerance", "seed")
    for record in records:
        table.add_row(
            record.id[:12],
            f"{record.search} {record.strategy}",
            _shown(record.propellant_kg, "kg", 2),
            _shown(record.delta_v_km_s, "km/s", 4),
            _shown(record.time_of_flight_days, "d", 2),
            record.insertion_epoch,
            "strict" if record.strict else "paper",
            (record.seed_id or "-")[:12],
        )
    return table


def print_record(console: Console, record: Record) -> None:
    """Print every field of a solution but its vector."""
    for name, value in record.model_dump(mode="json", exclude={"x", "verification"}).items():
        console.print(f"[bold]{name}[/bold]: {value}", soft_wrap=True, highlight=False)


def _shown(value: float | None, unit: str, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f} {unit}"


def _duration(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))
