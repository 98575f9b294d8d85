"""The open benchmark: what is shipped holds, tampering is found, what comes from elsewhere is judged."""

import json
import re
import shutil
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from core.plain_data import content_hash
from core.problem import load_problem
from service import cli
from service.cli.options import console
from service.problem_set import (
    FOLDER,
    BenchmarkError,
    jumps,
    read_certificate,
    read_set,
    read_vector,
    sha256,
    write_set,
)
from service.store.completion import solution_hash
from workers.measure_solves import Solution

README = (FOLDER.parent / "README.md").read_text(encoding="utf-8")


@pytest.fixture
def coastarc(monkeypatch, capsys):
    """Return a function that runs `coastarc benchmark` in this process: (exit code, stdout, stderr)."""

    def call(*words):
        monkeypatch.setattr(console, "_width", 200)
        monkeypatch.setattr(sys, "argv", ["coastarc", "benchmark", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return call


@pytest.fixture
def copied(tmp_path):
    """A copy of the set to tamper with."""
    return shutil.copytree(FOLDER, tmp_path / "set")


def rewrite(folder, name, change, is_declared=True):
    """Change the text of a file, and by default the digest in the table of contents with it."""
    path, contents = folder / name, folder / "set.toml"
    before = sha256(path)
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")
    assert sha256(path) != before
    if is_declared:
        contents.write_text(
            contents.read_text(encoding="utf-8").replace(before, sha256(path)), encoding="utf-8"
        )


def failed(coastarc, folder):
    code, printed, _ = coastarc("check", folder, "--case", "k0", "--json")
    names = {entry["name"] for entry in json.loads(printed) if entry["state"] == "failed"}
    assert code == (1 if names else 0)
    return names


def test_a_case_that_is_shipped_holds(coastarc):
    # One of them: a command that flies all four takes a minute.
    code, printed, _ = coastarc("check", "--case", "k1", "--json")
    checks = json.loads(printed)
    assert code == 0, [entry for entry in checks if entry["state"] == "failed"]
    assert {"constants", "target.bsp", "k1 flight", "k1 states"} <= {entry["name"] for entry in checks}


@pytest.mark.parametrize("k", [0, 1, 3, 12])
def test_the_files_of_a_case_are_those_of_the_table_and_of_each_other(k):
    case = read_set(FOLDER).case(f"k{k}")
    problem = case.problem()
    assert {name: sha256(case.folder / name) for name in case.files} == case.files and len(case.files) == 4
    assert problem.k == k and problem.hash == case.problem_hash
    x = read_vector(case.folder / "vector.csv", problem)
    assert solution_hash(problem.hash, x) == case.solution
    certificate = read_certificate(case.folder / "certificate.json")
    assert certificate.level == "strict" and certificate.is_sound and certificate.solution_id == case.solution
    masses = [flown.mass.stated_arrival for flown in certificate.trajectories]
    assert len(masses) == 1 + k and masses[0] == x[153]


def test_the_cases_are_nested_and_more_outages_never_cost_less():
    found = [read_set(FOLDER).case(f"k{k}") for k in (0, 1, 3, 12)]
    problems = [case.problem() for case in found]
    assert [problem.k for problem in problems] == [0, 1, 3, 12]
    for smaller, larger in pairwise(problems):
        assert set(smaller.outages) < set(larger.outages)
        assert smaller.family == larger.family
    propellant = [case.propellant_kg for case in found]
    assert propellant == sorted(propellant)


def test_only_the_target_of_the_set_differs_from_the_preset():
    ours, preset = read_set(FOLDER).case("k0").problem(), load_problem("ppe-drm3")
    assert ours.model_copy(update={"target": preset.target}) == preset


def test_the_table_of_the_readme_is_that_of_the_set():
    rows = re.findall(r"^\| (k\d+) \| ([\d-]+|none) \| (\d+) \| ([\d.]+) \|", README, re.MULTILINE)
    cases = read_set(FOLDER).cases
    assert [row[0] for row in rows] == [case.name for case in cases]
    for (_, segments, n_variables, propellant), case in zip(rows, cases, strict=True):
        problem = case.problem()
        assert segments == ("-".join(str(outage.segment) for outage in problem.outages) or "none")
        assert int(n_variables) == len(read_vector(case.folder / "vector.csv", problem))
        assert float(propellant) == round(case.propellant_kg, 3)


def test_show_lists_what_is_written(coastarc):
    code, printed, _ = coastarc("show")
    assert code == 0 and all(case.solution[:8] in printed for case in read_set(FOLDER).cases)
    code, printed, _ = coastarc("show", "--json")
    assert [case["name"] for case in json.loads(printed)["cases"]] == ["k0", "k1", "k3", "k12"]


def test_a_vector_that_no_longer_flies_is_found_by_flying_it(coastarc, copied):
    throttle = re.compile(r"^(3,reference,throttle,1,-,)([^,]+)", re.MULTILINE)

    def nudged(found):
        value = float(found[2])
        return f"{found[1]}{value - 0.01 if value > 0.5 else value + 0.01}"

    rewrite(copied, "k0/vector.csv", lambda text: throttle.sub(nudged, text, count=1))
    assert failed(coastarc, copied) == {"k0 solution", "k0 flight", "k0 certificate"}


def test_each_file_that_contradicts_the_flight_is_found_by_itself(coastarc, copied):
    def heavier(text):
        content = json.loads(text)["content"]
        content["trajectories"][0]["mass"]["stated_arrival"] += 1e-3
        return json.dumps({"content": content, "hash": content_hash(content)})

    def moved(text):
        lines = text.splitlines()
        cells = lines[6].split(",")
        cells[7] = str(float(cells[7]) + 2.0)
        return "\n".join([*lines[:6], ",".join(cells), *lines[7:]]) + "\n"

    rewrite(copied, "k0/certificate.json", heavier)
    rewrite(copied, "k0/states.csv", moved, is_declared=False)
    assert failed(coastarc, copied) == {"k0 certificate", "k0 states", "k0 files"}


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [("mass_kg", "0.0", "no mass left"), ("days_past_departure", "-1e9", "SPKINSUFFDATA")],
)
def test_states_that_cannot_be_flown_are_refused_by_the_name_of_their_file(copied, column, value, said):
    case = read_set(copied).case("k0")
    path = case.folder / "states.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    head = next(number for number, line in enumerate(lines) if not line.startswith("#"))
    cells = lines[head + 1].split(",")
    cells[lines[head].split(",").index(column)] = value
    lines[head + 1] = ",".join(cells)
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(BenchmarkError, match=rf"states.csv: expected arcs .*{said}"):
        jumps(path, case.problem())


def test_a_certificate_with_another_hash_or_form_is_refused(copied):
    path = copied / "k0" / "certificate.json"
    text = path.read_text(encoding="utf-8")
    for changed, said in (
        (text.replace('"strict"', '"paper"', 1), "expected the hash of its content"),
        (text.replace('"k": 0', '"k": "none"', 1), "k: expected an integer"),
        ("[]", "expected"),
    ):
        assert changed != text
        path.write_text(changed, encoding="utf-8")
        with pytest.raises(BenchmarkError, match=said):
            read_certificate(path)


def test_other_constants_and_another_target_are_found(coastarc, copied):
    rewrite(copied, "set.toml", lambda text: text.replace("9.806\n", "9.80665\n"), is_declared=False)
    with (copied / "target.bsp").open("ab") as kernel:
        kernel.write(b"more")
    assert failed(coastarc, copied) == {"constants", "target.bsp"}


def test_the_best_known_solution_is_as_good_as_itself(coastarc):
    code, printed, _ = coastarc("judge", "k0", FOLDER / "k0" / "vector.csv", "--json")
    judged = json.loads(printed)
    assert code == 0 and judged["is_strict"] and abs(judged["excess_kg"]) < 1e-6
    assert judged["solution"] == read_set(FOLDER).case("k0").solution


def test_a_solution_that_does_not_arrive_is_judged_not_strict(coastarc, tmp_path):
    text = (FOLDER / "k0" / "vector.csv").read_text(encoding="utf-8")
    mass = re.search(r"^\d+,reference,final_mass,,kg,([^,]+)", text, re.MULTILINE)[1]
    (tmp_path / "better.csv").write_text(text.replace(mass, str(float(mass) + 1.0)), encoding="utf-8")
    code, printed, _ = coastarc("judge", "k0", tmp_path / "better.csv")
    assert code == 1 and printed.startswith("Not strict") and "-1.000 kg compared with the set's" in printed


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.rpartition("\n153,")[0] + "\n", "expected 154 entries for P_0, got 153"),
        (
            lambda text: text.replace("shooting_time", "final_coast", 1),
            "expected entry 0 to be reference",
        ),
        (lambda text: re.sub(r"(?m)^(0,.*?,d),[^,]+", r"\1,soon", text, count=1), "got soon"),
        (lambda text: "\0" + text, "expected"),
    ],
)
def test_a_file_that_is_no_vector_of_the_case_is_refused_in_one_line(coastarc, tmp_path, change, said):
    text = (FOLDER / "k0" / "vector.csv").read_text(encoding="utf-8")
    (tmp_path / "odd.csv").write_text(change(text), encoding="utf-8")
    code, _, complaint = coastarc("judge", "k0", tmp_path / "odd.csv")
    assert code == 2 and said in complaint and complaint.count("\n") == 1


def test_what_is_not_there_is_said_in_one_line(coastarc, tmp_path):
    for words, said in (
        (("check", tmp_path), "expected a folder with set.toml"),
        (("show", tmp_path / "none"), "expected a folder with set.toml"),
        (("judge", "k2", FOLDER / "k0" / "vector.csv"), "expected one of k0, k1, k3, k12, got k2"),
        (("judge", "k0", tmp_path / "none.csv"), "expected a file to read"),
        (("write", tmp_path / "new", tmp_path / "none.json"), "expected a file that can be read"),
    ):
        code, _, complaint = coastarc(*words)
        assert code == 2 and said in complaint and complaint.count("\n") == 1, complaint


def test_the_same_solution_gives_the_same_files(tmp_path):
    case = read_set(FOLDER).case("k0")
    problem = case.problem()
    x = read_vector(case.folder / "vector.csv", problem)
    solution = Solution(0, problem, tuple(x.tolist()), case.propellant_kg, True)
    first, second = (write_set(tmp_path / name, [solution], "2026-11-25") for name in ("first", "second"))
    assert first.cases[0].files == second.cases[0].files
    # A certificate names the code that made it; everything else is as shipped.
    for file in ("problem.toml", "vector.csv"):
        assert first.cases[0].files[file] == case.files[file]
    assert np.array_equal(read_vector(tmp_path / "first" / "k0" / "vector.csv", problem), x)
    with pytest.raises(BenchmarkError, match="expected an empty folder"):
        write_set(tmp_path / "first", [solution], "2026-11-25")


def test_a_solution_that_is_not_strict_is_not_written(tmp_path):
    case = read_set(FOLDER).case("k0")
    problem = case.problem()
    x = read_vector(case.folder / "vector.csv", problem)
    x[-1] += 0.1
    with pytest.raises(BenchmarkError, match="expected strict ones, got one of P_0"):
        write_set(Path(tmp_path), [Solution(0, problem, tuple(x.tolist()), 0.0, True)], "2026-11-25")
