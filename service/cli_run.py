"""What `coastarc run` and `coastarc serve` do while they wait."""

import time

from rich.console import Console
from rich.live import Live

from service import terminal
from service.coordinator import Coordinator, Crew
from workers.dispatch import RUNNER, ExecutorKind

__all__ = ["RUNNER", "announce", "crew_of", "run_to_end", "serve_until_interrupted"]

#: How often the terminal is drawn again, and a log gets a line [s].
TERMINAL_PERIOD_S = 0.5
LOG_PERIOD_S = 20.0
#: States in which a campaign may go on: who paused it may resume it.
UNFINISHED = ("active", "paused")


def crew_of(executor: ExecutorKind, n_workers: int) -> Crew:
    """Return what a dispatcher of this machine works with."""
    return Crew(n_workers, executor, RUNNER)


def announce(console: Console, coordinator: Coordinator) -> None:
    """Print where to look."""
    console.print(f"Live page: {coordinator.url}", highlight=False)
    console.print(f"Archive:   {coordinator.store.folder}", highlight=False, soft_wrap=True, markup=False)


def run_to_end(console: Console, coordinator: Coordinator, campaign_id: int, crew: Crew) -> bool:
    """Work on a campaign and show how far it is; return whether it finished, and was not interrupted."""
    try:
        coordinator.work(crew, campaign_id)
        _follow(console, coordinator, campaign_id)
    except KeyboardInterrupt:
        console.print("Stopping; running solves hand in what they have ...")
        return False
    return True


def _follow(console: Console, coordinator: Coordinator, campaign_id: int) -> None:
    view = coordinator.store.campaign(campaign_id)
    next_line = time.monotonic() + LOG_PERIOD_S
    with Live(terminal.progress(view), console=console, transient=True, auto_refresh=False) as live:
        while view.state in UNFINISHED:
            time.sleep(TERMINAL_PERIOD_S)
            coordinator.raise_fault()
            view = coordinator.store.campaign(campaign_id)
            if console.is_terminal:
                live.update(terminal.progress(view), refresh=True)
            elif time.monotonic() > next_line:
                next_line += LOG_PERIOD_S
                console.print(terminal.progress_line(view), highlight=False)


def serve_until_interrupted(coordinator: Coordinator, crew: Crew) -> None:
    """Work on all campaigns until Ctrl-C."""
    try:
        coordinator.work(crew)
        while True:
            time.sleep(TERMINAL_PERIOD_S)
            coordinator.raise_fault()
    except KeyboardInterrupt:
        return
