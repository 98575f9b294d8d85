import sqlite3
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import text
from sqlalchemy.dialects import sqlite
from sqlalchemy.exc import OperationalError, StatementError

from service.db.columns import Json, Vector
from service.db.engine import Database, DatabaseError
from service.db.tables import SCHEMA_VERSION, CampaignRow, EventRow

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
    with pytest.raises(DatabaseError, match=f"expected schema version {SCHEMA_VERSION}, got 99"):
        Database(tmp_path / "old.db")


def test_an_archive_that_is_not_there_is_not_created_by_reading(tmp_path):
    with pytest.raises(DatabaseError, match="run a campaign first"):
        Database(tmp_path / "none.db", read_only=True)
    assert list(tmp_path.iterdir()) == []


@given(st.lists(st.floats(width=64)))
def test_a_vector_keeps_every_bit(values):
    stored = Vector().process_bind_param(values, DIALECT)
    assert stored == np.array(values, dtype="<f8").tobytes()
    assert Vector().process_result_value(stored, DIALECT).tobytes() == np.array(values, dtype=float).tobytes()


def test_json_without_meaning_is_refused():
    with pytest.raises(ValueError, match="not JSON compliant"):
        Json().process_bind_param({"a": float("nan")}, DIALECT)
