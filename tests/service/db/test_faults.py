"""Which of a driver's errors say that the archive cannot be used now, and which are about what was asked."""

import sqlite3

import psycopg
import pytest
from sqlalchemy import exc

from service.db.errors import UnavailableError, WriteError, read_fault, write_fault
from service.db.postgres import may_pass

PASSING = {
    None: "a server that answers",  # refused, unknown host, cut off
    "08006": "a server that answers",  # connection_failure
    "57P01": "a server that stays",  # admin_shutdown
    "57P02": "a server that stays",  # crash_shutdown
    "57P03": "a server that stays",  # cannot_connect_now: it starts, stops or recovers
    "57014": "a server that stays",  # query_canceled
    "53100": "room to write",  # disk_full
    "53200": "a server with room",  # out_of_memory
    "53300": "a server with room",  # too_many_connections
    "55P03": "to be the only writer",  # lock_not_available
    "40001": "to be the only writer",  # serialization_failure
    "40P01": "to be the only writer",  # deadlock_detected
    "58030": "a disk that works",  # io_error
    "25006": "one to write in",  # read_only_sql_transaction
}
#: Unique key, check, trigger, syntax, unknown table, division by zero.
OURS = ("23505", "23514", "P0001", "42601", "42P01", "22012")


def of_postgres(state, kind=exc.OperationalError):
    cause = psycopg.errors.lookup(state)("it says so") if state else psycopg.OperationalError("it says so")
    return kind("SELECT 1", {}, cause)


def of_sqlite(code):
    cause = sqlite3.OperationalError("it says so")
    cause.sqlite_errorcode = code
    return exc.OperationalError("SELECT 1", {}, cause)


@pytest.mark.parametrize(("state", "expected"), PASSING.items())
def test_what_may_pass_of_postgresql_is_told_with_what_helps(state, expected):
    read, write = read_fault("here", of_postgres(state)), write_fault("here", of_postgres(state))
    assert type(read) is UnavailableError and type(write) is WriteError
    for fault in (read, write):
        assert str(fault).startswith(f"archive here: expected {expected}, got it says so; ")


@pytest.mark.parametrize("state", OURS)
def test_what_is_wrong_with_a_statement_is_no_fault_of_the_server(state):
    assert read_fault("here", of_postgres(state, exc.ProgrammingError)) is None
    assert write_fault("here", of_postgres(state, exc.IntegrityError)) is None


def test_what_the_driver_refuses_by_itself_is_no_fault_of_the_server():
    error = exc.DataError("SELECT 1", {}, psycopg.DataError("PostgreSQL text fields cannot contain NUL"))
    assert read_fault("here", error) is None and write_fault("here", error) is None


# BUSY and its kin, LOCKED, out of memory, a read that failed, FULL.
@pytest.mark.parametrize("code", [5, 5 | 2 << 8, 6, 7, 10 | 1 << 8, 13])
def test_what_may_pass_of_sqlite_is_told(code):
    assert type(read_fault("here", of_sqlite(code))) is UnavailableError
    assert type(write_fault("here", of_sqlite(code))) is WriteError


@pytest.mark.parametrize("code", [1, 19, 20])  # ERROR, CONSTRAINT, MISMATCH
def test_what_is_wrong_with_a_statement_is_no_fault_of_the_file(code):
    assert read_fault("here", of_sqlite(code)) is None and write_fault("here", of_sqlite(code)) is None


def test_a_pool_that_has_no_connection_left_is_busy_and_not_broken():
    fault = read_fault("here", exc.TimeoutError("QueuePool limit of size 5 overflow 10 reached"))
    assert type(fault) is UnavailableError and "expected a connection that is free" in str(fault)


@pytest.mark.parametrize(
    ("said", "passes"),
    [
        ("connection to server on socket failed: No such file or directory", True),
        ("FATAL:  the database system is starting up", True),
        ("FATAL:  sorry, too many clients already", True),
        ('FATAL:  database "none" does not exist', False),
        ('FATAL:  password authentication failed for user "coastarc"', False),
    ],
)
def test_a_start_waits_for_a_server_and_not_for_another_password(said, passes):
    assert may_pass(said) is passes
