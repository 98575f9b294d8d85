"""One simulated cluster of four nodes for all tests that need Ray, since its start takes many seconds."""

import os
import tempfile
from pathlib import Path

import pytest

from workers.ray_token import own_token, require_token


class LentCluster:
    """The connection of the whole session, which the executor of one test must not close."""

    def __init__(self, cluster):
        self._cluster = cluster

    def __getattr__(self, name):
        return getattr(self._cluster, name)

    def close(self):
        """Leave the connection as it is."""


@pytest.fixture(scope="session")
def simulated_cluster():
    """Give address and token of four nodes with one processor each, all on this machine."""
    # Below /tmp and not below pytest's folders: socket paths are at most 107 bytes.
    with tempfile.TemporaryDirectory(prefix="ray-", dir="/tmp") as folder:
        (Path(folder) / "ray").mkdir()
        token = own_token(Path(folder) / "token")
        require_token(os.environ, token)
        os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_TMPDIR": folder}
        cluster = started_again_if_slow()
        yield cluster.address, token
        cluster.shutdown()


def started_again_if_slow(n_tries=3):
    from ray.cluster_utils import Cluster

    node = {"num_cpus": 1, "object_store_memory": 80_000_000}
    head = {"include_dashboard": False, "include_log_monitor": False, "no_monitor": True}
    cluster = Cluster()
    try:
        cluster.add_node(**head, **node)
        for _ in range(3):
            cluster.add_node(**node)
        cluster.wait_for_nodes()
    except Exception as error:
        # A node dies when its agents, started as it is, need more than 15 s (ray #65983).
        cluster.shutdown()
        if n_tries == 1 or "timed out during startup" not in str(error):
            raise
        return started_again_if_slow(n_tries - 1)
    return cluster


@pytest.fixture(scope="session")
def ray_cluster(simulated_cluster):
    from workers.ray_executor import RayCluster

    address, token = simulated_cluster
    joined = RayCluster(address, token=token)
    yield LentCluster(joined)
    joined.close()
