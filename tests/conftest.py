"""One simulated Ray cluster for all tests that need one, since its start takes many seconds."""

import pytest

from tests.ray_clusters import nodes


class LentCluster:
    """The connection of the whole session, which the executor of one test must not close."""

    def __init__(self, cluster):
        self._cluster = cluster

    def __getattr__(self, name):
        return getattr(self._cluster, name)

    def close(self):
        """Leave the connection as it is."""


def pytest_collection_modifyitems(items):
    """Run what needs Ray last, so that its processes do not take time from all other tests."""
    items.sort(key=lambda item: item.get_closest_marker("ray") is not None)


@pytest.fixture(scope="session")
def simulated_cluster():
    """Give address and token of four nodes."""
    with nodes() as cluster:
        yield cluster


@pytest.fixture(scope="session")
def ray_cluster(simulated_cluster):
    from workers.ray_executor import RayCluster

    address, token = simulated_cluster
    joined = RayCluster(address, token=token)
    yield LentCluster(joined)
    joined.close()
