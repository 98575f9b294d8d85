"""What `coastarc run` and `coastarc serve` do while they wait."""

import time

from rich.console import Console
from rich.live import Live

from service.cli import terminal
from service.coordinator import Coordinator, Crew
from workers.dispatch import RUNNER, ExecutorKind

__all__ = ["RUNNER", "announce", "crew_of", "run_to_end", "serve_until_interrupted"]

#: How often the terminal is drawn again, and a log gets a line [s].
TERMINAL_PERIOD_S = 1.0
LOG_PERIOD_S = 20.0
#: How often it is asked whether all is done [s].
STATE_PERIOD_S = 0.5
#: States in which a campaign may go on: who paused it may resume it.
UNFINISHED = ("active", "paused")


def crew_of(executor: ExecutorKind, n_workers: int) -> Crew:
    """Return what a dispatcher of this machine works with."""
    return Crew(n_workers, executor, RUNNER)


def announce(console: Console, coordinator: Coordinator, page: str = "") -> None:
    """Print where to look; `page` is the path of one below the address."""
    console.print(f"Live page: {coordinator.url}{page}", highlight=False, soft_wrap=True)
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
    store, period = coordinator.store, TERMINAL_PERIOD_S if console.is_terminal else LOG_PERIOD_S
    view = store.campaign(campaign_id)
    next_look = time.monotonic() + period
    with Live(terminal.progress(view), console=console, transient=True, auto_refresh=False) as live:
        while store.campaign_state(campaign_id) in UNFINISHED:
            time.sleep(STATE_PERIOD_S)
            coordinator.raise_fault()
            if time.monotonic() < next_look:
                # The whole view asks a lot of the archive, and the processor is for the solves.
                continue
            next_look += period
            view = store.campaign(campaign_id)
            if console.is_terminal:
                live.update(terminal.progress(view), refresh=True)
            else:
                console.print(terminal.progress_line(view), highlight=False)


def serve_until_interrupted(coordinator: Coordinator, crew: Crew) -> None:
    """Work on all campaigns until Ctrl-C; without workers of its own, leave that to dispatchers elsewhere."""
    try:
        if crew.n_workers != 0:
            coordinator.work(crew)
        while True:
            time.sleep(STATE_PERIOD_S)
            coordinator.raise_fault()
    except KeyboardInterrupt:
        return
