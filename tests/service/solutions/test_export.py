"""Solutions as files, from the command line and over HTTP."""

import io
import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import spiceypy
import typer.main
from oem import OrbitEphemerisMessage

from core.problem import ProblemError, load_problem, problem_from
from core.transcription import transcribe
from service import cli
from service.cli.options import console
from service.schemas.solution import Filter
from service.solutions.export import ExportFormat, Wanted, export_solution
from tests.core.test_world import on_circles, random_point

API = "/api/v1"
ROOT = Path(__file__).parents[3]
DOCS = (ROOT / "docs" / "exports.md").read_text(encoding="utf-8")


@pytest.fixture
def robust(archive):
    return archive.all_records(Filter(search="s1-0"))[0]


@pytest.fixture
def coastarc(archive, tmp_path, monkeypatch, capsys):
    """Return a function that runs a command in an empty folder: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(console, "_width", 200)

    def call(*arguments):
        words = [str(word) for word in arguments]
        monkeypatch.setattr(sys, "argv", ["coastarc", *words, "--data", str(archive.folder)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return call


def comment_of(path):
    handle = spiceypy.dafopr(str(path))
    _, lines, _ = spiceypy.dafec(handle, 100, 300)
    spiceypy.dafcls(handle)
    return [line.rstrip() for line in lines]


def test_a_file_says_which_kernel_had_the_bodies_of_a_world_of_its_own(robust, tmp_path):
    problem = problem_from(on_circles(tmp_path) | {"outages": [{"segment": 4, "duration_days": 1.0}]})
    record = robust.model_copy(update={"x": random_point(transcribe(problem), 5).tolist()})
    wanted = Wanted(ExportFormat.CSV, "reference")
    made = export_solution(record, problem.model_dump(mode="json"), wanted, "2026-01-01")
    assert (
        f"bodies where a kernel with BLAKE2b digest {problem.world.digest} has them"
        in next(made.content).decode()
    )


def test_a_kernel_names_its_bodies_and_says_where_it_comes_from(coastarc, robust, tmp_path):
    code, printed, _ = coastarc("solutions", "export", robust.id[:10], "--format", "spk", "--body-id", -7000)
    path = tmp_path / f"coastarc-{robust.id[:8]}-all.bsp"
    assert code == 0 and f"File: {path.name}" in printed and "-7001  realization 1" in printed
    assert sorted(spiceypy.spkobj(str(path))) == [-7001, -7000]
    lines = comment_of(path)
    assert robust.id in lines[0] and robust.problem_hash in lines[1]
    assert "body -7001: realization 1, outage of 1.0 days at segment 24" in lines


def test_json_tells_what_was_written(coastarc, robust):
    arguments = ("solutions", "export", robust.id, "--format", "csv", "--trajectory", "1", "--json")
    told = json.loads(coastarc(*arguments)[1])
    assert told["file"] == f"coastarc-{robust.id[:8]}-realization-1.csv"
    assert told["bytes"] == Path(told["file"]).stat().st_size
    (body,) = told["trajectories"]
    assert (body["trajectory"], body["body_id"]) == ("realization 1", -60101)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (
            ("--format", "csv", "--trajectory", "2"),
            "expected all, reference or a realization, 1 to 1",
        ),
        (
            ("--format", "csv", "-o", "no/where.csv"),
            "file no/where.csv: expected a folder to write to",
        ),
    ],
)
def test_what_cannot_be_exported_is_one_line_and_exit_code_2(coastarc, robust, arguments, reason):
    code, _, complaint = coastarc("solutions", "export", robust.id, *arguments)
    assert code == 2 and reason in complaint and len(complaint.splitlines()) == 1


def test_a_file_that_exists_is_not_replaced(coastarc, robust, tmp_path):
    (tmp_path / "mine.csv").write_text("mine")
    code, _, complaint = coastarc("solutions", "export", robust.id, "--format", "csv", "-o", "mine.csv")
    assert code == 2 and "expected a new file, got one that exists" in complaint
    assert [entry.name for entry in tmp_path.iterdir()] == ["mine.csv"]
    assert (tmp_path / "mine.csv").read_text() == "mine"


def test_messages_of_all_trajectories_come_zipped_and_one_comes_plain(asked, robust, tmp_path):
    export = f"{API}/solutions/{robust.id}/export"
    answer = asked.get(export, params={"format": "oem"})
    assert answer.headers["content-type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(answer.content)) as packed:
        names = [f"coastarc-{robust.id[:8]}-{which}.oem" for which in ("reference", "realization-1")]
        assert packed.namelist() == names
        packed.extractall(tmp_path)
    one = asked.get(export, params={"format": "oem", "trajectory": "1"})
    assert one.headers["content-type"] == "text/plain; charset=utf-8"
    assert f'filename="{names[1]}"' in one.headers["content-disposition"]
    read = OrbitEphemerisMessage.open(tmp_path / names[1])
    assert read.segments[0].metadata["OBJECT_NAME"] == f"coastarc {robust.id[:8]} realization 1"
    date = re.compile("CREATION_DATE = .*")
    assert date.sub("", one.text) == date.sub("", (tmp_path / names[1]).read_text())


def test_http_and_the_command_line_give_the_same_kernel(asked, coastarc, robust):
    answer = asked.get(f"{API}/solutions/{robust.id}/export", params={"format": "spk"})
    assert answer.headers["content-type"] == "application/octet-stream"
    coastarc("solutions", "export", robust.id, "--format", "spk", "-o", "same.bsp")
    assert answer.content == Path("same.bsp").read_bytes()


def test_ndjson_has_one_object_a_line(asked, robust):
    answer = asked.get(f"{API}/solutions/{robust.id}/export", params={"format": "ndjson", "trajectory": "1"})
    assert answer.headers["content-type"] == "application/x-ndjson"
    rows = [json.loads(line) for line in answer.text.splitlines()]
    assert {row["trajectory"] for row in rows} == {"realization 1"}
    assert rows[-1]["epoch_tdb"][:19] == archive_epoch(robust)


def archive_epoch(record):
    """Return the arrival of the one realization, as the certificate tells it."""
    return record.verification["arrival_epochs"][1][:19]


@pytest.mark.parametrize("params", [{"trajectory": "2"}, {"format": "spk", "what": "vector"}])
def test_what_does_not_exist_is_refused_over_http(asked, robust, params):
    answer = asked.get(f"{API}/solutions/{robust.id}/export", params=params)
    assert answer.status_code == 422 and "expected" in answer.json()["detail"]


def test_the_python_example_of_the_documents_reads_a_kernel(coastarc, robust, tmp_path):
    (block,) = re.findall(r"```python\n(.*?)```", DOCS, re.DOTALL)
    coastarc("solutions", "export", robust.id, "--format", "spk", "-o", "solution.bsp")
    (tmp_path / "example.py").write_text(block)
    ran = subprocess.run(
        [sys.executable, "example.py"], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert ran.returncode == 0, ran.stderr
    state = [float(word) for word in ran.stdout.strip(" []\n").split()]
    # Half way it is on its way out, beyond the Moon: weak stability transfers go to 1.5 million kilometres.
    assert len(state) == 6 and 1e4 < sum(value**2 for value in state[:3]) ** 0.5 < 2e6


def commands_of(text):
    """Return the command lines in the code blocks of a page."""
    return [line.split() for line in re.findall(r"^    (coastarc .*)$", text, re.MULTILINE)]


@pytest.mark.parametrize("words", commands_of(DOCS), ids=" ".join)
def test_a_command_of_the_documents_is_one_of_the_program(words):
    command, arguments = typer.main.get_command(cli.app_of()), words[1:]
    while getattr(command, "commands", None):
        command, arguments = command.commands[arguments[0]], arguments[1:]
    # Raises where an option, its value or an argument is not what the command takes.
    command.make_context(" ".join(words), arguments)


def test_the_toml_of_the_documents_is_a_problem(tmp_path):
    (block,) = re.findall(r"```toml\n(.*?)```", DOCS, re.DOTALL)
    (tmp_path / "problem.toml").write_text(block)
    with pytest.raises(ProblemError, match=r"problem\.target: expected an SPK file, got .*station\.bsp"):
        load_problem(tmp_path / "problem.toml")
    (tmp_path / "station.bsp").write_bytes(b"orbit")
    assert load_problem(tmp_path / "problem.toml").target.naif_id == -60000
