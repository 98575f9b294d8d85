"""One archive that holds a campaign of each kind that the product can make.

Its solutions are real ones: their vectors came from IPOPT, those of `tests.acceptance.known` and those of
`data/kinds.json`, one for each job that found something, by the address that `_place` gives it.  Here they
pass through the real verifier, store and dispatcher; jobs without a vector end infeasible.
"""

import json
import tempfile
from functools import cache
from pathlib import Path
from typing import NamedTuple

from core.problem import load_problem, problem_from
from service.new_file import write_new
from service.schemas.solution import Filter
from service.solutions.refine import refinement_spec
from service.spec import spec_from
from service.spec.missed_thrust import analysis_spec, grid_of
from service.store.archive_files import import_file, packed, pieces
from service.store.store import Store
from tests.acceptance import known
from tests.service.campaigns import dispatcher_on
from tests.workers.jobs import worker_info
from workers.executor import Inline
from workers.messages import Ending, HopJob, JobOutcome

VECTORS = Path(__file__).parent / "data" / "kinds.json"
PROBLEM = {"preset": "ppe-drm3"}
SEEDS = {"campaign": "quick", "from": "s0"}


class Kinds(NamedTuple):
    """The campaigns of the archive by what they are, by id."""

    quick: int
    cases: int
    missed_thrust: int
    refined: int
    imported: int
    failed: int
    cancelled: int
    paused: int
    running: int


def every_kind(store: Store, runner=None) -> Kinds:
    """Fill an archive."""
    runner = runner or run_known
    quick = _worked_off(store, _quick(), runner)
    cases = _worked_off(store, _cases(), runner)
    seed = store.record(store.certificates.ids(Filter(campaign=quick, k=0))[0])
    grid = grid_of(load_problem("ppe-drm3"), "24,30", "0.5,1")
    missed = _worked_off(store, analysis_spec(seed.id, load_problem("ppe-drm3"), grid), runner)
    refined = _worked_off(store, refinement_spec(store, seed, 100, {}).as_fields(), runner)
    imported = _imported(store, runner)
    failed = _worked_off(store, _chains("all failed", 3), run_in_vain)
    cancelled = _begun(store, _chains("cancelled", 40), "cancel")
    paused = _begun(store, _chains("paused", 40), "pause")
    return Kinds(quick, cases, missed, refined, imported, failed, cancelled, paused, _running(store))


def _quick():
    chain = {"id": "s2-1", "strategy": "S(2|1)", "outages": [known.OUTAGE, known.OUTAGE | {"segment": 30}]}
    search = [*known.SPEC["search"], chain | {"seeds": {"from": "s1-0", "limit": 1}}]
    return known.SPEC | {"campaign": {"name": "quick", "rng_seed": 2026}, "search": search}


def _cases():
    several = {"strategy": "S(1|0)", "cases": [[24], [30]], "duration_days": 1.0, "seeds": SEEDS}
    search = [
        {"id": "direct", "strategy": "S(1)", "cases": [[24], [30]], "duration_days": 1.0, "guesses": 4},
        {"id": "seeded", **several},
        {
            "id": "chosen",
            **several,
            "mapping": "continued",
            "seeds": SEEDS | {"order": "delta_v", "limit": 1},
        },
    ]
    return {"campaign": {"name": "cases", "rng_seed": 3}, "problem": PROBLEM, "search": search}


def _chains(name, guesses):
    search = [
        {
            "id": "s0",
            "strategy": "S(0)",
            "guesses": guesses,
            "hops": 2,
            "hop_law": "pareto",
            "adaptive": True,
        },
        {"id": "s1-0", "strategy": "S(1|0)", "outages": [known.OUTAGE], "seeds": {"from": "s0"}},
    ]
    return {"campaign": {"name": name, "rng_seed": 5}, "problem": PROBLEM, "search": search}


def _worked_off(store, fields, runner):
    campaign_id, _ = store.submit(spec_from(fields, allow_files=True))
    dispatcher = dispatcher_on(store, Inline(runner))
    while dispatcher.step() or store.campaign_state(campaign_id) != "done":
        pass
    return campaign_id


def _begun(store, fields, verb):
    campaign_id, _ = store.submit(spec_from(fields))
    for claim in store.claim(worker_info("node7:1"), 3, campaign_id):
        store.complete(claim.ticket, run_known(claim.job))
    store.control_campaign(campaign_id, verb)
    return campaign_id


def _running(store):
    """Leave a campaign with jobs that are done, run, and were given up, and with others in the queue."""
    campaign_id, _ = store.submit(spec_from(_chains("running", 40)))
    first, second, *_ = store.claim(worker_info("node7:1"), 5, campaign_id)
    store.complete(first.ticket, run_known(first.job))
    broken = JobOutcome(
        ending=Ending.ERROR, error="Traceback ...\nZeroDivisionError: oh", provenance=known.PROVENANCE
    )
    store.complete(second.ticket, broken)
    return campaign_id


def _imported(store, runner):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "campaign.zip"
        (Path(folder) / "there").mkdir()
        with Store(Path(folder) / "there") as there:
            fields = known.SPEC | {"campaign": {"name": "imported", "rng_seed": 9}}
            with packed(there, _worked_off(there, fields, runner)) as draft:
                write_new(path, pieces(draft))
        return import_file(store, path).campaign_id


def place(job):
    """Return the address of a mapped seed, the same in every archive."""
    return f"{problem_from(job.problem).hash[:12]}-{job.seed_id[:12]}-{job.mapping}"


def run_known(job, stop=lambda: False):
    """Answer with the vector of a job, certified by the verifier."""
    if isinstance(job, HopJob):
        return known.run_known(job) if job.n_hops == 1 and not job.problem["outages"] else run_in_vain(job)
    if (vector := _vectors().get(place(job))) is None:
        return run_in_vain(job)
    return JobOutcome(
        ending=Ending.FEASIBLE, solves=(known.record(job, vector),), provenance=known.PROVENANCE
    )


def run_in_vain(job, stop=lambda: False):
    """Find nothing."""
    hops = range(job.n_hops) if isinstance(job, HopJob) else (job.address.hop,)
    solves = tuple(known.failure(job, hop) for hop in hops)
    return JobOutcome(ending=Ending.INFEASIBLE, solves=solves, provenance=known.PROVENANCE)


@cache
def _vectors():
    return json.loads(VECTORS.read_text(encoding="utf-8"))
