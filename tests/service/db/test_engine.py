import os
import signal
import sqlite3
import subprocess
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import text
from sqlalchemy.dialects import sqlite
from sqlalchemy.exc import IntegrityError, OperationalError, StatementError

from service.db import sqlite as sqlite_file
from service.db.engine import Database, Moment
from service.db.errors import DatabaseError, WriteError
from service.db.tables import CampaignRow, EventRow, Json, Vector

DIALECT = sqlite.dialect()


@pytest.fixture
def database(tmp_path):
    opened = Database(tmp_path / "a b?.db")
    yield opened
    opened.close()


def campaign(name="a", **more):
    fields = {
        "name": name,
        "spec_hash": name,
        "spec": {},
        "rng_seed": 1,
        "state": "active",
        "created_at": 1.0,
    }
    return CampaignRow(**fields | more)


def names(database):
    with database.read() as session:
        return sorted(row.name for row in session.query(CampaignRow))


def test_work_that_raises_leaves_nothing_behind(database):
    def work(session):
        session.add(campaign())
        session.flush()
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        database.write(work)
    assert names(database) == []


def test_writers_on_many_threads_wait_for_each_other(database):
    def read_then_write():
        for _ in range(20):
            database.write(lambda session: (session.query(CampaignRow).count(), session.add(event())))

    def event():
        return EventRow(campaign_id=1, kind="job", data={}, created_at=1.0)

    database.write(lambda session: session.add(campaign()))
    threads = [threading.Thread(target=read_then_write) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    with database.read() as session:
        assert session.query(EventRow).count() == 160


def test_readers_cannot_write(database):
    with database.read() as session, pytest.raises(OperationalError, match="readonly database"):
        session.add(campaign())
        session.flush()


def test_a_row_that_refers_to_nothing_is_refused(database):
    with pytest.raises(StatementError, match="FOREIGN KEY"):
        database.write(lambda s: s.add(EventRow(campaign_id=9, kind="job", data={}, created_at=1.0)))


def test_a_column_takes_its_own_type_alone(database):
    database.write(lambda session: session.add(campaign()))
    with pytest.raises(StatementError, match="cannot store TEXT value in REAL column"):
        database.write(lambda session: session.execute(text("UPDATE campaign SET created_at = 'noon'")))


def test_an_archive_of_another_version_is_refused_and_left_alone(tmp_path):
    with sqlite3.connect(tmp_path / "old.db") as connection:
        connection.execute("CREATE TABLE campaign (id INTEGER)")
        connection.execute("PRAGMA user_version = 99")
    connection.close()
    with pytest.raises(DatabaseError, match="got 99; install a newer"):
        Database(tmp_path / "old.db")


def test_an_archive_that_is_not_there_is_not_created_by_reading(tmp_path):
    with pytest.raises(DatabaseError, match="run a campaign first"):
        Database(tmp_path / "none.db", read_only=True)
    assert list(tmp_path.iterdir()) == []


def fail_at(moment):
    def hook(reached):
        if reached is moment:
            raise ZeroDivisionError

    return hook


def test_a_write_that_fails_before_its_commit_is_not_stored(database):
    database.hook = fail_at(Moment.BEFORE_COMMIT)
    with pytest.raises(ZeroDivisionError):
        database.write(lambda session: session.add(campaign()))
    assert names(database) == []


def test_a_write_that_fails_after_its_commit_is_stored_though_the_caller_does_not_know(database):
    database.hook = fail_at(Moment.AFTER_COMMIT)
    with pytest.raises(ZeroDivisionError):
        database.write(lambda session: session.add(campaign()))
    assert names(database) == ["a"]


def limit_pages(database, n_more):
    """Let a database grow by so many pages and no more, as on a disk that fills up; None lifts the limit."""
    with database._writer.connect() as connection:
        n_pages = connection.exec_driver_sql("PRAGMA page_count").scalar()
        limit = 2**30 if n_more is None else n_pages + n_more
        connection.exec_driver_sql(f"PRAGMA max_page_count = {limit}")


def test_a_full_disk_is_named_and_everything_before_it_is_kept(database):
    def big(name):
        return lambda session: session.add(campaign(name, spec={"text": "a" * 50_000}))

    database.write(big("first"))
    limit_pages(database, 5)
    with pytest.raises(
        WriteError, match="expected room to write, got database or disk is full; free some space"
    ):
        database.write(big("second"))
    assert names(database) == ["first"] and sqlite_file.integrity_faults(database.place) == []
    limit_pages(database, None)
    database.write(big("second"))
    assert names(database) == ["first", "second"]


def test_another_writer_that_does_not_end_is_named(database, monkeypatch):
    other = sqlite3.connect(database.place, isolation_level=None)
    with database._writer.connect() as connection:
        connection.exec_driver_sql("PRAGMA busy_timeout = 50")
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(WriteError, match="expected to be the only writer, got database is locked"):
        database.write(lambda session: session.add(campaign()))
    other.execute("ROLLBACK")
    other.close()
    database.write(lambda session: session.add(campaign()))


def test_what_was_written_wrongly_is_no_fault_of_the_place(database):
    database.write(lambda session: session.add(campaign()))
    with pytest.raises(IntegrityError, match="UNIQUE"):
        database.write(lambda session: session.add(campaign()))


WRITE_AND_DIE = """
import os, signal, sys
from pathlib import Path
from service.db.engine import Database, Moment
from tests.service.db.test_engine import campaign
database = Database(Path(sys.argv[1]))
database.write(lambda session: session.add(campaign("before")))
def die(moment):
    if moment.name == sys.argv[2]:
        os.kill(os.getpid(), signal.SIGKILL)
database.hook = die
database.write(lambda session: session.add(campaign("after")))
"""


@pytest.mark.parametrize(("moment", "stored"), [("BEFORE_COMMIT", 1), ("AFTER_COMMIT", 2)])
def test_a_process_that_is_killed_leaves_a_whole_archive(tmp_path, moment, stored):
    path = tmp_path / "a.db"
    ended = subprocess.run([sys.executable, "-c", WRITE_AND_DIE, path, moment], timeout=120)
    assert ended.returncode == -signal.SIGKILL and sqlite_file.was_left_open(path)
    database = Database(path)
    assert names(database) == ["after", "before"][-stored:]
    database.close()
    assert not sqlite_file.was_left_open(path)


def test_a_file_that_broke_in_an_unclean_stop_is_not_written_to(tmp_path):
    path = tmp_path / "a.db"
    Database(path).close()
    pages = bytearray(path.read_bytes())
    pages[4096 * 3 : 4096 * 4] = os.urandom(4096)
    path.write_bytes(pages)
    # A clean end leaves no journal.
    (tmp_path / "a.db-wal").write_bytes(b"left by whoever was killed")
    with pytest.raises(DatabaseError, match=r"expected a whole file after an unclean stop, got .*db restore"):
        Database(path)
    assert path.read_bytes() == pages


@pytest.mark.parametrize(
    ("kind", "is_refused"), [("nfs4", True), ("cifs", True), ("FUSE.sshfs", True), ("ext4", False)]
)
def test_a_file_system_between_machines_is_refused(tmp_path, monkeypatch, kind, is_refused):
    mounts = [
        SimpleNamespace(mountpoint="/", fstype="ext4"),
        SimpleNamespace(mountpoint=str(tmp_path), fstype=kind),
    ]
    monkeypatch.setattr(sqlite_file.psutil, "disk_partitions", lambda all: mounts)
    (tmp_path / "deep").mkdir()
    if is_refused:
        with pytest.raises(
            DatabaseError, match=f"network file system {kind.lower()}, on which SQLite loses data"
        ):
            Database(tmp_path / "deep" / "a.db")
        assert list((tmp_path / "deep").iterdir()) == []
    else:
        Database(tmp_path / "deep" / "a.db").close()


def test_the_writer_waits_for_others_and_keeps_references(database):
    with database._writer.connect() as connection:
        found = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("journal_mode", "synchronous", "foreign_keys", "busy_timeout", "trusted_schema")
        }
    assert list(found.values()) == ["wal", 1, 1, 5000, 0]


@given(st.lists(st.floats(width=64)))
def test_a_vector_keeps_every_bit(values):
    stored = Vector().process_bind_param(values, DIALECT)
    assert stored == np.array(values, dtype="<f8").tobytes()
    read = Vector().process_result_value(stored, DIALECT)
    assert np.array(read, dtype=float).tobytes() == np.array(values, dtype=float).tobytes()


def test_json_without_meaning_is_refused():
    with pytest.raises(ValueError, match="not JSON compliant"):
        Json().process_bind_param({"a": float("nan")}, DIALECT)
