import json
import sqlite3
import stat
import sys
import threading
from pathlib import Path

import pytest

from service import cli
from service.db.backup import backup, restore
from service.db.engine import FILE_NAME, Database, make_folder
from service.db.errors import DatabaseError
from service.db.tables import SCHEMA_VERSION, EventRow
from service.db.upgrade import version_of
from service.integrity.check import check
from service.store.store import Store
from tests.service.campaigns import content, finish, submitted
from tests.service.databases import needs_postgres
from tests.service.db.test_migrations import stored, table_contents


@pytest.fixture
def run(monkeypatch, capsys):
    """Run the command line in this process; returns exit code and what it printed."""

    def command(*arguments):
        monkeypatch.setattr(sys, "argv", ["coastarc", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out + printed.err

    return command


def states(checks):
    return {entry.name: entry.state for entry in checks}


def test_a_backup_has_every_bit_of_the_archive_and_works_like_it(store, tmp_path):
    submitted(store)
    finish(store)
    backup(tmp_path / "coastarc.db", tmp_path / "backup.db")
    (tmp_path / "other").mkdir()
    assert restore(tmp_path / "backup.db", tmp_path / "other" / "coastarc.db") == SCHEMA_VERSION
    assert table_contents(tmp_path / "other" / "coastarc.db") == table_contents(tmp_path / "coastarc.db")
    with Store(tmp_path / "other") as other:
        assert content(other) == content(store) != []


def test_a_backup_made_while_others_write_is_one_state_and_holds_nobody_up(store, tmp_path):
    campaign_id = submitted(store)
    database, is_enough, n_written = store._database, threading.Event(), 0

    def pair(session):
        # Two rows in one transaction: half of it is never seen.
        for _ in range(2):
            session.add(EventRow(campaign_id=campaign_id, kind="job", data={}, created_at=1.0))

    def write():
        nonlocal n_written
        while not is_enough.is_set():
            database.write(pair)
            n_written += 1

    writer = threading.Thread(target=write)
    writer.start()
    try:
        for number in range(5):
            before = n_written
            backup(tmp_path / "coastarc.db", tmp_path / f"{number}.db")
            assert states(check(tmp_path / f"{number}.db")) == dict.fromkeys(
                ("file", "version", "tables", "references", "totals", "content", "rows"), "ok"
            )
            jobs = [row for row in table_contents(tmp_path / f"{number}.db")["event"] if row["data"] == "{}"]
            assert len(jobs) % 2 == 0 and len(jobs) >= 2 * before
    finally:
        is_enough.set()
        writer.join()
    assert n_written > 5


def test_nothing_is_overwritten_and_no_half_is_left(store, tmp_path):
    path = tmp_path / "coastarc.db"
    backup(path, tmp_path / "a.db")
    with pytest.raises(DatabaseError, match="expected a new file, got one that exists"):
        backup(path, tmp_path / "a.db")
    with pytest.raises(DatabaseError, match="expected an empty place to restore into, got a file"):
        restore(tmp_path / "a.db", path)
    with pytest.raises(DatabaseError, match="expected a place to write it, got unable to open database"):
        backup(path, tmp_path / "no folder" / "a.db")
    assert not list(tmp_path.rglob("*.partial*"))


def test_what_is_no_archive_is_not_restored(tmp_path):
    (tmp_path / "text").write_text("no archive " * 1000)
    sqlite3.connect(tmp_path / "empty").execute("CREATE TABLE a (b)").connection.close()
    target = tmp_path / "coastarc.db"
    with pytest.raises(DatabaseError, match=r"expected a file, got .*none, which is none"):
        restore(tmp_path / "none", target)
    with pytest.raises(DatabaseError, match="expected a whole archive, got file is not a database"):
        restore(tmp_path / "text", target)
    with pytest.raises(DatabaseError, match=r"expected schema version . or less, got none"):
        restore(tmp_path / "empty", target)
    assert not target.exists()


def test_the_commands_save_check_and_restore_an_archive(run, store, tmp_path):
    submitted(store)
    code, said = run("db", "backup", tmp_path / "b.db", "--data", tmp_path)
    assert code == 0 and "back with `coastarc db restore" in said
    code, said = run("db", "restore", tmp_path / "b.db", "--data", tmp_path / "new" / "folder")
    assert code == 0 and f"schema version {SCHEMA_VERSION}." in said
    code, said = run("db", "check", "--data", tmp_path / "new" / "folder", "--json")
    assert code == 0 and {entry["state"] for entry in json.loads(said)} == {"ok"}
    assert "1 campaign" in json.loads(said)[-1]["found"]
    code, said = run("db", "restore", tmp_path / "b.db", "--data", tmp_path / "new" / "folder")
    assert code == 2 and "expected an empty place" in said


def test_a_damaged_page_a_lost_row_and_a_wrong_total_are_found(run, store, tmp_path):
    submitted(store)
    finish(store)
    store.close()
    path = tmp_path / "coastarc.db"
    connection = sqlite3.connect(path)
    connection.execute("DELETE FROM problem WHERE k = 1")
    connection.execute("DROP INDEX job_lease")
    connection.execute("UPDATE search SET n_solves = n_solves + 1 WHERE name = 's0'")
    connection.commit()
    connection.close()
    found = {entry.name: entry for entry in check(path)}
    assert {name for name, entry in found.items() if entry.state == "failed"} == {
        "references",
        "tables",
        "totals",
    }
    assert "refers to nothing in problem" in found["references"].found
    assert "add index job_lease" in found["tables"].found
    assert found["totals"].found == "those of search s0 are not those of its rows"
    pages = bytearray(path.read_bytes())
    pages[4096 * 3 : 4096 * 4] = bytes(4096)
    path.write_bytes(pages)
    code, said = run("db", "check", "--data", tmp_path)
    assert code == 1 and "failed" in said


def test_an_older_archive_is_upgraded_after_a_backup_of_it(run, tmp_path):
    path = stored(1, tmp_path)
    code, said = run("status", "--data", tmp_path)
    assert code == 2 and "got 1; bring it to this version with `coastarc db upgrade`" in said
    code, said = run("db", "check", "--data", tmp_path)
    assert code == 1 and "failed" in said
    before = table_contents(path)
    code, said = run("db", "upgrade", "--data", tmp_path)
    assert code == 0 and f"has schema version {SCHEMA_VERSION} now; it had 1." in said
    (saved,) = tmp_path.glob("coastarc-version-1-*.db")
    assert table_contents(saved) == before and version_of(saved) == 1
    # The figures of that archive were made up.
    assert {one.name for one in check(path) if one.state == "failed"} == {"content"}
    assert run("db", "upgrade", "--data", tmp_path)[1].endswith(f"schema version {SCHEMA_VERSION} already.\n")


def test_an_older_backup_is_restored_as_it_is_and_upgraded_there(run, tmp_path):
    (tmp_path / "old").mkdir()
    saved = stored(2, tmp_path / "old")
    code, said = run("db", "restore", saved, "--data", tmp_path)
    assert code == 0 and "schema version 2; bring it to this version" in said
    assert run("db", "upgrade", "--data", tmp_path, "--no-backup")[0] == 0
    assert not list(tmp_path.glob("coastarc-version-*"))


def test_an_archive_in_use_is_not_upgraded(run, tmp_path):
    from service.coordinator.lock import FolderLock

    stored(1, tmp_path)
    with FolderLock(tmp_path):
        code, said = run("db", "upgrade", "--data", tmp_path)
    assert code == 2 and "expected to be free" in said and version_of(tmp_path / "coastarc.db") == 1


def test_a_backup_that_meets_a_full_disk_leaves_nothing(store, tmp_path, monkeypatch):
    def full(source, target):
        Path(target).write_bytes(b"half")
        raise sqlite3.OperationalError("database or disk is full")

    monkeypatch.setattr("service.db.backup._vacuum", full)
    with pytest.raises(DatabaseError, match="expected a place to write it, got database or disk is full"):
        backup(tmp_path / "coastarc.db", tmp_path / "b.db")
    assert not list(tmp_path.glob("b.db*"))


@needs_postgres
@pytest.mark.postgres
def test_an_archive_moves_to_postgresql_and_back_with_every_bit(store, tmp_path, new_database):
    submitted(store)
    finish(store)
    url = new_database()
    backup(tmp_path / "coastarc.db", tmp_path / "there.db")
    assert restore(tmp_path / "there.db", url) == SCHEMA_VERSION
    assert states(check(url)) == states(check(tmp_path / "coastarc.db"))
    with pytest.raises(DatabaseError, match="expected an empty database to restore into, got tables"):
        restore(tmp_path / "there.db", url)
    backup(url, tmp_path / "back.db")
    assert table_contents(tmp_path / "back.db") == table_contents(tmp_path / "coastarc.db")
    moved = Database(url)
    moved.write(lambda s: s.add(EventRow(campaign_id=1, kind="job", data={}, created_at=1.0)))
    with moved.read() as session:
        last = store.last_event_id(1)
        assert session.query(EventRow).filter(EventRow.id > last).one().id == last + 1
    moved.close()


def _rights(file):
    return stat.S_IMODE(file.stat().st_mode)


def test_archive_journal_and_backup_are_for_their_owner_alone(tmp_path):
    folder = tmp_path / "archive"
    make_folder(folder)
    with Store(folder) as store:
        submitted(store)
        backup(folder / FILE_NAME, tmp_path / "copy.db")
        made = [*folder.iterdir(), tmp_path / "copy.db"]
        assert {file.name for file in made} >= {
            "coastarc.db",
            "coastarc.db-wal",
            "coastarc.db-shm",
            "copy.db",
        }
        assert {_rights(file) for file in made} == {0o600} and _rights(folder) == 0o700


def test_an_archive_that_others_could_read_is_closed_to_them(tmp_path):
    with Store(tmp_path) as store:
        submitted(store)
    (tmp_path / FILE_NAME).chmod(0o644)
    with Store(tmp_path):
        assert _rights(tmp_path / FILE_NAME) == 0o600
