"""A real seed chain: a stored strict solution of P_0, mapped to P_1, solved, verified and archived."""

import json
from pathlib import Path

import numpy as np
import pytest

import core
from core.nlp import ExitStatus, Outcome, solve
from core.transcription import FINE_TOLERANCE
from service.schemas.solution import Filter
from tests.service.campaigns import OUTAGE, finish, spec_fields, submitted
from workers import run
from workers.executor import Inline

SEED = np.array(json.loads((Path(__file__).parents[1] / "data" / "strict_p0.json").read_text())["x"])


def found_at_once(transcription, guess, settings, stop=lambda: False):
    """Return the stored solution of P_0 instead of searching for it; what else is asked is solved."""
    if transcription.problem.k:
        return solve(transcription, guess, settings, stop)
    defects = transcription.at_tolerance(FINE_TOLERANCE).defects(SEED).reshape(-1, 7)
    return Outcome(ExitStatus.OPTIMAL, SEED, float(SEED[-1]), 0.01, defects, 1, 1, 0.0)


@pytest.fixture
def finished(store, monkeypatch):
    search = {"strategy": "S(1|0)", "outages": [OUTAGE], "seeds": {"from": "s0"}, "mapping": "reference"}
    searches = [{"id": "s0", "strategy": "S(0)", "guesses": 1}, {"id": "s1-0", "cpu_seconds": 20, **search}]
    monkeypatch.setattr(run.core, "solve", found_at_once)
    submitted(store, spec_fields(search=searches))
    finish(store, Inline(run.run_job))
    return store


def test_a_seed_becomes_a_verified_solution_that_survives_an_outage(finished, client):
    s0, s1 = finished.campaign(1).searches
    assert (s0.n_strict, s1.n_solves, s1.n_strict) == (1, 1, 1)
    (record,) = finished.all_records(Filter(search="s1-0"))
    (seed,) = finished.all_records(Filter(search="s0"))
    assert record.seed_id == seed.id and record.mapping == "reference" and record.strict
    distances = np.linalg.norm(np.array(record.defects_verified)[:, :3], axis=1)
    assert distances.max() < 0.1  # the strict tolerance [km]
    # A constraint more cannot make the optimum better; here the outage falls into a coast and costs nothing.
    assert record.propellant_kg > seed.propellant_kg - 0.05
    assert core.verify(core.load_problem("ppe-drm3").with_outages([(24, 1.0)]), np.array(record.x)).strict
    flown = client.get(f"/api/v1/solutions/{record.id}/trajectory").json()
    assert len(flown["trajectories"]) == 2 and flown["trajectories"][1]["outage"] == OUTAGE
