"""The command that certifies solutions: one, those of a campaign, or a whole archive every night."""

import time
from collections.abc import Iterator
from typing import Annotated

import typer
from rich.live import Live

from service.cli.options import DATA, WORKERS, Data, Json, Workers, console, print_json
from service.cli.terminal_verify import progress_line, summary_line, verified_list
from service.solutions.verification import (
    Asked,
    Summary,
    Verified,
    fresh_ids,
    require_heyoka,
    verify_solutions,
    wanted_ids,
)
from service.store import Store

#: So many good solutions are listed one by one; of more, only those that are not good.
MOST_LISTED = 50
#: The line of progress is drawn anew this often at most [s].
PERIOD_S = 0.5


def verify_command(
    solution: Annotated[
        list[str] | None, typer.Argument(help="Ids of solutions, or their beginnings.")
    ] = None,
    campaign: Annotated[str | None, typer.Option(help="All of this campaign, by its id or name.")] = None,
    is_all: Annotated[bool, typer.Option("--all", metavar="", help="All of the archive.")] = False,
    data: Data = DATA,
    min_altitude_km: Annotated[
        float | None,
        typer.Option(
            show_default="200 over the Earth, 100 over the Moon",
            help="Passages of Earth or Moon below so many km are marked.",
        ),
    ] = None,
    is_stale: Annotated[
        bool,
        typer.Option(
            "--stale",
            metavar="",
            help="Leave out those found sound with this code, these packages, this altitude.",
        ),
    ] = False,
    with_heyoka: Annotated[
        bool,
        typer.Option(
            "--with-heyoka", metavar="", help="Fly through a third time, by heyoka's Taylor series."
        ),
    ] = False,
    workers: Workers = WORKERS,
    as_json: Json = False,
) -> None:
    """Fly solutions again by an independent integrator, and store a certificate of each.

    Exit code 1 if one fails: its defects hold no tolerance, or a looser one than archived; or it passes low.
    After an interruption what was done is kept, and with --stale the same command goes on with the rest.
    """
    if with_heyoka:
        require_heyoka()
    asked = Asked(min_altitude_km, with_heyoka)
    with Store(data) as store:
        ids = wanted_ids(store, solution or [], campaign, is_all)
        left = fresh_ids(store, ids, asked) if is_stale else ids
        found = verify_solutions(store, left, asked, min(workers, len(left)) or 1)
        items, is_complete = _followed(found, len(left), is_quiet=as_json)
    summary = Summary(
        n_wanted=len(ids),
        n_verified=len(items),
        n_failed=sum(not item.is_good for item in items),
        n_skipped=len(ids) - len(left),
        is_complete=is_complete,
        items=items,
    )
    print_json(summary) if as_json else _show(summary)
    if not is_complete:
        raise typer.Exit(130)
    if summary.n_failed:
        raise typer.Exit(1)


def _followed(found: Iterator[Verified], n: int, is_quiet: bool) -> tuple[list[Verified], bool]:
    """Return what was found, with a line of progress meanwhile, and whether it came to its end."""
    items: list[Verified] = []
    began = drawn = time.monotonic()
    with Live("", console=console, transient=True, auto_refresh=False) as live:
        try:
            for item in found:
                items.append(item)
                now = time.monotonic()
                if console.is_terminal and not is_quiet and now > drawn + PERIOD_S:
                    live.update(progress_line(items, n, now - began), refresh=True)
                    drawn = now
        except KeyboardInterrupt:
            return items, False
    return items, True


def _show(summary: Summary) -> None:
    good = [item for item in summary.items if item.is_good]
    listed = [item for item in summary.items if not item.is_good]
    listed = good + listed if len(good) <= MOST_LISTED else listed
    if listed:
        console.print(verified_list(listed))
    for item in summary.items:
        for reason in item.reasons:
            console.print(f"{item.solution_id[:8]}: {reason}", soft_wrap=True, highlight=False, markup=False)
    console.print(summary_line(summary), highlight=False, soft_wrap=True)
