import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.store.store import Store
from tests.acceptance import known
from tests.service.campaigns import finish
from tests.service.databases import (  # noqa: F401 - fixtures
    archives_on_postgres,
    new_database,
    own_postgres,
    postgres,
)
from workers.executor import Inline


@pytest.fixture
def store(request, tmp_path):
    """An open archive, in SQLite unless `parametrize("store", ["postgresql"], indirect=True)` asks for it."""
    if getattr(request, "param", "sqlite") == "postgresql":
        request.getfixturevalue("archives_on_postgres")
    opened = Store(tmp_path)
    yield opened
    opened.close()


@pytest.fixture
def client(store):
    with TestClient(
        create_app(store), base_url="http://127.0.0.1:8741", raise_server_exceptions=False
    ) as opened:
        yield opened


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """A finished campaign of known solutions; flying and verifying them takes seconds."""
    with Store(tmp_path_factory.mktemp("archive")) as opened:
        known.submitted(opened)
        finish(opened, Inline(known.run_known))
        yield opened


@pytest.fixture(scope="module")
def asked(archive):
    with TestClient(create_app(archive), base_url="http://127.0.0.1:8741") as opened:
        yield opened
