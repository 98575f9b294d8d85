"""`coastarc db`: the archive as a whole; campaigns may run while it is checked or backed up."""

import time
from pathlib import Path
from typing import Annotated

import typer

from service.cli.options import DATA, Data, Json, show_checks
from service.coordinator.lock import FolderLock
from service.db.backup import backup, restore
from service.db.engine import make_folder, place_of, shown
from service.db.errors import DatabaseError, no_archive
from service.db.tables import SCHEMA_VERSION
from service.db.upgrade import upgrade, version_of
from service.integrity.check import check
from service.integrity.repair import repair
from service.schemas.answer import Check

db = typer.Typer(help="Upgrade, check, repair, back up and restore an archive.", no_args_is_help=True)

#: Rows of each table that are shown, at most.
MOST_SHOWN = 20


@db.command("upgrade")
def upgrade_archive(
    data: Data = DATA,
    backup_file: Annotated[
        Path | None, typer.Option("--backup", help="New file for the backup; in the data folder if left out.")
    ] = None,
    no_backup: Annotated[
        bool, typer.Option("--no-backup", metavar="", help="Upgrade without a backup.")
    ] = False,
) -> None:
    """Upgrade an archive of an older version to this one, after a backup; all or nothing."""
    place = place_of(data)
    if isinstance(place, Path) and not place.is_file():
        raise no_archive(place)
    with FolderLock(data):
        found = version_of(place)
        if found == SCHEMA_VERSION:
            typer.echo(f"Archive {shown(place)} has schema version {found} already.")
            return
        if found is not None and not no_backup:
            if not isinstance(place, Path):
                raise DatabaseError(
                    "backup: expected one by PostgreSQL's own pg_dump before an upgrade, got none; "
                    "make it, then repeat the command with --no-backup"
                )
            file = backup_file or data / f"coastarc-version-{found}-{time.strftime('%Y%m%d-%H%M%S')}.db"
            backup(place, file)
            typer.echo(f"Backup:  {file}")
        upgrade(place)
    typer.echo(f"Archive {shown(place)} has schema version {SCHEMA_VERSION} now; it had {found or 'none'}.")


@db.command("check")
def check_archive(data: Data = DATA, as_json: Json = False) -> None:
    """Check file, references, tables and totals, and count the rows; exit code 1 where one failed."""
    checks = check(place_of(data))
    show_checks(checks, as_json)


@db.command("repair")
def repair_archive(
    data: Data = DATA,
    apply: Annotated[
        bool, typer.Option("--apply", metavar="", help="Repair; without it, only show what would be done.")
    ] = False,
) -> None:
    """Move inconsistent rows into a file, and recount totals; nothing is lost.

    Rows that depend on them move with them: solves and certificates of a solution, and the jobs that map
    it.  No campaign may run meanwhile.
    """
    place = place_of(data)
    with FolderLock(data):
        _require_repairable(check(place))
        file = data / f"coastarc-set-aside-{time.strftime('%Y%m%d-%H%M%S')}.ndjson"
        aside = repair(place, file if apply else None)
    for table, keys in aside.reasons.items():
        for key, why in list(keys.items())[:MOST_SHOWN]:
            typer.echo(f"{table} {', '.join(map(str, key))}: {why}")
    counts = ", ".join(f"{number} {table}" for table, number in aside.counts().items()) or "no rows"
    if apply:
        place_of_rows = f", into {file}" if file.exists() else ""
        typer.echo(f"Set aside: {counts}{place_of_rows}. Totals and counters are recounted.")
    else:
        typer.echo(f"To be set aside: {counts}. Nothing has changed; repeat with --apply to do it.")


def _require_repairable(checks: list[Check]) -> None:
    bad = [one for one in checks if one.state == "failed" and one.name not in ("totals", "content")]
    if bad:
        raise DatabaseError(
            f"archive: expected an intact one, got {bad[0].name}: {bad[0].found}; {bad[0].advice}"
        )


@db.command("backup")
def back_up_archive(
    file: Annotated[Path, typer.Argument(help="New file for the backup.")], data: Data = DATA
) -> None:
    """Write an archive to one file, a consistent snapshot; campaigns may run meanwhile."""
    backup(place_of(data), file)
    typer.echo(f"Backup: {file}, {file.stat().st_size / 1e6:.1f} MB; back with `coastarc db restore {file}`")


@db.command("restore")
def restore_archive(file: Annotated[Path, typer.Argument(help="A backup.")], data: Data = DATA) -> None:
    """Fill an empty data folder, or an empty PostgreSQL database, from a backup."""
    make_folder(data)
    place = place_of(data)
    with FolderLock(data):
        version = restore(file, place)
    news = "" if version == SCHEMA_VERSION else "; bring it to this version with `coastarc db upgrade`"
    typer.echo(f"Archive {shown(place)} is that of {file}, schema version {version}{news}.")
