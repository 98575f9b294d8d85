"""`coastarc dispatch`: an executor of this machine, or a Ray cluster, works for a running coordinator.

`coastarc doctor`: the checks of this installation as a table.
"""

import threading
from pathlib import Path
from typing import Annotated

import typer
from pydantic import SecretStr

from core.errors import UserError
from service.cli.options import DATA, DEFAULT_PORT, WORKERS, Data, Json, Url, show_checks, token_of
from service.doctor import check_all
from workers.dispatch import EXECUTOR_LOST, RUNNER, DispatchOrder, ExecutorKind, dispatch, stop_on_signals
from workers.executor import ExecutorError, ExecutorLostError

Address = Annotated[str, typer.Option(help="Ray cluster to join, as host:port; local starts one.")]


class DispatchError(UserError, RuntimeError):
    """Options of a dispatcher that exclude each other."""


def dispatch_command(
    url: Url,
    executor: Annotated[ExecutorKind, typer.Option(help="What runs the jobs.")] = ExecutorKind.PROCESS,
    workers: Annotated[
        int | None, typer.Option(min=1, max=1024, help="Jobs at a time; one per core if left out.")
    ] = None,
    address: Address = "local",
    token_file: Annotated[
        Path | None, typer.Option(help="File with a worker's token; COASTARC_TOKEN_FILE if left out.")
    ] = None,
    cluster_token: Annotated[
        Path | None, typer.Option(help="File with the token of the Ray cluster, mode 0600.")
    ] = None,
    campaign: Annotated[
        int | None, typer.Option(min=1, max=2**63 - 1, help="Work for this campaign only.")
    ] = None,
    runner: Annotated[str, typer.Option(hidden=True)] = RUNNER,
) -> None:
    """Work for a coordinator, here or elsewhere, until interrupted; several may work for one."""
    token = token_of(token_file)
    order = DispatchOrder(
        url=url,
        token=None if token is None else SecretStr(token),
        executor=executor,
        n_workers=_n_workers(executor, workers, address),
        address=address,
        cluster_token=cluster_token,
        campaign_id=campaign,
        runner=runner,
    )
    stop = threading.Event()
    stop_on_signals(stop)
    typer.echo(
        f"Working for {url} by executor {executor.value}; Ctrl-C stops it and reports its results.", err=True
    )
    try:
        dispatch(order, stop)
    except ExecutorLostError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(EXECUTOR_LOST) from None


def _n_workers(executor: ExecutorKind, workers: int | None, address: str) -> int | None:
    if executor is ExecutorKind.RAY:
        if address != "local" and workers is not None:
            raise ExecutorError(f"--workers: expected none with a cluster that has its own, got {workers}")
        return workers
    if address != "local":
        raise DispatchError(f"--address: expected --executor ray with it, got {executor.value}")
    if executor is ExecutorKind.INLINE and workers not in (None, 1):
        raise DispatchError(f"--workers: expected 1 with --executor inline, got {workers}")
    return workers or WORKERS


def doctor(
    data: Data = DATA,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to check.")] = DEFAULT_PORT,
    as_json: Json = False,
) -> None:
    """Check this installation, and say what to do where something is missing."""
    checks = check_all(data, port)
    show_checks(checks, as_json)
