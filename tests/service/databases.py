"""A PostgreSQL of the tests' own, started once, with an empty database for whoever asks."""

import itertools
import os
import pwd
import shutil
import subprocess
import tempfile
from contextlib import contextmanager
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import text

from service.db.engine import database_url


def _programs():
    """Return the folder of PostgreSQL's programs, the newest where there are several, or None."""
    places = [Path(found).resolve().parent for found in [shutil.which("initdb")] if found]
    places += sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    return next((place for place in places if (place / "initdb").exists()), None)


PROGRAMS = _programs()
needs_postgres = pytest.mark.skipif(
    PROGRAMS is None and "COASTARC_REQUIRE_POSTGRES" not in os.environ, reason="no PostgreSQL here"
)


def _owner():
    """Return who runs the server, since root may not: arguments of `subprocess.run`."""
    if os.geteuid() != 0:
        return {}
    return {"user": "nobody", "group": pwd.getpwnam("nobody").pw_gid, "extra_groups": []}


class Cluster:
    """A server in a temporary folder, reached by a socket in it and by nothing else."""

    def __init__(self, folder):
        assert PROGRAMS is not None, (
            "expected PostgreSQL, got none; install it, or unset COASTARC_REQUIRE_POSTGRES"
        )
        self.folder = folder
        self._numbers = itertools.count(1)
        self._free = []

    def start(self):
        self._run(
            "initdb", "--no-sync", "--auth=trust", "--username=coastarc", "--encoding=UTF8", "--locale=C"
        )
        self.go_on()

    def go_on(self):
        """Start the server, for the first time or after a stop."""
        # Nothing is worth a wait for the disk: it is thrown away.
        options = f"-F -k {self.folder} -c listen_addresses='' -c max_connections=200"
        self._run("pg_ctl", "-w", "-t", "120", "-o", options, "-l", str(self.folder / "log"), "start")

    def stop(self):
        self._run("pg_ctl", "-m", "immediate", "stop")

    def take(self):
        """Return the name of an empty database."""
        if self._free:
            return self._free.pop()
        name = f"archive_{next(self._numbers)}"
        with psycopg.connect(self.address("postgres"), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}")
        return name

    def give_back(self, name):
        """Empty a database for the next test, which is quicker than a new one."""
        with psycopg.connect(self.address(name), autocommit=True) as connection:
            connection.execute("DROP SCHEMA public CASCADE")
            connection.execute("CREATE SCHEMA public")
        self._free.append(name)

    def address(self, name):
        return f"postgresql://coastarc@/{name}?host={self.folder}"

    def _run(self, program, *arguments):
        command = [str(PROGRAMS / program), "-D", str(self.folder / "data"), *arguments]
        # Into a file: the server inherits what is open, and a pipe would stay open with it.
        with open(self.folder / "output", "a") as output:
            subprocess.run(
                command, check=True, cwd=self.folder, stdout=output, stderr=output, timeout=180, **_owner()
            )


@contextmanager
def _running():
    folder = Path(tempfile.mkdtemp(prefix="coastarc-pg-"))
    if owner := _owner():
        shutil.chown(folder, owner["user"], owner["group"])
    cluster = Cluster(folder)
    try:
        cluster.start()
        yield cluster
        cluster.stop()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session")
def postgres():
    with _running() as cluster:
        yield cluster


@pytest.fixture(scope="module")
def own_postgres():
    """Give a server that a test may stop: whoever does starts it again."""
    with _running() as cluster:
        yield cluster


@pytest.fixture
def new_database(postgres):
    """Return a function that returns the URL of an empty database."""
    names = []

    def take():
        names.append(postgres.take())
        return database_url(postgres.address(names[-1]))

    yield take
    for name in names:
        postgres.give_back(name)


@pytest.fixture
def archives_on_postgres(new_database, monkeypatch):
    """Give every data folder of a test a PostgreSQL database of its own."""
    places = {}

    def place_of(folder):
        if folder not in places:
            places[folder] = new_database()
        return places[folder]

    monkeypatch.setattr("service.store.archive.place_of", place_of)


def rows(store, query):
    """Return what a query gives, on either kind of database."""
    with store._database.read() as session:
        return [tuple(row) for row in session.execute(text(query))]
