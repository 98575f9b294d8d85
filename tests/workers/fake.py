"""Runners that stand for the solver: quick, deterministic, and badly behaved where a test wants it."""

import fcntl
import os
import signal
import stat
import time

import numpy as np
from threadpoolctl import threadpool_info

from core.problem import problem_from
from core.transcription import layout_of
from workers.job import (
    KIND_NUMBERS,
    Certificate,
    Ending,
    HopJob,
    JobOutcome,
    MapJob,
    Provenance,
    SolveRecord,
    Trajectory,
)

PROVENANCE = Provenance(
    code_version="0+fake",
    python_version="3",
    package_versions={"numpy": "2"},
    kernel_hashes={"de440.bsp": "0"},
    host="nowhere",
)


def address_key(job, hop):
    place = job.address
    return (KIND_NUMBERS[job.kind], place.search, place.case, place.chain, hop)


def record(job, hop, feasible_share=0.5):
    """Return a solve whose numbers come from its address alone, as in a real run."""
    rng = np.random.default_rng(np.random.SeedSequence(job.rng_seed, spawn_key=address_key(job, hop)))
    problem = problem_from(job.problem)
    defects = tuple(tuple(row) for row in (1e-3 * rng.standard_normal((1 + problem.k, 7))).tolist())
    common = {
        "hop": hop,
        "rng_key": "/".join(map(str, (job.rng_seed, *address_key(job, hop)))),
        "defects": defects,
        "violation": 0.1,
        "n_iterations": 7,
        "n_evaluations": 9,
        "cpu_seconds": 1.5,
        "wall_seconds": 1.6,
        "move": "accepted" if isinstance(job, HopJob) else None,
    }
    if rng.random() > feasible_share:
        return SolveRecord(
            ending=Ending.INFEASIBLE, status="STALLED", is_feasible=False, objective_kg=None, **common
        )
    final_mass = float(rng.uniform(12_000, 13_000))
    return SolveRecord(
        ending=Ending.FEASIBLE,
        status="OPTIMAL",
        is_feasible=True,
        objective_kg=final_mass,
        x=tuple(rng.random(layout_of(problem).n_variables).tolist()),
        trajectory=trajectory(final_mass),
        certificate=Certificate(
            paper=True, strict=bool(rng.random() < 0.8), defects=defects, cpu_seconds=0.1
        ),
        **common,
    )


def trajectory(final_mass):
    return Trajectory(
        final_mass_kg=final_mass,
        propellant_kg=13_276.04 - final_mass,
        delta_v_km_s=26.55465 * np.log(13_276.04 / final_mass),
        delta_v_total_km_s=26.55465 * np.log(15_000 / final_mass),
        shooting_days=40.0,
        initial_coast_days=1.0,
        final_coast_days=2.0,
        time_of_flight_days=43.0,
        insertion_epoch="2026-06-06T00:00:00.000",
        arrival_epoch="2026-06-08T00:00:00.000",
    )


def run_fake(job, stop=lambda: False):
    """Answer at once."""
    hops = range(job.n_hops) if isinstance(job, HopJob) else (job.address.hop,)
    share = 1.0 if isinstance(job, MapJob) else 0.5
    solves = tuple(record(job, hop, share) for hop in hops)
    best = Ending.FEASIBLE if any(solve.x for solve in solves) else Ending.INFEASIBLE
    return JobOutcome(ending=best, solves=solves, provenance=PROVENANCE)


def run_until_stopped(job, stop):
    """Solve for ever, as IPOPT does, until the flag is seen."""
    while not stop():
        time.sleep(0.005)
    return JobOutcome(ending=Ending.CANCELLED, provenance=PROVENANCE)


def run_broken(job, stop):
    """Fail as a bug of ours does."""
    return JobOutcome(
        ending=Ending.ERROR, error="Traceback ...\nZeroDivisionError: oh", provenance=PROVENANCE
    )


def run_slowly(job, stop):
    """Answer after long enough for a test to interfere."""
    time.sleep(0.15)
    return run_fake(job, stop)


def run_deaf(job, stop):
    """Never look at the flag."""
    time.sleep(600)


def run_chain_zero_deaf(job, stop):
    """Hang on chain 0, answer on the others."""
    return run_deaf(job, stop) if job.address.chain == 0 else run_fake(job, stop)


def run_chain_one_suicidal(job, stop):
    """Die without a word on chain 1, answer on the others."""
    if job.address.chain == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return run_fake(job, stop)


def run_chain_one_breaking_off(job, stop):
    """Die in the middle of the reply on chain 1, answer on the others."""
    if job.address.chain == 1:
        (reply,) = [pipe for pipe in range(3, 64) if is_written_to(pipe)]
        os.write(reply, b'{"ticket": [1')
        os.kill(os.getpid(), signal.SIGKILL)
    return run_fake(job, stop)


def is_written_to(descriptor):
    try:
        is_pipe = stat.S_ISFIFO(os.fstat(descriptor).st_mode)
        return is_pipe and fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_ACCMODE == os.O_WRONLY
    except OSError:
        return False


def run_reporting_threads(job, stop):
    """Tell the process id, the environment and the threads of every numerical library."""
    _ = np.ones((200, 200)) @ np.ones((200, 200))
    threads = sorted({library["num_threads"] for library in threadpool_info()})
    told = f"{os.getpid()} {os.environ['OMP_NUM_THREADS']} {threads}"
    return JobOutcome(ending=Ending.ERROR, error=told, provenance=PROVENANCE)


def run_printing(job, stop):
    """Print, as solvers do, where only outcomes belong."""
    os.write(1, b"This is Ipopt\n")
    return run_fake(job, stop)


def run_solving_then_reporting_threads(job, stop):
    """Solve really, and tell how many threads the loaded libraries had before, during and after."""
    from workers.run import run_job

    seen = []

    def stop_and_look():
        seen.append(threads_now())
        return stop()

    before = threads_now()
    outcome = run_job(job, stop_and_look)
    assert outcome.error is None, outcome.error
    during = sorted({n for threads in seen for n in threads})
    told = f"before {before}, during {during}, after {threads_now()}"
    variable = os.environ["OMP_NUM_THREADS"]
    return JobOutcome(ending=Ending.ERROR, error=f"{told}, OMP_NUM_THREADS {variable}", provenance=PROVENANCE)


def threads_now():
    return sorted({library["num_threads"] for library in threadpool_info()})
