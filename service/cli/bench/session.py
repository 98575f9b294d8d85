"""What the long benchmarks share: one-line errors, progress on stderr, and results that survive an end."""

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol, TypeVar

import typer

from workers.executor import Executor
from workers.measure_solves import n_compiled_kernels, write_json
from workers.process_pool import ProcessPool

Plan = TypeVar("Plan")
Solved = TypeVar("Solved")

#: Time between two lines of progress where lines cannot be overwritten [s].
QUIET_S = 30.0


@contextmanager
def user_errors() -> Iterator[None]:
    """Turn what a user did wrong into one line and exit code 2."""
    try:
        yield
    except ValueError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(2) from error


def require_folders(**files: Path | None) -> None:
    """Refuse files that could not be written when the work is done; the names are those of the options."""
    for name, path in files.items():
        if path is not None and (path.is_dir() or not path.absolute().parent.is_dir()):
            raise ValueError(f"{name}: expected a file in a folder that exists, got {path}")


class Progress:
    """One line on stderr that is written over; in a file, one line now and then."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr.isatty()
        self._next = 0.0

    def show(self, line: str) -> None:
        """Show the state of things."""
        if self._is_terminal:
            sys.stderr.write(f"\r{line}\x1b[K")
        elif time.monotonic() >= self._next:
            self._next = time.monotonic() + QUIET_S
            sys.stderr.write(line + "\n")
        sys.stderr.flush()

    def end(self) -> None:
        """Leave the line to what is printed next."""
        if self._is_terminal:
            sys.stderr.write("\n")
            sys.stderr.flush()


class Ledger:
    """Keeps the JSON of a benchmark on disk while it grows."""

    def __init__(self, path: Path | None, content: Callable[[bool], dict[str, Any]]) -> None:
        #: `content(is_partial)` gives all that is known.
        self._path, self._content = path, content

    def grow(self) -> None:
        """Write what there is: a kill loses nothing that ended before."""
        if self._path is not None and str(self._path) != "-":
            write_json(self._path, self._content(True))

    def close(self, is_partial: bool) -> bool:
        """Write everything; "-" means stdout, and then the answer is that nothing else should go there."""
        if self._path is None:
            return False
        if str(self._path) == "-":
            typer.echo(json.dumps(self._content(is_partial), indent=1))
            return True
        write_json(self._path, self._content(is_partial))
        return False


class Report(Protocol[Plan, Solved]):
    """What a long benchmark has found so far."""

    plan: Plan
    solved: list[Solved]
    #: Kernels that were compiled while the clock ran: any spoils the times.
    n_compiled: int

    def line(self) -> str:
        """Return the state of things in one line."""


@contextmanager
def opened(n_workers: int) -> Iterator[Executor]:
    """Give processes to solve on, and end them."""
    pool = ProcessPool(n_workers)
    try:
        yield pool
    finally:
        pool.close()


def is_cut_short(
    found: Report[Plan, Solved],
    ledger: Ledger,
    n_workers: int,
    warm_up: Callable[[Executor, Plan], None],
    solve_all: Callable[[Executor, Plan], Iterator[Solved]],
) -> bool:
    """Solve until all is done, or until Ctrl-C, and return whether it was that."""
    progress = Progress()
    try:
        with opened(n_workers) as pool:
            warm_up(pool, found.plan)
            before = n_compiled_kernels()
            for one in solve_all(pool, found.plan):
                found.solved.append(one)
                found.n_compiled = n_compiled_kernels() - before
                progress.show(found.line())
                ledger.grow()
    except KeyboardInterrupt:
        return True
    finally:
        progress.end()
    return False
