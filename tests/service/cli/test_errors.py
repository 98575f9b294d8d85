"""What users get wrong at the command line: one clear line, exit code 2, no traceback."""

import re
import sys
from pathlib import Path

import pytest

from service import cli
from service.store.store import Store
from tests.service.campaigns import submitted

QUICK = (Path(__file__).parents[3] / "examples" / "quick.toml").read_text(encoding="utf-8")
NOWHERE = "http://127.0.0.1:9"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with an archive in `data`, and with files that are not what they should be."""
    folder = tmp_path_factory.mktemp("wrong")
    (folder / "data").mkdir()
    with Store(folder / "data") as store:
        submitted(store)
    texts = {
        "broken.toml": "[campaign\n",
        "quick.toml": QUICK,
        "misspelt.toml": QUICK.replace("guesses =", "guesess ="),
        "preset.toml": QUICK.replace("ppe-drm3", "ppe-drm4"),
        "segment.toml": QUICK.replace("segment = 24", "segment = 77"),
        "target.toml": QUICK.replace(
            "[[search]]", '[problem.target]\nkind = "spk"\npath = "moon.bsp"\nnaif_id = -5\n\n[[search]]', 1
        ),
        "no-kernel/target.toml": QUICK.replace(
            "[[search]]", '[problem.target]\nkind = "spk"\npath = "x.bsp"\nnaif_id = -5\n\n[[search]]', 1
        ),
        "no-kernel/x.bsp": "no kernel",
        "damaged/coastarc.db": "no database " * 100,
        "file": "x",
    }
    for name, text in texts.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "bytes.toml").write_bytes(bytes(range(128, 200)))
    return folder


def said(arguments, folder, monkeypatch, capsys):
    """Run a command in the folder; return its exit code and what it printed as errors."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", ["coastarc", *arguments.split()])
    with pytest.raises(SystemExit) as end:
        cli.main()
    return end.value.code, capsys.readouterr().err


#: A command, and what its one line must say: what was expected, what came, and what to do.
MISTAKES = {
    "run missing.toml": r"spec: expected a readable .*, got missing.toml: No such file or directory",
    "run data": r"spec: expected a readable .toml or .json file, got data: Is a directory",
    "run broken.toml": r"spec: .* got broken.toml: .*at line 1, column",
    "run bytes.toml": r"spec: .* got bytes.toml: .*UTF-8",
    "run misspelt.toml": r"spec.search.0.guesess: expected one of id, .*, got unknown key 'guesess'",
    "run preset.toml": r"spec.problem.preset: expected one of earth-mars, ppe-drm3, got 'ppe-drm4'",
    "run segment.toml": r"spec: search s1-0: .* expected a segment in 1..49 .*, got 77",
    "run target.toml": r"spec.problem.target: expected an SPK file, got \S+/moon.bsp, which is not a file",
    "run no-kernel/target.toml": r"spec.problem: target \S+/no-kernel/x.bsp: expected an SPK kernel",
    "run quick.toml --data file": r"archive file: expected an SQLite archive, .*; name another .* --data",
    "run quick.toml --workers 0": r"--workers: expected greater .* 1; see `coastarc run --help`",
    "run quick.toml --workers two": r"--workers: expected a valid integer; see `coastarc run --help`",
    "run quick.toml --data made --host 999.1.1.1": r"host 999.1.1.1: expected an address .*; use --host",
    "run quick.toml --data made --host 0.0.0.0": r"host 0.0.0.0, .* got none; create one with `coastarc",
    f"submit quick.toml --url {NOWHERE}": r"coordinator: .* refused; start one with `coastarc serve`",
    "submit quick.toml --url ftp://x": r"url: expected one as http://host:8741, got ftp://x",
    "status --data missing": r"archive: .* got missing/coastarc.db, .*; run a campaign first, or",
    "status --data damaged": r"archive damaged/coastarc.db: .* not a database; name another folder",
    "status --data data --campaign nobody": r"campaign nobody: .* this name or id; see `coastarc status`",
    "report nobody --data data": r"campaign nobody: .* got none with this name or id",
    "report 1 --data data --out file": r"report file: expected a folder to write in, .*; name another",
    "solutions list --data data --campaign nobody": r"campaign nobody: expected one that exists",
    "solutions list --data data --sort size": r"--sort: expected one of 'objective_kg', .*, got 'size'; see",
    "solutions list --data data --k -1": r"--k: expected greater than or equal to 0; see `",
    "solutions list --data data --limit 99999999999999999999": r"--limit: expected less .* 1000000000; see `",
    "solutions show zz --data data": r"solution zz: expected .*, got none .*; see `coastarc solutions list`",
    "solutions show": r"solution: expected a value, got none; see `coastarc solutions show --help`",
    "solutions nonsense": r"command: .* exists, got 'nonsense'; see `coastarc solutions --help`",
    "seeds --data data": r"seeds: expected --campaign and --search, or --problem .*, got another mixture",
    "share 1": r"share: expected --weight, --priority or both, got neither",
    "share 1 --priority 1000001": r"--priority: expected less .* 1000000; see `coastarc share --help`",
    "db check --data missing": r"archive: expected a file, got missing/coastarc.db",
    "db backup file --data data": r"backup file: expected a new file, got one that exists; name another",
    "db restore file --data made2": r"backup file: expected schema version \d+ or less, got none",
    "token create ada --data file": r"archive file: expected an SQLite archive, got File exists; name",
    "token create ada --role king --data made": r"--role: expected one of 'viewer', .*, got 'king'; see `",
    f"token list --url {NOWHERE}": rf"coordinator: expected one at {NOWHERE}, got .*refused",
    "dispatch": r"--url: expected a value, got none; see `coastarc dispatch --help`",
    f"dispatch --url {NOWHERE} --token-file none": r"--token-file: expected a file with a token, got none",
    f"dispatch --url {NOWHERE} --campaign {2**63}": r"--campaign: expected less .*; see `coastarc dispatch",
    f"dispatch --url {NOWHERE} --executor thread": r"--executor: expected one of .*, got 'thread'; see `",
    "bench solve missing.toml": r"problem: expected a preset .*, got missing.toml: No such file or directory",
    "bench chain --mapping sideways": r"mapping: expected one of reference, .*, got 'sideways'",
    "bench evaluate --wrong": r"option: expected one that exists, got --wrong",
    "solution list": r"command: expected one that exists, got 'solution'; did you mean 'solutions'; see `",
    "seeds --data data --campaign 1 --search s9": r"search s9 of campaign 1: .* got none of this name",
    "campaigns import none.zip --data made3": r"file none.zip: .* campaign, got No such file or directory$",
    "campaigns export 1 --data data -o no/x": r"file no/x: .* got No such file .*; name another with --out",
    f"solutions reproduce 12 --url {NOWHERE}": r"solution 12: expected all 32 digits .* with --url, got 2; ",
    "example motivating --out file": r"folder file: expected one to write in, got File exists; name another",
    "nonsense": r"command: expected one that exists, got 'nonsense'; see `coastarc --help`",
    "doctor extra": r"arguments: expected no more, got extra; see `coastarc doctor --help`",
}


@pytest.mark.parametrize("command", MISTAKES)
def test_a_mistake_is_answered_by_one_line_and_exit_code_2(command, folder, monkeypatch, capsys):
    code, text = said(command, folder, monkeypatch, capsys)
    assert code == 2 and re.match(f"error: {MISTAKES[command]}", text), text
    assert len(text.splitlines()) == 1


def test_every_fault_of_a_specification_has_a_line_of_its_own(folder, monkeypatch, capsys):
    (folder / "empty.toml").write_text("")
    code, text = said("run empty.toml", folder, monkeypatch, capsys)
    assert code == 2 and len(text.splitlines()) == 3 and "spec.campaign: expected" in text


def test_a_list_that_is_empty_says_so(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", ["coastarc", "solutions", "list", "--data", "data"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert not end.value.code and "No solution in this archive matches." in capsys.readouterr().out


def test_the_help_begins_with_what_a_newcomer_needs(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["coastarc", "--help"])
    with pytest.raises(SystemExit):
        cli.main()
    lines = re.findall(r"^[│ ]+([a-z]+)  ", capsys.readouterr().out, re.MULTILINE)
    assert lines[:3] == ["run", "serve", "submit"] and lines[-4:] == ["bench", "db", "token", "doctor"]


def commands(command, path=()):
    """Return every command of the command line with its path."""
    yield path, command
    for name, below in getattr(command, "commands", {}).items():
        yield from commands(below, (*path, name))


def test_every_command_and_every_option_says_in_a_sentence_what_it_does():
    import typer

    for path, command in commands(typer.main.get_command(cli.app_of())):
        assert command.help and re.match(r"[A-Z].*[.)]$", command.help.strip(), re.DOTALL), path
        for parameter in command.params:
            words = getattr(parameter, "help", None) or ""
            is_hidden = getattr(parameter, "hidden", False)
            assert is_hidden or re.match(r"[A-Z].*[.]$", words), (path, parameter.name)


def test_a_flag_shows_no_type_since_it_takes_no_value():
    import typer

    flags = [
        (path, parameter.name, parameter.metavar)
        for path, command in commands(typer.main.get_command(cli.app_of()))
        for parameter in command.params
        if getattr(parameter, "is_flag", False)
    ]
    assert len(flags) > 20 and {metavar for _, _, metavar in flags} == {""}, flags


def test_the_version_is_asked_for_as_everywhere(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["coastarc", "--version"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert not end.value.code and re.fullmatch(
        r"coastarc \d+\.\d+\.\d+\+[0-9a-f]{12}\n", capsys.readouterr().out
    )


def test_tokens_are_asked_of_the_coordinator_of_the_environment_too(folder, monkeypatch, capsys):
    monkeypatch.setenv("COASTARC_URL", NOWHERE)
    code, text = said("token list", folder, monkeypatch, capsys)
    assert code == 2 and text.startswith(f"error: coordinator: expected one at {NOWHERE}")
