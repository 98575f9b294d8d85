import shutil
import sqlite3
from pathlib import Path

import pytest
from sqlalchemy import inspect, text

from service.db import postgres as postgres_side
from service.db import sqlite
from service.db.dialect import VERSION_TABLE
from service.db.engine import Database
from service.db.errors import DatabaseError
from service.db.tables import SCHEMA_VERSION, Base
from service.db.upgrade import differences, upgrade, version_of
from service.schemas.solution import Filter
from service.store.store import Store
from tests.service.databases import needs_postgres

STORED = Path(__file__).parents[1] / "data"
#: The archive of the present version is kept for `tests.golden` alone.
VERSIONS = sorted(
    {int(path.stem.split("-")[1]) for path in STORED.glob("archive-*.sqlite")} - {SCHEMA_VERSION}
)
KINDS = ["sqlite", pytest.param("postgresql", marks=needs_postgres)]


@pytest.fixture
def new_place(request, tmp_path):
    """Return a function that gives an empty place of the kind that the test asks for."""

    def place(kind, name):
        if kind == "sqlite":
            return tmp_path / f"{name}.db"
        return request.getfixturevalue("new_database")()

    return place


def stored(version, folder):
    """Return a copy of the archive that a program of an older version left behind."""
    return Path(shutil.copy(STORED / f"archive-{version}.sqlite", folder / "coastarc.db"))


def connected(place, look):
    side = sqlite if isinstance(place, Path) else postgres_side
    engine = side.writer_engine(place)
    with engine.connect() as connection:
        found = look(connection)
    engine.dispose()
    return found


def schema(connection):
    """Return all of a schema that does not depend on the order in which it came about."""
    look = inspect(connection)
    found = {
        table: {
            "columns": sorted(
                (c["name"], str(c["type"]), c["nullable"], str(c["default"])) for c in look.get_columns(table)
            ),
            "key": look.get_pk_constraint(table)["constrained_columns"],
            "references": sorted(
                (f["constrained_columns"], f["referred_table"], f["referred_columns"])
                for f in look.get_foreign_keys(table)
            ),
            "unique": sorted(u["column_names"] for u in look.get_unique_constraints(table)),
            "checks": sorted((c["name"], c["sqltext"]) for c in look.get_check_constraints(table)),
            "indexes": sorted((i["name"], i["column_names"], i["unique"]) for i in look.get_indexes(table)),
        }
        for table in look.get_table_names()
    }
    return found | own_words(connection)


def own_words(connection):
    """Return what SQLAlchemy's inspector does not tell."""
    if connection.dialect.name == "sqlite":
        strict = connection.exec_driver_sql("SELECT name FROM pragma_table_list WHERE strict").all()
        triggers = connection.exec_driver_sql(
            "SELECT name, sql FROM sqlite_schema WHERE type = 'trigger'"
        ).all()
        partial = connection.exec_driver_sql(
            "SELECT name, sql FROM sqlite_schema WHERE sql LIKE '%INDEX%WHERE%'"
        )
        return {"strict": sorted(strict), "triggers": sorted(triggers), "partial": sorted(partial.all())}
    triggers = "SELECT tgname, pg_get_triggerdef(oid) FROM pg_trigger WHERE NOT tgisinternal"
    functions = "SELECT proname, prosrc FROM pg_proc WHERE pronamespace = 'public'::regnamespace"
    partial = "SELECT indexname, indexdef FROM pg_indexes WHERE schemaname = 'public'"
    return {
        query: sorted(connection.exec_driver_sql(query).all()) for query in (triggers, functions, partial)
    }


@pytest.mark.parametrize("kind", KINDS)
def test_the_migrations_make_the_tables_of_the_models(new_place, kind):
    place = new_place(kind, "migrated")
    assert upgrade(place) == 0
    assert connected(place, differences) == []
    fresh = new_place(kind, "fresh")
    Database(fresh).close()
    assert connected(place, schema) == connected(fresh, schema)


def test_the_newest_revision_is_the_version_of_the_schema(tmp_path):
    upgrade(tmp_path / "a.db")
    assert version_of(tmp_path / "a.db") == SCHEMA_VERSION == 1 + max(VERSIONS)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_stored_archive_gets_the_tables_of_the_models(tmp_path, version):
    path = stored(version, tmp_path)
    assert upgrade(path) == version
    Database(tmp_path / "fresh.db").close()
    assert connected(path, differences) == []
    assert connected(path, schema) == connected(tmp_path / "fresh.db", schema)
    assert sqlite.integrity_faults(path) == []


def table_contents(path):
    """Return the rows of every table, each as its columns."""
    connection = sqlite3.connect(path)
    connection.row_factory = sqlite3.Row
    names = [row[0] for row in connection.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")]
    found = {}
    for name in names:
        columns = connection.execute(f"PRAGMA table_info({name})").fetchall()
        keys = ", ".join(column["name"] for column in columns if column["pk"]) or "rowid"
        found[name] = [dict(row) for row in connection.execute(f"SELECT * FROM {name} ORDER BY {keys}")]
    connection.close()
    return found


#: What revision 0002 took away, to hold it in a table of its own.
MOVED = {"problem_hash"}
#: What an upgrade is there to change.
CHANGED = {VERSION_TABLE}


@pytest.mark.parametrize("version", VERSIONS)
def test_an_upgrade_keeps_every_row_and_every_bit_of_it(tmp_path, version):
    path = stored(version, tmp_path)
    before = table_contents(path)
    upgrade(path)
    after = table_contents(path)
    assert len(before["job"]) > 10 and len(before["solution"]) > 5
    for table, rows in ((name, rows) for name, rows in before.items() if name not in CHANGED):
        kept = set(rows[0]) - (MOVED if table == "search" else set())
        assert [{name: row[name] for name in kept} for row in after[table]] == [
            {name: row[name] for name in kept} for row in rows
        ]


def test_the_search_of_version_1_has_its_problem_as_its_only_case_and_its_jobs_their_mapping(tmp_path):
    path = stored(1, tmp_path)
    before = table_contents(path)
    upgrade(path)
    after = table_contents(path)
    cases = [(row["search_id"], row["position"], row["problem_hash"]) for row in after["search_case"]]
    assert cases == [(row["id"], 0, row["problem_hash"]) for row in before["search"]]
    assert {(row["kind"], row["mapping"]) for row in after["job"]} == {("hop", None), ("map", "reference")}


@pytest.mark.parametrize("version", VERSIONS)
def test_an_upgraded_archive_goes_on_where_it_was(tmp_path, version):
    path = stored(version, tmp_path)
    n_solutions = len(table_contents(path)["solution"])
    upgrade(path)
    with Store(tmp_path) as store:
        assert {item.state for item in store.campaigns()} == {"active", "done"}
        assert len(store.all_records(Filter())) == n_solutions
        assert store.campaign_facts(1).solves
        assert store.claim("somebody", 1)


def test_totals_of_version_3_are_those_of_the_rows(tmp_path):
    path = stored(2, tmp_path)
    upgrade(path)
    found = table_contents(path)
    for search in found["search"]:
        solves = [row for row in found["solve"] if row["search_id"] == search["id"]]
        assert search["n_solves"] == len(solves)
        assert search["cpu_seconds"] == search["served_s"] == sum(row["cpu_seconds"] for row in solves)
        assert search["n_planned"] == sum(row["search_id"] == search["id"] for row in found["job"])


@pytest.mark.parametrize("version", VERSIONS)
def test_the_searches_of_an_upgraded_archive_have_the_priority_that_their_jobs_have(tmp_path, version):
    path = stored(version, tmp_path)
    upgrade(path)
    found = table_contents(path)
    priorities = {search["strategy"]: search["priority"] for search in found["search"]}
    assert priorities.items() <= {"S(0)": 0, "S(1|0)": -1, "S(2|1)": -2}.items()
    wanted = {search["id"]: search["priority"] for search in found["search"]}
    assert all(wanted[job["search_id"]] == job["priority"] for job in found["job"])


def test_workers_of_version_3_have_measured_nothing(tmp_path):
    path = stored(3, tmp_path)
    upgrade(path)
    with Store(tmp_path) as store:
        views = store.workers().items
    assert {(view.cpu_cores, view.memory_bytes, view.host_memory_bytes) for view in views} == {(None,) * 3}


def test_running_jobs_of_an_older_version_have_a_lease_that_has_run_out(tmp_path):
    path = stored(2, tmp_path)
    upgrade(path)
    running = [row for row in table_contents(path)["job"] if row["state"] == "running"]
    assert running and all(row["lease_until"] == row["updated_at"] for row in running)


@pytest.mark.parametrize("version", VERSIONS)
def test_an_older_archive_is_opened_by_nobody_and_told_what_to_do(tmp_path, version):
    path = stored(version, tmp_path)
    content = path.read_bytes()
    for read_only in (True, False):
        with pytest.raises(
            DatabaseError, match=f"got {version}; bring it to this version with `coastarc db upgr"
        ):
            Database(path, read_only=read_only)
    assert sqlite3.connect(path).execute("PRAGMA user_version").fetchone() == (version,)
    assert len(path.read_bytes()) == len(content)


def test_an_upgrade_that_fails_leaves_the_archive_as_it_was(tmp_path):
    path = stored(1, tmp_path)
    connection = sqlite3.connect(path)
    # A job without a search: the upgrade would have to invent its case.
    connection.execute("UPDATE job SET search_id = 99 WHERE id = 1")
    connection.commit()
    connection.close()
    before = table_contents(path)
    with pytest.raises(DatabaseError, match="expected rows that refer to others, got row 1 of job refers"):
        upgrade(path)
    assert table_contents(path) == before and version_of(path) == 1


def test_an_archive_of_a_newer_version_and_a_foreign_database_are_not_touched(tmp_path):
    newer, foreign = stored(2, tmp_path), tmp_path / "foreign.db"
    for path, change in ((newer, "PRAGMA user_version = 99"), (foreign, "CREATE TABLE a (b)")):
        connection = sqlite3.connect(path)
        connection.execute(change)
        connection.commit()
        connection.close()
    with pytest.raises(DatabaseError, match="or less, got 99; install a newer coastarc"):
        upgrade(newer)
    with pytest.raises(DatabaseError, match="expected one of coastarc, got tables without a version"):
        upgrade(foreign)
    assert list(table_contents(foreign)) == ["a"]


def test_an_archive_of_this_version_is_upgraded_to_itself(tmp_path):
    Database(tmp_path / "a.db").close()
    assert upgrade(tmp_path / "a.db") == SCHEMA_VERSION
    Database(tmp_path / "a.db").close()


def test_the_version_is_kept_where_older_programs_look_for_it(tmp_path):
    Database(tmp_path / "new.db").close()
    path = stored(1, tmp_path)
    upgrade(path)
    for place in (tmp_path / "new.db", path):
        assert connected(place, lambda c: c.execute(text("PRAGMA user_version")).scalar()) == SCHEMA_VERSION


def test_the_tables_are_those_of_the_models_and_alembics_own(tmp_path):
    upgrade(tmp_path / "a.db")
    names = connected(tmp_path / "a.db", lambda connection: inspect(connection).get_table_names())
    assert set(names) == {*Base.metadata.tables, VERSION_TABLE}
