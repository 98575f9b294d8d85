import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.store import Store


@pytest.fixture
def store(tmp_path):
    opened = Store(tmp_path)
    yield opened
    opened.close()


@pytest.fixture
def client(store):
    with TestClient(
        create_app(store), base_url="http://127.0.0.1:8741", raise_server_exceptions=False
    ) as opened:
        yield opened
