"""What lists of an archive of any size read: rows by an index, never all jobs or solves."""

import re

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import event

from service.app import create_app
from service.auth.network import Access
from service.schemas.solution import Filter
from service.store.store import Store
from tests.service.campaigns import finish, submitted

ADDRESSES = (
    "campaigns",
    "campaigns/1",
    "solutions",
    "solutions?campaign=1",
    "solutions?search=s0&sort=delta_v_km_s",
    "solutions?search=s0&sort=cpu_seconds",
    "solutions?campaign=1&strategy=S(1|0)&min_cpu_seconds=1",
    "solutions?k=1",
    "solutions/points?search=s0",
    "solutions/clusters?search=s0",
    "solutions/{solution}",
    "solutions/{solution}/lineage",
    "solutions/{solution}/missed-thrust",
    "campaigns/1/searches/s0",
    "jobs?campaign=1",
    "jobs?search=s0&state=done",
    "jobs?state=dead",
    "queue",
    "workers",
    "attempts",
    "events?campaign=1",
    "seeds?campaign=1&search=s1-0",
)
SCAN = r"SCAN (job|solve|attempt|event|seed_link)\b"
#: Where the solves of each solution are wanted: SQLite expects as few of a search, which may have a million.
OF_A_SEARCH = r"SEARCH solve_1 USING .*solve_order \(search_id=\?\)"


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """A client, and the statements that its requests lead to."""
    with Store(tmp_path_factory.mktemp("archive")) as store:
        submitted(store)
        finish(store)
        statements = []
        event.listen(
            store._database._reader,
            "before_cursor_execute",
            lambda _, cursor, statement, parameters, *more: statements.append((statement, parameters)),
        )
        with TestClient(create_app(store, access=Access()), base_url="http://127.0.0.1:8741") as client:
            yield store, client, statements


def plans(store, statements):
    """Yield what SQLite does for each statement, step by step."""
    with store._database.read() as session:
        connection = session.connection().connection
        for statement, parameters in statements:
            if statement.startswith(("SELECT", "WITH")):
                steps = [row[3] for row in connection.execute(f"EXPLAIN QUERY PLAN {statement}", parameters)]
                yield statement, steps


@pytest.mark.parametrize("address", ADDRESSES)
def test_no_list_walks_over_all_jobs_or_solves(asked, address):
    store, client, statements = asked
    solution = store.certificates.ids(Filter(search="s1-0"))[0]
    del statements[:]
    assert client.get(f"/api/v1/{address.format(solution=solution)}").status_code == 200
    for statement, steps in plans(store, list(statements)):
        assert not [step for step in steps if re.search(SCAN, step)], statement
        if "solution_id = solution.id" in statement:
            assert not [step for step in steps if re.search(OF_A_SEARCH, step)], statement
