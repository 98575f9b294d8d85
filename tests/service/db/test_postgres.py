"""What PostgreSQL does for an archive, and how it is reached."""

import threading

import pytest
from sqlalchemy import text
from sqlalchemy.exc import InternalError

from service.db.engine import URL_VARIABLE, Database, database_url, place_of, shown
from service.db.errors import DatabaseError, WriteError
from service.db.tables import CampaignRow, EventRow
from tests.service.databases import needs_postgres

pytestmark = [pytest.mark.postgres, needs_postgres]


@pytest.fixture
def url(new_database):
    return new_database()


@pytest.fixture
def database(url):
    opened = Database(url)
    yield opened
    opened.close()


def campaign(name="a", **more):
    fields = {"spec_hash": name, "spec": {}, "rng_seed": 1, "state": "active", "created_at": 1.0}
    return CampaignRow(name=name, **fields | more)


def event():
    return EventRow(campaign_id=1, kind="job", data={}, created_at=1.0)


def test_an_rng_seed_of_63_bits_and_every_bit_of_a_float_are_kept(database):
    database.write(lambda s: s.add(campaign(rng_seed=2**63 - 1, created_at=0.1 + 0.2)))
    with database.read() as session:
        row = session.query(CampaignRow).one()
        assert (row.rng_seed, row.created_at) == (2**63 - 1, 0.1 + 0.2)


def test_readers_cannot_write(database):
    with database.read() as session, pytest.raises(InternalError, match="read-only transaction"):
        session.add(campaign())
        session.flush()


def test_a_reader_sees_one_state_while_others_write(database):
    with database.read() as session:
        assert session.query(CampaignRow).count() == 0
        database.write(lambda s: s.add(campaign()))
        assert session.query(CampaignRow).count() == 0
    with database.read() as session:
        assert session.query(CampaignRow).count() == 1


def test_two_coordinators_write_one_after_the_other_and_ids_follow_their_commits(database, url):
    database.write(lambda session: session.add(campaign()))
    other, seen, done = Database(url), [], threading.Event()

    def read_then_write(place):
        for _ in range(20):
            place.write(lambda s: (s.query(EventRow).count(), s.add(event()), s.flush()))

    def follow():
        # As pages do: whatever is behind the last id that was seen will not be looked for again.
        while True:
            is_last = done.is_set()
            with database.read() as session:
                after = seen[-1] if seen else 0
                newer = session.query(EventRow.id).filter(EventRow.id > after).order_by(EventRow.id)
                seen.extend(key for (key,) in newer)
            if is_last:
                return
            done.wait(0.002)

    writers = [threading.Thread(target=read_then_write, args=(place,)) for place in (database, other) * 2]
    follower = threading.Thread(target=follow)
    for thread in (follower, *writers):
        thread.start()
    for thread in writers:
        thread.join()
    done.set()
    follower.join()
    other.close()
    assert len(seen) == 80


def test_a_server_that_is_gone_is_named_without_its_password(postgres):
    url = database_url(f"postgresql://coastarc:secret@/none?host={postgres.folder}")
    with pytest.raises(
        DatabaseError, match=r'expected a PostgreSQL database, got .*"none" does not exist'
    ) as caught:
        Database(url)
    assert "secret" not in str(caught.value) and "***" in str(caught.value)


def test_connections_that_broke_are_made_again(database):
    database.write(lambda s: s.add(campaign()))
    kill = text("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid()")
    with pytest.raises(WriteError, match=r"expected a server that answers, got .*; start PostgreSQL"):
        database.write(lambda s: s.execute(text("SELECT pg_terminate_backend(pg_backend_pid())")))
    with database.read() as session:
        assert session.query(CampaignRow).count() == 1
    database.write(lambda s: s.execute(kill))
    with database.read() as session:
        assert session.query(CampaignRow).count() == 1
    database.write(lambda s: s.add(campaign("b")))


def test_a_change_of_state_that_does_not_exist_is_refused_by_the_database(database):
    database.write(lambda s: s.add(campaign(state="cancelled")))
    with pytest.raises(
        Exception, match="campaign: expected a known change of state, got cancelled to active"
    ):
        database.write(lambda s: s.execute(text("UPDATE campaign SET state = 'active'")))


def test_the_environment_names_the_database_by_itself_or_by_a_file(monkeypatch, tmp_path):
    monkeypatch.setenv(URL_VARIABLE, "postgresql://a:b@host/c")
    assert shown(place_of(tmp_path)) == "postgresql+psycopg://a:***@host/c"
    monkeypatch.delenv(URL_VARIABLE)
    (tmp_path / "url").write_text("postgres://a@host/d\n")
    monkeypatch.setenv(f"{URL_VARIABLE}_FILE", str(tmp_path / "url"))
    assert shown(place_of(tmp_path)) == "postgresql+psycopg://a@host/d"
    monkeypatch.delenv(f"{URL_VARIABLE}_FILE")
    assert place_of(tmp_path) == tmp_path / "coastarc.db"


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ("sqlite:///a.db", "got one of sqlite; SQLite archives are named by --data"),
        ("mysql://secret@h/d", "got one of mysql"),
        ("postgresql://secret@h", "got none of a database"),
        ("secret words", "got no URL"),
    ],
)
def test_what_names_no_postgresql_database_is_refused_and_not_repeated(given, fault):
    with pytest.raises(DatabaseError, match=fault) as caught:
        database_url(given)
    assert "secret" not in str(caught.value)
