import json
import logging
import re
import signal
import subprocess
import sys
import time

import httpx
import pytest

from core import jit
from service import cli, logs
from service.cli import run as cli_run
from service.cli.options import console
from service.coordinator import Coordinator
from service.db.errors import DatabaseError
from service.spec import spec_from
from service.store.store import Store
from tests.service.campaigns import SPIRAL, content, finish, spec_fields, submitted

#: What is over in a second takes a busy machine longer.
PATIENCE_S = 120.0


@pytest.fixture
def coastarc(tmp_path, monkeypatch, capsys):
    """Return a function that runs a command in this process: (exit code, stdout, stderr)."""
    monkeypatch.setattr(cli_run, "RUNNER", "tests.workers.fake:run_fake")
    # Handlers are the whole process's, and this one is pytest's.
    monkeypatch.setattr(logs, "configure", lambda **_: None)
    monkeypatch.setattr(console, "_force_terminal", False)
    monkeypatch.setattr(console, "_width", 200)

    def call(*arguments, data=tmp_path):
        words = [str(word) for word in arguments]
        monkeypatch.setattr(sys, "argv", ["coastarc", *words, *(["--data", str(data)] if data else [])])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return call


@pytest.fixture
def spec_file(tmp_path):
    path = tmp_path / "spec.json"
    path.write_text(json.dumps(spec_fields()))
    return path


def start(tmp_path, *arguments, runner="run_fake"):
    command = [sys.executable, "-m", "tests.service.fake_coastarc", runner, *map(str, arguments)]
    return subprocess.Popen(
        [*command, "--data", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        # As a shell starts what stands before an `&`.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )


def wait_for(condition, seconds=240.0):
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return found


def n_running(folder):
    try:
        with Store(folder, read_only=True) as store:
            return len(store.jobs(None, None, "running", 10).items)
    except DatabaseError:
        return 0  # Not created yet.


def test_run_says_where_the_page_is_and_ends_with_a_summary(coastarc, spec_file):
    code, printed, _ = coastarc("run", spec_file, "--workers", 2)
    assert code == 0 and re.match(r"Live page: http://127\.0\.0\.1:\d+/campaigns/1\n", printed)
    assert "test: done" in printed and re.search(r"S\(1\|0\).* 100\.0 .*\n +\d+\.?\d*-100 ", printed)


def test_a_run_whose_jobs_fail_says_so(coastarc, spec_file, monkeypatch):
    monkeypatch.setattr(cli_run, "RUNNER", "tests.workers.fake:run_broken")
    code, _, printed = coastarc("run", spec_file)
    assert code == 1 and "4 jobs failed, the first with: ZeroDivisionError: oh" in printed


def test_jobs_that_failed_are_tried_again_by_the_next_run(coastarc, spec_file, tmp_path, monkeypatch):
    with monkeypatch.context() as broken:
        broken.setattr(cli_run, "RUNNER", "tests.workers.fake:run_broken")
        coastarc("run", spec_file)
    code, printed, _ = coastarc("run", spec_file)
    assert code == 0 and "4 jobs that failed before are tried again" in printed
    (tmp_path / "undisturbed").mkdir()
    with Store(tmp_path, read_only=True) as store, Store(tmp_path / "undisturbed") as undisturbed:
        submitted(undisturbed)
        finish(undisturbed)
        assert content(store) == content(undisturbed)


def test_a_finished_campaign_run_again_prints_its_summary_and_does_nothing(coastarc, spec_file, tmp_path):
    coastarc("run", spec_file)
    with Store(tmp_path, read_only=True) as store:
        before = store.last_event_id(1)
        code, printed, _ = coastarc("run", spec_file)
        assert code == 0 and "nothing is left to do" in printed and "test: done" in printed
        assert store.last_event_id(1) == before


def test_solutions_are_listed_with_all_their_fields_as_json(coastarc, spec_file, tmp_path):
    coastarc("run", spec_file)
    _, printed, _ = coastarc("solutions", "list", "--json", "--search", "s1-0")
    records = json.loads(printed)
    promised = (
        "problem_hash x objective_kg delta_v_km_s time_of_flight_days defects_solved defects_verified "
        "paper strict status n_iterations cpu_seconds wall_seconds rng_key seed_id mapping code_version "
        "package_versions kernel_hashes host"
    )
    assert records and set(promised.split()) <= set(records[0])
    _, shown, _ = coastarc("solutions", "show", records[0]["id"][:8], "--json")
    assert json.loads(shown) == records[0] | {"certificate": None, "certificate_hash": None}


def test_tables_for_people(coastarc, spec_file, tmp_path):
    _, printed, _ = coastarc("run", spec_file)
    # What it advises asks the same archive.
    assert f"`coastarc solutions list --data {tmp_path}`" in printed
    lines = coastarc("solutions", "list")[1].splitlines()
    assert lines[1].split()[:4] == ["id", "search", "k", "kg"]
    robust = [line.split() for line in lines if " s1-0 " in line]
    assert {k for _, _, k, *_ in robust} == {"1"}
    shown = coastarc("solutions", "show", robust[0][0])[1]
    assert "d at segment" in shown and ", mapped by " in shown
    # Solved and verified norms [km, km/s, kg] of each trajectory.
    assert re.search(r"reference +(\d\.\de[-+]\d\d +){6}\n realization 1 +(\d\.\de[-+]\d\d +){6}\n", shown)
    assert "done" in coastarc("status")[1] and "s1-0" in coastarc("status", "--campaign", 1)[1]
    assert json.loads(coastarc("status", "--json")[1])["campaigns"][0]["state"] == "done"


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("run", "nowhere.toml"), "spec: expected a readable .toml or .json file, got nowhere.toml"),
        (("run", "[red]x[/nonsense].toml"), "got [red]x[/nonsense].toml"),
        (("solutions", "list"), "archive: expected a file"),
        (("status",), "run a campaign first"),
    ],
)
def test_an_error_is_one_line_and_exit_code_2(coastarc, arguments, reason):
    code, _, printed = coastarc(*arguments)
    assert code == 2 and reason in printed and printed.count("\n") == 1


@pytest.mark.parametrize(
    ("folder", "reason"),
    [
        ("/dev/null", "archive /dev/null: expected an SQLite archive, got File exists; name another folder"),
        ("/proc/none", "archive /proc/none: expected an SQLite archive, got No such file or directory"),
        # Nobody can write there, whoever runs the tests.
        ("/proc/self", "data folder /proc/self: expected one to write in, got "),
    ],
)
def test_a_folder_without_room_for_an_archive_is_one_line_and_exit_code_2(
    coastarc, spec_file, folder, reason
):
    code, _, printed = coastarc("run", spec_file, data=folder)
    assert code == 2 and reason in printed and printed.count("\n") == 1


@pytest.mark.parametrize("content", [b"no database at all, but long enough for a header\n" * 99, b"SQLite f"])
def test_an_archive_that_is_none_is_one_line_and_exit_code_2(coastarc, spec_file, tmp_path, content):
    (tmp_path / "coastarc.db").write_bytes(content)
    for arguments in (("run", spec_file), ("status",), ("solutions", "list")):
        code, _, printed = coastarc(*arguments)
        assert code == 2 and printed.count("\n") == 1
        assert (
            f"archive {tmp_path}/coastarc.db: expected an SQLite archive, got file is not a data" in printed
        )
    assert (tmp_path / "coastarc.db").read_bytes() == content


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"target": {"kind": "spk", "path": "{spec}", "naif_id": -1}}, "spec.problem: target "),
        ({"departure": {"epoch": "1549-12-31T12:00:00"}}, "expected the departure at least 45 days inside"),
        (
            {"spacecraft": {"dry_mass_kg": 14999.0}, "departure": SPIRAL},
            "spec.problem: spiral: expected 9.0 days",
        ),
    ],
)
def test_a_problem_that_cannot_be_flown_is_refused_before_it_is_stored(
    coastarc, spec_file, tmp_path, fields, reason
):
    text = json.dumps(spec_fields(problem={"preset": "ppe-drm3"} | fields))
    (tmp_path / "impossible.json").write_text(text.replace("{spec}", str(spec_file)))
    code, _, printed = coastarc("run", tmp_path / "impossible.json")
    assert code == 2 and reason in printed and printed.count("\n") == 1
    assert not (tmp_path / "coastarc.db").exists()


def test_a_bind_to_the_world_is_refused(coastarc, spec_file):
    code, _, printed = coastarc("run", spec_file, "--host", "0.0.0.0")
    assert code == 2 and "host 0.0.0.0, an address that others reach: expected a token, got none" in printed


def test_an_unknown_solution_is_an_error(coastarc, spec_file):
    coastarc("run", spec_file)
    code, _, printed = coastarc("solutions", "show", "zzz")
    assert code == 2 and "solution zzz: expected one that exists" in printed


def test_two_coordinators_do_not_share_a_folder(coastarc, spec_file, tmp_path):
    with Coordinator(tmp_path):
        code, _, printed = coastarc("run", spec_file)
    assert code == 2 and "in use by process" in printed


def test_submitting_needs_a_coordinator(coastarc, spec_file, tmp_path):
    code, _, printed = coastarc("submit", spec_file, "--url", "http://127.0.0.1:9", data=None)
    assert code == 2 and "start one with `coastarc serve`" in printed
    with Coordinator(tmp_path / "data") as coordinator:
        code, printed, _ = coastarc("submit", spec_file, "--url", coordinator.url, data=None)
        assert code == 0 and "Campaign 1 (test) submitted" in printed
        assert coordinator.store.campaign(1).state == "active"


def test_doctor_finds_a_working_installation(coastarc):
    code, printed, _ = coastarc("doctor", "--port", 0, "--json")
    checks = {check["name"]: check["state"] for check in json.loads(printed)}
    assert code == 0 and set(checks) >= {
        "python",
        "kernels",
        "solver",
        "numba cache",
        "threads",
        "disk",
        "port",
    }
    assert checks["kernels"] == checks["solver"] == checks["threads"] == "ok"


def test_doctor_says_what_to_do_about_a_cache_that_cannot_be_written(coastarc, spec_file, monkeypatch):
    monkeypatch.setattr(jit, "COMPILED_FOLDER", spec_file / "below-a-file")
    code, printed, _ = coastarc("doctor", "--port", 0, "--json")
    (cache,) = [check for check in json.loads(printed) if check["name"] == "numba cache"]
    assert code == 1 and cache["state"] == "failed" and "set XDG_CACHE_HOME" in cache["advice"]


@pytest.mark.slow
def test_an_interrupted_run_stops_cleanly_and_goes_on_to_the_same_end(tmp_path, spec_file):
    with Store(tmp_path) as undisturbed:
        submitted(undisturbed)
        finish(undisturbed)
        expected = content(undisturbed)
    folder = tmp_path / "interrupted"
    folder.mkdir()
    process = start(folder, "run", spec_file, runner="run_until_stopped")
    wait_for(lambda: n_running(folder) > 0)
    process.send_signal(signal.SIGINT)
    printed, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130 and "every result is kept" in printed and "Traceback" not in printed
    process = start(folder, "run", spec_file)
    printed, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0 and "Resuming campaign 1" in printed
    with Store(folder, read_only=True) as store:
        assert content(store) == expected


@pytest.mark.slow
def test_a_killed_run_leaves_no_process_and_goes_on(tmp_path, spec_file):
    process = start(tmp_path, "run", spec_file, "--workers", "2", runner="run_until_stopped")
    wait_for(lambda: n_running(tmp_path) == 2)
    process.kill()
    # The children hold the other end of this pipe until they are gone too.
    process.communicate(timeout=PATIENCE_S)
    process = start(tmp_path, "run", spec_file)
    printed, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0 and "test: done" in printed


@pytest.mark.parametrize("workers", [0, 1])
def test_serve_without_workers_leaves_the_work_to_dispatchers_elsewhere(coastarc, monkeypatch, workers):
    begun = []

    def interrupt(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Coordinator, "work", lambda _, setup: begun.append(setup.n_workers))
    monkeypatch.setattr(Coordinator, "raise_fault", interrupt)
    assert coastarc("serve", "--port", 0, "--workers", workers)[0] == 0
    assert begun == [1] * workers


def test_serve_works_on_what_is_submitted_and_stops_with_a_reader_connected(tmp_path, spec_file):
    process = start(tmp_path, "serve", "--port", "0")
    url = re.search(r"http\S+", process.stdout.readline())[0]
    assert httpx.post(f"{url}/api/v1/campaigns", json=spec_fields()).status_code == 201
    wait_for(lambda: httpx.get(f"{url}/api/v1/campaigns/1").json()["state"] == "done")
    with httpx.stream("GET", f"{url}/api/v1/campaigns/1/events") as stream:
        next(stream.iter_lines())
        process.send_signal(signal.SIGTERM)
        # Long before the stream would end by itself.
        assert process.wait(timeout=PATIENCE_S) == 0
    process.stdout.close()


def test_coordinators_write_their_logs_as_lines_of_json(coastarc, spec_file, monkeypatch):
    levels = []
    monkeypatch.setattr(logs, "configure", lambda level=logging.INFO: levels.append(level))
    monkeypatch.setattr("service.cli.run.serve_until_interrupted", lambda *_: None)
    assert coastarc("serve", "--port", 0)[0] == 0 and coastarc("run", spec_file)[0] == 0
    assert levels == [logging.INFO, "WARNING"]


def test_a_specification_that_is_submitted_as_plain_data_is_the_same_campaign():
    spec = spec_from(spec_fields())
    assert spec_from(spec.as_fields()).hash == spec.hash
