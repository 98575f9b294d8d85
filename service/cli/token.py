"""`coastarc token`: access to a coordinator.

Without --url the archive itself is opened, which needs the coordinator to be stopped, since an archive has
one writer; with --url the coordinator is asked, with the administrator's token of COASTARC_TOKEN(_FILE).
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

import typer
from pydantic import BaseModel, ValidationError

from core.errors import UserError, fault_lines
from service.cli import terminal
from service.cli.options import DATA, Data, Json, console, print_json
from service.coordinator.lock import FolderLock, LockError
from service.db.engine import make_folder
from service.schemas.identity import NewToken, Role, TokenPage, TokenRequest, TokenView
from service.settings import Settings
from service.store.archive import Archive

token = typer.Typer(help="Make, list and revoke tokens.", no_args_is_help=True)

Url = Annotated[
    str | None, typer.Option(help="Coordinator to ask, if one is running.", envvar="COASTARC_URL")
]
Out = Annotated[Path | None, typer.Option(help="New file for the token, readable by its owner alone.")]


class TokenError(UserError, RuntimeError):
    """A token that could not be made, listed, revoked or handed over."""


@token.command("create")
def create(
    name: Annotated[str, typer.Argument(help="Name that the audit will show.")],
    role: Annotated[Role, typer.Option(help="What it is for.")] = Role.VIEWER,
    days: Annotated[float, typer.Option(help="For how long it is valid.")] = 90.0,
    out: Out = None,
    data: Data = DATA,
    url: Url = None,
    as_json: Json = False,
) -> None:
    """Make a token.  It is shown this once; only a hash of it is kept."""
    wanted = _request(name, role, days)
    if out is not None and out.exists():
        raise TokenError(f"--out: expected a file that is not there yet, got {out}")
    if url is None:
        with _archive(data) as store:
            made = store.identities.create(wanted.name, wanted.role, wanted.days)
    else:
        made = NewToken.model_validate(_ask(url, "POST", "/tokens", wanted))
    if out is not None:
        _write_private(out, made.token)
        typer.echo(f"{made.role.value} token {made.name} is in {out}, valid until {made.expires_at:%Y-%m-%d}")
    elif as_json:
        print_json(made)
    else:
        typer.echo(made.token)
        typer.echo(f"Shown this once; valid until {made.expires_at:%Y-%m-%d}.", err=True)


@token.command("list")
def list_tokens(data: Data = DATA, url: Url = None, as_json: Json = False) -> None:
    """List the tokens, without their secrets."""
    if url is None:
        with Archive(data) as store:
            page = TokenPage(items=store.identities.tokens())
    else:
        page = TokenPage.model_validate(_ask(url, "GET", "/tokens"))
    if as_json:
        print_json(page)
        return
    rows = terminal.table("name", "role", "state", "until", "last used")
    for item in page.items:
        used = f"{item.last_used_at:%Y-%m-%d %H:%M}" if item.last_used_at else "never"
        rows.add_row(item.name, item.role.value, item.state, f"{item.expires_at:%Y-%m-%d}", used)
    console.print(rows)


@token.command("revoke")
def revoke(
    name: Annotated[str, typer.Argument(help="Name or id.")],
    data: Data = DATA,
    url: Url = None,
    as_json: Json = False,
) -> None:
    """Revoke a token, and end the sessions that were opened with it."""
    if url is None:
        with _archive(data) as store:
            ended = store.identities.revoke(name)
    else:
        ended = TokenView.model_validate(_ask(url, "DELETE", f"/tokens/{quote(name, safe='')}"))
    if as_json:
        print_json(ended)
    else:
        typer.echo(f"token {ended.name} is {ended.state}")


@contextmanager
def _archive(data: Path) -> Iterator[Archive]:
    make_folder(data)
    try:
        with FolderLock(data), Archive(data, read_only=False) as store:
            yield store
    except LockError as error:
        advice = "or ask that coordinator with --url and an administrator's token in COASTARC_TOKEN"
        raise TokenError(f"{error}, {advice}") from None


def _request(name: str, role: Role, days: float) -> TokenRequest:
    try:
        return TokenRequest(name=name, role=role, days=days)
    except ValidationError as error:
        raise TokenError("\n".join(fault_lines("token", error.errors()))) from None


def _ask(url: str, method: str, path: str, body: BaseModel | None = None) -> Any:
    # Imported here: an archive is read without HTTP.
    import httpx

    mine = Settings.from_environment().token
    headers = {"Authorization": f"Bearer {mine.get_secret_value()}"} if mine else {}
    fields = None if body is None else body.model_dump(mode="json")
    try:
        answer = httpx.request(
            method, f"{url.rstrip('/')}/api/v1{path}", json=fields, headers=headers, timeout=30
        )
        content = answer.json()
    except (httpx.TransportError, httpx.InvalidURL, ValueError) as error:
        raise TokenError(f"coordinator: expected one at {url}, got {error}") from None
    if answer.is_error:
        raise TokenError(str(content.get("detail", answer.status_code)))
    return content


def _write_private(path: Path, secret: str) -> None:
    # Created with its mode: before a later chmod others could read it.
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        # The token exists already; without this it would be lost.
        typer.echo(secret)
        raise TokenError(f"--out: expected a file to write, got {path}: {error.strerror}") from None
    with os.fdopen(descriptor, "w") as file:
        file.write(secret + "\n")
