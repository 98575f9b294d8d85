"""The long benchmarks from the command line, with a solver that answers at once."""

import itertools
import json

import pytest

from service import cli
from service.cli import bench as bench_session
from service.cli.bench import Progress
from tests.workers.fake import run_fake
from workers.executor import Inline
from workers.measure_solves import read_solutions
from workers.provenance import machine, revision
from workers.run import run_job

MEASURED = {
    "status",
    "strict",
    "stationarity",
    "n_iterations",
    "cpu_seconds",
    "verify_seconds",
    "propellant_kg",
}


@pytest.fixture
def bench(monkeypatch, capsys):
    """Return a function that runs `coastarc bench` in this process: (exit code, stdout, stderr)."""

    def call(*words, runner=run_fake):
        monkeypatch.setattr(bench_session, "ProcessPool", lambda n: Inline(runner))
        monkeypatch.setattr("sys.argv", ["coastarc", "bench", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return call


def interrupted_after(n):
    """Return a runner that is interrupted, as by Ctrl-C, in its nth job; the first one only warms up."""
    calls = itertools.count()

    def run(job, stop):
        if next(calls) == n:
            raise KeyboardInterrupt
        return run_fake(job, stop)

    return run


@pytest.fixture
def seeds(bench, tmp_path):
    path = tmp_path / "seeds.json"
    bench("solve", "--guesses", 12, "--save", path)
    return path


def test_solve_prints_shares_costs_and_what_they_depend_on(bench, tmp_path):
    code, printed, progress = bench("solve", "--guesses", 6, "--rng-seed", 3, "--json", tmp_path / "a.json")
    assert code == 0 and "PARTIAL" not in printed
    content = json.loads((tmp_path / "a.json").read_text())
    n_strict = content["summary"]["strict"]["n"]
    assert f" {n_strict} strict solutions " in printed and "failures: " in printed
    for fact in (
        "machine",
        "packages",
        "revision",
        "rng_seed: 3",
        "law: uniform",
        "cpu_seconds",
        "problem_hash",
    ):
        assert fact in printed
    assert progress.startswith("1/6 guesses: ")


def test_the_json_of_solve_holds_every_guess_and_its_settings(bench, tmp_path):
    bench("solve", "--guesses", 5, "--max-iterations", 40, "--json", tmp_path / "a.json")
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["command"] == "bench solve" and content["is_partial"] is False
    assert content["settings"]["max_iterations"] == 40 and content["settings"]["k"] == 0
    assert [guess["number"] for guess in content["guesses"]] == list(range(5))
    assert all(set(guess) >= MEASURED for guess in content["guesses"])
    assert set(content["machine"]) == {"machine", "python", "packages", "code", "revision"}


def test_a_dash_prints_the_json_and_no_table(bench):
    _, printed, _ = bench("solve", "--guesses", 2, "--json", "-")
    assert json.loads(printed)["summary"]["strict"]["of"] == 2


def test_an_interrupted_run_prints_and_writes_what_it_has_as_partial(bench, tmp_path):
    words = ("solve", "--guesses", 9, "--json", tmp_path / "a.json", "--save", tmp_path / "s.json")
    code, printed, _ = bench(*words, runner=interrupted_after(4))
    content = json.loads((tmp_path / "a.json").read_text())
    assert code == 130 and "PARTIAL: interrupted after 3 of 9 guesses" in printed
    assert content["is_partial"] is True and len(content["guesses"]) == 3
    assert len(read_solutions(tmp_path / "s.json")) == content["summary"]["strict"]["n"]


def test_what_was_solved_before_a_kill_is_in_the_json(bench, tmp_path):
    seen = []

    def run_reading(job, stop):
        path = tmp_path / "a.json"
        seen.append(len(json.loads(path.read_text())["guesses"]) if path.exists() else None)
        return run_fake(job, stop)

    bench("solve", "--guesses", 4, "--json", tmp_path / "a.json", runner=run_reading)
    assert seen == [None, None, 1, 2, 3]


def test_solve_takes_a_problem_with_outages(bench, tmp_path):
    spec = tmp_path / "problem.toml"
    spec.write_text('preset = "ppe-drm3"\noutages = [{ segment = 24, duration_days = 1.0 }]\n')
    code, printed, _ = bench("solve", spec, "--guesses", 1)
    assert code == 0 and "k: 1" in printed


def test_chain_maps_saved_seeds_by_each_mapping(bench, seeds, tmp_path):
    words = ("--limit", 2, "--cases", "S(1|0)@24,S(2|0)@4-12,S(3|2)@4-8-12", "--json", tmp_path / "c.json")
    code, printed, _ = bench("chain", "--seeds", seeds, *words, "--save", tmp_path / "found.json")
    content = json.loads((tmp_path / "c.json").read_text())
    assert code == 0 and content["command"] == "bench chain" and content["settings"]["seeds"] == 2
    assert len(content["cases"]) == len(content["groups"]) == 9
    assert all(one["strict"]["of"] == 2 for one in content["cases"] if one["group"] != "S(3|2)")
    assert all(set(one) >= MEASURED | {"case", "mapping", "seed", "change_kg"} for one in content["solves"])
    found = read_solutions(tmp_path / "found.json")
    assert len(found) == sum(one["strict"] for one in content["solves"]) and {
        one.problem.k for one in found
    } > {1}
    assert "S(3|2)@4-8-12" in printed and "S(1|0)" in printed


def test_chain_without_a_file_finds_its_seeds_first(bench, tmp_path):
    words = ("--limit", 3, "--group", "s12", "--mapping", "aligned", "--save-seeds", tmp_path / "s.json")
    code, printed, progress = bench("chain", *words)
    assert code == 0 and "seeds: 3" in printed and "S(12|0)@4-8-" in printed
    assert "of 3 seeds" in progress and len(read_solutions(tmp_path / "s.json")) == 3


def test_an_interrupted_chain_keeps_what_it_has(bench, seeds, tmp_path):
    words = ("--group", "s1", "--mapping", "aligned", "--json", tmp_path / "c.json")
    code, printed, _ = bench("chain", "--seeds", seeds, *words, runner=interrupted_after(6))
    content = json.loads((tmp_path / "c.json").read_text())
    assert code == 130 and "PARTIAL: interrupted after 5 of at most" in printed
    assert content["is_partial"] is True and len(content["solves"]) == 5


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("solve", "--law", "gauss"), "law: expected one of uniform, thrust-coast-thrust, got 'gauss'"),
        (("solve", "--guesses", 0), "guesses: expected at least 1, got 0"),
        (("solve", "--cpu-seconds", -1), "cpu_seconds: expected a positive number, got -1.0"),
        (("solve", "mars"), "mars"),
        (("solve", "--json", "nowhere/a.json"), "json: expected a file in a folder that exists"),
        (("solve", "--save", "."), "save: expected a file in a folder that exists, got ."),
        (("chain", "--cases", "24"), "case: expected one like S(3|0)@12-24-40, got '24'"),
        (("chain", "--group", "s7"), "group: expected one of s1, "),
        (("chain", "--seeds", "none.json"), "seeds: expected a file that can be read, got none.json"),
    ],
)
def test_what_a_user_did_wrong_is_one_line(bench, words, told):
    code, _, printed = bench(*words)
    assert code == 2 and told in printed and "Traceback" not in printed
    assert printed.startswith("error: ")


def test_a_mapping_that_is_not_there_is_named(bench, seeds):
    code, _, printed = bench("chain", "--seeds", seeds, "--mapping", "best")
    assert code == 2 and "mapping: expected one of reference, aligned, continued, got 'best'" in printed


def test_the_revision_is_that_of_the_checkout():
    assert machine()["revision"] == revision() != ""


def test_progress_on_a_terminal_is_one_line_written_over(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    progress = Progress()
    for line in ("1/2", "2/2"):
        progress.show(line)
    progress.end()
    assert capsys.readouterr().err == "\r1/2\x1b[K\r2/2\x1b[K\n"


def test_solve_says_why_guesses_fail_and_what_the_thrust_reaches(bench, tmp_path):
    weak = tmp_path / "weak.toml"
    craft = "{ wet_mass_kg = 1500.0, dry_mass_kg = 700.0, max_thrust_n = 0.01, isp_s = 3000.0 }"
    weak.write_text(f'preset = "earth-mars"\nspacecraft = {craft}\n')
    code, printed, told = bench("solve", weak, "--guesses", 2, "--json", tmp_path / "a.json", runner=run_job)
    assert code == 0 and "no guess can close: 0.01 N for 700 days on 1500 kg" in told
    content = json.loads((tmp_path / "a.json").read_text())
    (failure,) = content["failures"]
    assert failure["n"] == 2 and "spacecraft.max_thrust_n" in failure["at_bounds"]
    # The change of orbit takes some 6 km/s, of which a tenth is there.
    assert failure["defect_km"] > 1e6 and failure["defect_m_s"] > 1e3
    assert "spacecraft.max_thrust_n" in printed and "The solver settled where defects remain" in printed
    assert "thrust: at most 0.40" in printed and "no transfer needs less than 2.52 km/s" in printed
    assert content["summary"]["failures"]["propellant_kg"] is None


def test_oracles_shows_published_values_beside_ours(bench):
    code, printed, _ = bench("oracles", "--case", "emtg-fblt-earth-mars", "--guesses", 1, "--json")
    (row,) = json.loads(printed)["rows"]
    # Within 20 g of EMTG's.
    assert code == 0 and row["n_strict"] == 1 and row["best"] > row["published"] - 0.02


def test_a_case_that_is_not_published_is_refused(bench):
    code, _, told = bench("oracles", "--case", "vulcan")
    assert code == 2 and "expected some of jiang-3rev" in told and "got vulcan" in told
