"""Stories of clusters that a process starts for itself: one is closed, of the other the raylet is killed.

Run as `python -m tests.workers.own_ray_cluster close|kill FOLDER`; prints JSON and nothing else.
"""

import json
import os
import signal
import stat
import sys
import time
from pathlib import Path

import psutil

from tests.workers.jobs import hop_job
from workers.executor import ExecutorLost, Ticket
from workers.ray_executor import RayCluster, RayExecutor
from workers.ray_watchdog import Watchdog


def opened(folder):
    cluster = RayCluster(n_workers=1, token=folder / "token", folder=folder / "ray")
    watchdog = Watchdog(cluster.ray, interval_s=1.0, timeout_s=5.0)
    return RayExecutor(cluster, "tests.workers.fake:run_chain_zero_deaf", watchdog=watchdog)


def ending_of_one_job(executor):
    executor.submit(Ticket(1, 1), hop_job(chain=1))
    return executor.finished(60.0)[0].outcome.ending


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
        except ExecutorLost:
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


def told_of_killing_the_raylet(folder):
    executor = opened(folder)
    deaf_job_runs(executor)
    before = processes()
    os.kill(next(process.pid for process in before if process.name() == "raylet"), signal.SIGKILL)
    told = {"seconds_until_lost": seconds_until_lost(executor)}
    executor.close()
    return told | {"left": alive(before)}


if __name__ == "__main__":
    tell = {"close": told_of_closing, "kill": told_of_killing_the_raylet}[sys.argv[1]]
    sys.stdout.write(json.dumps(tell(Path(sys.argv[2]))))
