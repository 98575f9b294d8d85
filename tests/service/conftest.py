import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.store import Store
from tests.service.databases import archives_on_postgres, new_database, postgres  # noqa: F401 - fixtures


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
