"""Runners that stand for the solver: quick, deterministic, and badly behaved where a test wants it."""

import fcntl
import json
import os
import signal
import stat
import time
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
from threadpoolctl import threadpool_info

from core.constants import SECONDS_PER_DAY
from core.orbits import departure_state
from core.problem import problem_from
from core.transcription import layout_of
from workers.certify import trajectory
from workers.messages import (
    KIND_NUMBERS,
    ChainPart,
    ChainPlace,
    Ending,
    HopJob,
    JobOutcome,
    MapJob,
    Provenance,
    SolveRecord,
    VerificationRecord,
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
    problem, start, box = settled(json.dumps(job.problem))
    defects = tuple(tuple(row) for row in (1e-7 * rng.standard_normal((1 + problem.k, 7))).tolist())
    common = {
        "hop": hop,
        "rng_key": "/".join(map(str, (job.rng_seed, *address_key(job, hop)))),
        "defects": defects,
        "n_iterations": 7,
        "n_evaluations": 9,
        "cpu_seconds": 1.5,
        "wall_seconds": 1.6,
        "move": "accepted" if isinstance(job, HopJob) else None,
    }
    if rng.random() > feasible_share:
        return SolveRecord(
            ending=Ending.INFEASIBLE,
            status="STALLED",
            is_feasible=False,
            violation=10.0,
            objective_kg=None,
            **common,
        )
    final_mass = float(rng.uniform(12_000, 13_000))
    x = box[0] + (box[1] - box[0]) * rng.random(len(box[0]))
    x[layout_of(problem).reference.final_mass] = final_mass
    return SolveRecord(
        ending=Ending.FEASIBLE,
        status="OPTIMAL",
        is_feasible=True,
        violation=0.1,
        objective_kg=final_mass,
        x=tuple(x.tolist()),
        trajectory=flown(problem, start, x),
        certificate=VerificationRecord(
            paper=True, strict=bool(rng.random() < 0.8), defects=defects, cpu_seconds=0.1
        ),
        **common,
    )


@lru_cache(maxsize=64)
def settled(text):
    """Return a problem, its departure and the box of its decision vector."""
    problem = problem_from(json.loads(text))
    start = departure_state(problem.departure, problem.spacecraft)
    return problem, start, layout_of(problem).bounds(problem, start.mass_kg)


def flown(problem, start, x):
    """Return what a verifier would say of a vector's reference."""
    own = layout_of(problem).reference
    days = x[own.shooting_time] + x[own.initial_coast] + x[own.final_coast]
    found = SimpleNamespace(final_mass_kg=[x[own.final_mass]], arrival_et=[start.et + days * SECONDS_PER_DAY])
    return trajectory(problem, x, found)


def reflown(job, solve, **changes):
    """Return a solve with other numbers in its vector, and with what follows from them."""
    problem, start, _ = settled(json.dumps(job.problem))
    x, own = np.array(solve.x), layout_of(problem).reference
    for name, value in changes.items():
        x[getattr(own, name)] = value
    more = {"x": tuple(x.tolist()), "trajectory": flown(problem, start, x)}
    return solve.model_copy(update=more | {"objective_kg": float(x[own.final_mass])})


def part_of(job, hops, n_done):
    """Return some hops of a chain that goes on."""
    outcome = run_fake(job)
    place = ChainPlace(next_hop=n_done, ending=Ending.FEASIBLE, failures=0, width=0.1, has_incumbent=False)
    return ChainPart(solves=[outcome.solves[hop] for hop in hops], provenance=outcome.provenance, place=place)


def opened(outcome):
    """Return an outcome that is sealed as whoever stores it reads it."""
    return JobOutcome.model_validate_json(outcome.to_json())


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


def run_handing_in(job, stop, hand_in=lambda part: None):
    """Hand in every hop but the last of a chain that takes its time, beginning where it was left."""
    whole = run_fake(job, stop)
    first = job.place.next_hop if isinstance(job, HopJob) and job.place else 0
    for n, solve in enumerate(whole.solves[first:-1], first + 1):
        time.sleep(0.15)
        place = ChainPlace(next_hop=n, ending=whole.ending, failures=0, width=0.1, has_incumbent=False)
        hand_in(ChainPart(solves=(solve,), provenance=PROVENANCE, place=place))
    time.sleep(0.15)
    return whole.model_copy(update={"solves": whole.solves[first:]})


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
