"""A campaign whose guesses are known solutions of the preset, so that an archive fills in seconds.

The vectors in `vectors.json` came from IPOPT on `core.transcription`, closed at an integrator tolerance of
1e-12; here they pass through the real verifier, store and dispatcher. Chains without a known vector end
infeasible, as most guesses do. Iterations, CPU times and the defects "as solved" are made up.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np

from core.problem import problem_from
from core.tolerances import violation
from core.verification.verify import verify
from service.spec import spec_from
from tests.service.campaigns import dispatcher_on
from workers.certify import trajectory, verification_record
from workers.executor import Inline
from workers.messages import Ending, HopJob, JobOutcome, Provenance, SolveRecord
from workers.run import hop_address

VECTORS = json.loads((Path(__file__).parent / "vectors.json").read_text(encoding="utf-8"))
OUTAGE = {"segment": 24, "duration_days": 1.0}
SPEC = {
    "campaign": {"name": "known solutions", "rng_seed": 2026},
    "problem": {"preset": "ppe-drm3"},
    "search": [
        {"id": "s0", "strategy": "S(0)", "guesses": 5, "hops": 1},
        {"id": "s1-0", "strategy": "S(1|0)", "outages": [OUTAGE], "seeds": {"from": "s0"}},
    ],
}
PROVENANCE = Provenance(
    code_version="0", python_version="3", package_versions={}, kernel_hashes={}, host="here"
)


def submitted(store):
    return store.submit(spec_from(SPEC))[0]


def dispatcher(store):
    return dispatcher_on(store, Inline(run_known))


def run_known(job, stop=lambda: False):
    """Answer with the known vector of a chain or of a seed, certified by the verifier."""
    known = VECTORS["S(0)"] if isinstance(job, HopJob) else VECTORS["S(1|0)"]
    place = job.address.chain if isinstance(job, HopJob) else _seed_place(job)
    solve = record(job, known[place]) if place < len(known) else failure(job, job.address.hop)
    return JobOutcome(ending=solve.ending, solves=(solve,), provenance=PROVENANCE)


def _seed_place(job):
    return next(place for place, x in enumerate(VECTORS["S(0)"]) if x[0] == job.seed_x[0])


def record(job, x):
    """Return the solve that found a vector, certified by the verifier."""
    found, flown = _flown(json.dumps(job.problem), tuple(x))
    defects = tuple(map(tuple, found.defects.tolist()))
    worst = violation(found.defects)
    return SolveRecord(
        ending=Ending.FEASIBLE,
        status="OPTIMAL",
        is_feasible=worst <= 1.0,
        objective_kg=flown.final_mass_kg,
        violation=worst,
        defects=defects,
        x=tuple(x),
        trajectory=flown,
        certificate=verification_record(found, 0.3),
        **_common(job, job.address.hop),
    )


@cache
def _flown(definition, x):
    """Return the verification and the trajectory of a vector: the same in every archive of a process."""
    problem, vector = problem_from(json.loads(definition)), np.array(x)
    found = verify(problem, vector)
    return found, trajectory(problem, vector, found)


def failure(job, hop):
    """Return a solve that found nothing."""
    far = (1 + len(job.problem["outages"])) * ((1e5,) * 3 + (1.0,) * 3 + (100.0,),)
    return SolveRecord(
        ending=Ending.INFEASIBLE,
        status="LOCALLY_INFEASIBLE",
        is_feasible=False,
        objective_kg=None,
        violation=1e6,
        defects=far,
        **_common(job, hop),
    )


def _common(job, hop):
    return {
        "hop": hop,
        "rng_key": "/".join(map(str, (job.rng_seed, *hop_address(job, hop)))),
        "n_iterations": 312,
        "n_evaluations": 400,
        "cpu_seconds": 21.5,
        "wall_seconds": 22.0,
        "move": ("rejected" if hop else "accepted") if isinstance(job, HopJob) else None,
    }
