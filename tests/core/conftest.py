"""Solves run with one thread, as in workers: more make small matrices slower, and other bits of them."""

import pytest
from threadpoolctl import threadpool_limits


@pytest.fixture(autouse=True, scope="session")
def one_thread():
    with threadpool_limits(1):
        yield
