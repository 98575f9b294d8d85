"""The quick campaign, cut to its first solutions, as a user runs it: command, pool, solver, archive."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from core.problem import load_problem
from service.db.errors import DatabaseError
from service.spec import load_spec
from service.spec.spec_check import require_flyable
from service.store.errors import UnknownRowError
from service.store.store import Store
from workers.process_tree import single_threaded

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[2] / "examples"
COASTARC = Path(sys.executable).with_name("coastarc")
#: Of outages in 50 segments, those at about the same time in 20, where a solve takes a second or two.
SEGMENTS = {12: 5, 24: 10, 40: 16}
#: "Records" of the overview.
PROMISED = (
    "problem_hash x objective_kg delta_v_km_s shooting_days initial_coast_days final_coast_days "
    "time_of_flight_days arrival_epoch insertion_epoch defects_solved defects_verified paper strict status "
    "n_iterations cpu_seconds wall_seconds rng_key seed_id mapping code_version package_versions "
    "kernel_hashes host"
)


def start(*arguments):
    command = [str(COASTARC), *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=single_threaded(os.environ)
    )


def n_solves(folder):
    try:
        with Store(folder, read_only=True) as store:
            return store.campaign(1).searches[0].n_solves
    except (DatabaseError, UnknownRowError):
        return 0  # Not created, or not submitted, yet.


def shortened(text):
    """Return the quick campaign in 20 segments, with as many guesses as four solutions take.

    Of four, on any processor, one or more survive the outages of each search.
    """
    changes = {"n_segments = 50\n": "n_segments = 20\n", "guesses = 30\n": "solutions = 4\n"}
    changes |= {f"segment = {segment}, ": f"segment = {SEGMENTS[segment]}, " for segment in SEGMENTS}
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Run the campaign, interrupt it after its first solve, run it again; return folder and the two runs."""
    folder = tmp_path_factory.mktemp("quick")
    spec = folder / "quick.toml"
    spec.write_text(shortened((EXAMPLES / "quick.toml").read_text(encoding="utf-8")), encoding="utf-8")
    with start("run", spec, "--data", folder, "--workers", 2) as first:
        deadline = time.monotonic() + 600
        while not n_solves(folder) and first.poll() is None and time.monotonic() < deadline:
            time.sleep(0.1)
        first.send_signal(signal.SIGINT)
        printed = first.stdout.read()
    kept = n_solves(folder)
    with start("run", spec, "--data", folder, "--workers", 2) as second:
        printed_then = second.stdout.read()
    return folder, (first.returncode, printed, kept), (second.returncode, printed_then)


@pytest.fixture(scope="module")
def records(runs):
    with start("solutions", "list", "--json", "--data", runs[0]) as listing:
        printed = listing.stdout.read()
    assert listing.returncode == 0
    return json.loads(printed)


def test_an_interrupted_run_keeps_its_results_and_goes_on_to_the_end(runs):
    _, (code, printed, n_kept), (code_then, printed_then) = runs
    assert code == 130 and "every result is kept" in printed and "Traceback" not in printed
    assert n_kept >= 1
    assert code_then == 0 and "Resuming campaign 1" in printed_then and "quick: done" in printed_then


def test_every_search_has_verified_strict_solutions(records):
    assert {record["search"] for record in records if record["strict"]} == {"s0", "s1-0", "s3-0"}
    for record in records:
        # Strict: 0.1 km, 1e-4 km/s and 0.01 kg; both judgements, by different integrators, must agree.
        for row in (*record["defects_solved"], *record["defects_verified"]) if record["strict"] else ():
            assert sum(d * d for d in row[:3]) < 0.1**2 and sum(d * d for d in row[3:6]) < 1e-4**2
            assert abs(row[6]) < 0.01
        assert len(record["defects_verified"]) == 1 + record["k"]


def test_a_robust_solution_names_the_seed_it_comes_from(records):
    of_s0 = {record["id"]: record for record in records if record["search"] == "s0"}
    for record in records:
        if record["search"] != "s0":
            seed = of_s0[record["seed_id"]]
            assert record["mapping"] == "continued" and seed["strict"] and seed["seed_id"] is None
            segments = {"s1-0": [10], "s3-0": [5, 10, 16]}[record["search"]]
            assert record["outages"] == [{"segment": n, "duration_days": 1.0} for n in segments]


def test_every_record_has_all_its_fields(records):
    for record in records:
        assert set(PROMISED.split()) <= set(record)
        missing = {name for name in PROMISED.split() if record[name] in (None, "", [], {})}
        assert missing <= ({"seed_id", "mapping"} if record["search"] == "s0" else set())
        assert record["cpu_seconds"] > 0 and record["n_iterations"] > 0


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.name)
def test_an_example_loads_and_can_be_flown(path):
    if "[campaign]" in path.read_text(encoding="utf-8"):
        require_flyable(load_spec(path).problem)
    else:
        assert load_problem(path).k == 0
