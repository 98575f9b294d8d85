"""Stories of clusters that a process starts for itself: one is closed, others lose what they need.

Run as `python -m tests.workers.own_ray_cluster close|raylet|gcs|frozen FOLDER`; prints JSON and nothing else.
"""

import json
import os
import signal
import stat
import sys
import time
from functools import partial
from pathlib import Path

import psutil

from tests.workers.jobs import hop_job
from workers.executor import ExecutorLostError
from workers.messages import Ticket
from workers.ray_executor import RayCluster, RayExecutor
from workers.ray_nodes import Watchdog


def opened(folder, patience_s=30.0):
    cluster = RayCluster(n_workers=1, token=folder / "token", folder=folder / "ray")
    watchdog = Watchdog(cluster.ray, interval_s=1.0, timeout_s=patience_s)
    return RayExecutor(cluster, "tests.workers.fake:run_chain_zero_deaf", watchdog=watchdog)


def ending_of_one_job(executor):
    executor.submit(Ticket(1, 1), hop_job(chain=1))
    return executor.finished(60.0)[0].outcome.head.ending


def deaf_job_runs(executor):
    executor.submit(Ticket(2, 1), hop_job(chain=0))
    executor.finished(2.0)


def processes():
    return psutil.Process().children(recursive=True)


def alive(before):
    return [process.name() for process in psutil.wait_procs(before, 10.0)[1]]


def seconds_until_lost(executor):
    start = time.monotonic()
    while time.monotonic() < start + 90:
        try:
            executor.finished(0.5)
        except ExecutorLostError:
            return time.monotonic() - start
    return None


def told_of_closing(folder):
    on_term = signal.getsignal(signal.SIGTERM)
    executor = opened(folder)
    told = {
        "keeps_sigterm": signal.getsignal(signal.SIGTERM) is on_term,
        "token_mode": stat.S_IMODE((folder / "token").stat().st_mode),
        "has_dashboard": bool(executor._ray.get_runtime_context().worker.node.webui_url),
        "capacity": executor.capacity(),
        "ending": ending_of_one_job(executor),
    }
    deaf_job_runs(executor)
    before = processes()
    executor.close()
    return told | {"n_processes": len(before), "left": alive(before)}


def told_of_losing(folder, name, number, patience_s=30.0):
    """Send a signal to one process of a cluster that works on a job."""
    executor = opened(folder, patience_s)
    deaf_job_runs(executor)
    before = processes()
    os.kill(next(process.pid for process in before if process.name() == name), number)
    told = {"seconds_until_lost": seconds_until_lost(executor)}
    start = time.monotonic()
    executor.close()
    return told | {"seconds_to_close": time.monotonic() - start, "left": alive(before)}


STORIES = {
    "close": told_of_closing,
    "raylet": partial(told_of_losing, name="raylet", number=signal.SIGKILL),
    "gcs": partial(told_of_losing, name="gcs_server", number=signal.SIGKILL),
    "frozen": partial(told_of_losing, name="raylet", number=signal.SIGSTOP, patience_s=5.0),
}

if __name__ == "__main__":
    told = json.dumps(STORIES[sys.argv[1]](Path(sys.argv[2])))
    sys.stdout.write(told)
    sys.stdout.flush()
    # Ray would look for a lost cluster for 5 s more.
    os._exit(0)
