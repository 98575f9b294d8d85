"""What `complete` refuses: outcomes that no run of their job can have had, each by the name of its field."""

import copy
import re

import pytest

from tests.service.by_hand import worker_info
from tests.service.campaigns import finish, spec_fields, submitted
from tests.service.databases import rows
from tests.workers.fake import run_fake
from workers.executor import Inline

API = "/api/v1"


def reports(store, n=8):
    """Claim jobs of two hops each; return reports on them, those with a solution first."""
    submitted(store, spec_fields(guesses=2 * n))
    found = []
    for claim in store.claim(worker_info(), n):
        outcome = run_fake(claim.job).model_dump(mode="json")
        found.append({"job_id": claim.job_id, "attempt": claim.attempt, "outcome": outcome})
    return sorted(found, key=lambda report: not solved_in(report))


def solved_in(report):
    return [solve for solve in report["outcome"]["solves"] if solve["x"]]


def on_outcome(**fields):
    return lambda report: report["outcome"].update(fields)


def on_solve(**fields):
    return lambda report: report["outcome"]["solves"][0].update(fields)


def on_found(part=None, **fields):
    """Change a solve with a solution, or a part of it."""

    def change(report):
        solve = solved_in(report)[0]
        (solve[part] if part else solve).update(fields)

    return change


def entry(place, value):
    return lambda report: solved_in(report)[0]["x"].__setitem__(place, value)


def unsolved(report):
    for solve in report["outcome"]["solves"]:
        solve.update(ending="infeasible", x=None, trajectory=None, certificate=None)


def repeated(report):
    solves = report["outcome"]["solves"]
    report["outcome"]["solves"] = 250 * [solves[0], solves[1]]


POISONS = {
    "no provenance": (on_outcome(provenance=None), "provenance"),
    "500 solves for two hops": (repeated, "each hop once and in order"),
    "hops in another order": (lambda r: r["outcome"]["solves"].reverse(), "each hop once and in order"),
    "a hop beyond the job": (lambda r: r["outcome"]["solves"][1].update(hop=7), "hop of its job"),
    "a hop beyond the database": (on_solve(hop=2**70), "hop"),
    "a hop that is missing": (lambda r: r["outcome"]["solves"].pop(), "expected all 2"),
    "no solves": (on_outcome(solves=[]), "expected all 2"),
    "feasible without a solve": (unsolved, "ending"),
    "infeasible with a solution": (on_outcome(ending="infeasible"), "ending"),
    "the key of another hop": (on_solve(rng_key="7/0/0/0/99/0"), "rng_key"),
    "a key that is too long": (on_solve(rng_key="7" * 300), "rng_key"),
    "a status that is none": (on_solve(status="GREAT"), "status"),
    "a status with control characters": (on_solve(status="\x1b[31m"), "status"),
    "an ending of no solve": (on_solve(ending="lost"), "ending"),
    "feasible without a solution": (on_found(x=None, trajectory=None, certificate=None), "ending"),
    "a solution without a verdict": (on_found(certificate=None), "together"),
    "processor time beyond all": (on_solve(cpu_seconds=1e308), "cpu_seconds"),
    "processor time beyond the wall limit": (on_solve(cpu_seconds=1e6), "cpu_seconds"),
    "negative processor time": (on_solve(cpu_seconds=-1.0), "cpu_seconds"),
    "wall time beyond all": (on_solve(wall_seconds=1e300), "wall_seconds"),
    "iterations beyond the limit": (on_solve(n_iterations=10**9), "n_iterations"),
    "iterations beyond the database": (on_solve(n_iterations=2**63), "n_iterations"),
    "evaluations beyond all": (on_solve(n_evaluations=10**15), "n_evaluations"),
    "too few defects": (lambda r: r["outcome"]["solves"][0]["defects"][0].pop(), "defects"),
    "too many defects": (lambda r: r["outcome"]["solves"][0]["defects"].append(7 * [0.0]), "defects"),
    "feasible at a large violation": (on_found(violation=9.0), "is_feasible"),
    "feasible at large defects": (on_found(defects=[7 * [5.0]]), "is_feasible"),
    "no move of a hop": (on_solve(move=None), "move"),
    "a first hop that is rejected": (on_solve(move="rejected"), "move"),
    "a vector that is short": (lambda r: solved_in(r)[0]["x"].pop(), "decision vector: expected shape"),
    "a throttle beyond its bounds": (entry(3, 1.5), r"x\[3\] within its bounds"),
    "an angle beyond its bounds": (entry(4, -4.0), r"x\[4\] within its bounds"),
    "another objective": (on_found(objective_kg=9000.0), "objective_kg"),
    "another final mass": (on_found("trajectory", final_mass_kg=9000.0), "expected objective_kg"),
    "another propellant": (on_found("trajectory", propellant_kg=1.0), "propellant_kg"),
    "a mass beyond all": (on_found("trajectory", propellant_kg=1e308), "propellant_kg"),
    "another delta-v": (on_found("trajectory", delta_v_km_s=0.01), "delta_v_km_s"),
    "another total delta-v": (on_found("trajectory", delta_v_total_km_s=0.01), "delta_v_total_km_s"),
    "another time of flight": (on_found("trajectory", time_of_flight_days=1.0), "time_of_flight_days"),
    "another coast": (on_found("trajectory", final_coast_days=-1.0), "final_coast_days"),
    "another arrival": (on_found("trajectory", arrival_epoch="2026-01-01T00:00:00"), "arrival_epoch"),
    "an insertion that is none": (on_found("trajectory", insertion_epoch="soon"), "insertion_epoch"),
    "too few verified defects": (on_found("certificate", defects=[]), "defects"),
    "verified defects that are ragged": (on_found("certificate", defects=[[0.0]]), "defects"),
    "strict beyond the tolerance": (on_found("certificate", strict=True, defects=[7 * [0.5]]), "level"),
    "paper beyond the tolerance": (on_found("certificate", strict=False, defects=[7 * [9.0]]), "level"),
    "not even the paper's": (on_found("certificate", paper=False, strict=False), "level"),
    "details that are long": (on_found("certificate", details={"a": "b" * 200_000}), "details"),
    "details that no database holds": (on_found("certificate", details={"a": "\0"}), "details"),
    "provenance that is long": (on_outcome(provenance={"host": "h" * 10_000}), "provenance"),
}


@pytest.fixture
def report(store):
    found = reports(store)[0]
    assert solved_in(found)
    return found


@pytest.mark.parametrize("poison", POISONS)
def test_what_cannot_be_so_is_refused_by_its_field_and_stores_nothing(store, client, report, poison):
    change, named = POISONS[poison]
    changed = copy.deepcopy(report)
    change(changed)
    answer = client.post(f"{API}/jobs/complete", json=changed)
    assert answer.status_code == 422, answer.text
    assert re.search(named, answer.json()["detail"]), answer.text
    for table in ("solve", "solution", "provenance"):
        assert rows(store, f"SELECT count(*) FROM {table}") == [(0,)]
    assert client.get(f"{API}/solutions").json()["items"] == []
    # The job is still the worker's, and takes the report as it should have been.
    assert client.post(f"{API}/jobs/complete", json=report).json()["state"] == "done"
    assert len(client.get(f"{API}/solutions").json()["items"]) == len(solved_in(report))


def test_a_refused_outcome_among_others_costs_none_of_them(store, client):
    bad, *good = reports(store, 4)
    on_outcome(provenance=None)(bad)
    answer = client.post(f"{API}/jobs/complete-many", json={"reports": [*good, bad]})
    assert answer.status_code == 422 and f"job {bad['job_id']}: provenance" in answer.json()["detail"]
    assert rows(store, "SELECT count(*) FROM solve") == [(0,)]
    for one in good:
        assert client.post(f"{API}/jobs/complete", json=one).json()["state"] == "done"


def test_a_worker_whose_outcome_is_refused_says_so_and_the_job_is_given_up(store):
    def run_expensively(job, stop):
        outcome = run_fake(job)
        dear = outcome.solves[0].model_copy(update={"cpu_seconds": 1e7})
        spoilt = outcome.model_copy(update={"solves": (dear, *outcome.solves[1:])})
        return spoilt if job.address.chain == 0 else outcome

    submitted(store)
    finish(store, Inline(run_expensively))
    (dead,) = store.jobs(None, "s0", "dead", 10).items
    assert "cpu_seconds" in dead.error and "got 1e+07" in dead.error
    assert len(store.jobs(None, "s0", "done", 10).items) == 3


def test_a_job_that_hung_or_was_cut_short_needs_no_more_than_it_has(store, client):
    hung, cut, *_ = reports(store, 4)
    hung["outcome"] = {"ending": "timeout", "error": "job: expected an outcome in time, got none"}
    assert client.post(f"{API}/jobs/complete", json=hung).json()["state"] == "done"
    cut["outcome"].update(ending="cancelled", solves=cut["outcome"]["solves"][:1])
    assert client.post(f"{API}/jobs/complete", json=cut).json()["state"] == "queued"
    assert rows(store, "SELECT count(*) FROM solve") == [(1,)]


def test_what_is_left_of_a_chain_completes_what_an_earlier_attempt_brought(store, client):
    cut, *_ = reports(store, 4)
    whole = copy.deepcopy(cut)
    cut["outcome"].update(ending="cancelled", solves=cut["outcome"]["solves"][:1])
    client.post(f"{API}/jobs/complete", json=cut)
    (again,) = [claim for claim in store.claim(worker_info(), 50) if claim.job_id == cut["job_id"]]
    rest = whole["outcome"] | {"solves": whole["outcome"]["solves"][1:]}
    later = {"job_id": again.job_id, "attempt": again.attempt, "outcome": rest}
    assert client.post(f"{API}/jobs/complete", json=later).json()["state"] == "done"
    assert rows(store, f"SELECT count(*) FROM solve WHERE job_id = {again.job_id}") == [(2,)]
