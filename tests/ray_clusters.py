"""A simulated Ray cluster, all on this machine: several nodes with one processor each."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from workers.ray_nodes import own_token, require_token

NODE = {"num_cpus": 1, "object_store_memory": 80_000_000}
HEAD = {"include_dashboard": False, "include_log_monitor": False, "no_monitor": True}


@contextmanager
def nodes(n_nodes: int = 4) -> Iterator[tuple[str, Path]]:
    """Give address and token of a cluster, which ends afterwards; this process may join it too."""
    # Below /tmp and not below pytest's folders: socket paths are at most 107 bytes.
    with tempfile.TemporaryDirectory(prefix="ray-", dir="/tmp") as folder:
        token = own_token(Path(folder) / "token")
        require_token(os.environ, token)
        os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_TMPDIR": folder}
        cluster = _started(n_nodes)
        try:
            yield cluster.address, token
        finally:
            cluster.shutdown()


def _started(n_nodes: int, n_tries: int = 3):
    from ray.cluster_utils import Cluster

    cluster = Cluster()
    try:
        cluster.add_node(**HEAD, **NODE)
        for _ in range(n_nodes - 1):
            cluster.add_node(**NODE)
        cluster.wait_for_nodes()
    except Exception as error:
        # A node dies when its agents, started as it is, need more than 15 s (ray #65983).
        cluster.shutdown()
        if n_tries == 1 or "timed out during startup" not in str(error):
            raise
        return _started(n_nodes, n_tries - 1)
    return cluster
