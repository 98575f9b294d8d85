"""Every command in the pages: all must parse, the cheap ones run on an archive of known solutions.

What needs root, a cluster, a coordinator or hours is only parsed, against the real command line.
"""

import re
import sys
import tomllib

import pytest
import typer

from service import cli
from service.spec import load_spec
from service.store.filters import filter_of
from service.store.store import Store
from tests.acceptance import known
from tests.pages import PAGES, ROOT, blocks_of, commands_of, inline_commands_of, name_of, text_of

every_page = pytest.mark.parametrize("page", PAGES, ids=name_of)
#: What is run, whatever page it stands on.
CHEAP = ("solutions list", "solutions show", "status", "report", "db check", "db backup", "token", "doctor")
#: Options whose value the test chooses.
PLACES = {"--data": None, "--out": None}


def command_line():
    """Return the real command line, of which no command does anything."""
    root = typer.main.get_command(cli.app_of())
    pending = [root]
    while pending:
        command = pending.pop()
        command.callback = None if hasattr(command, "commands") else lambda **_: None
        pending.extend(getattr(command, "commands", {}).values())
    return root


def command_named(words):
    """Return the command that the first words name, and how many they are."""
    command, n = typer.main.get_command(cli.app_of()), 0
    while n < len(words) and words[n] in getattr(command, "commands", {}):
        command, n = command.commands[words[n]], n + 1
    return command, n


@every_page
def test_commands_in_blocks_parse(page):
    for words in commands_of(page):
        command_line().main(args=words, standalone_mode=False)


@every_page
def test_commands_in_sentences_and_their_options_exist(page):
    for words in inline_commands_of(page):
        if words[0].startswith(("...", "-")):
            continue
        command, n = command_named(words)
        assert n > 0 and not (n == len(words) and len(words) > 3), words
        options = {name for parameter in command.params for name in parameter.opts}
        named = set(re.findall(r"(?<![\w-])--[a-z-]+", " ".join(words)))
        assert named <= options | {"--help"}, words


@every_page
def test_targets_of_make_in_a_page_exist(page):
    targets = set(re.findall(r"^(\w+):", text_of(ROOT / "Makefile"), re.MULTILINE))
    found = re.findall(r"(?:^|`)make ([a-z]\w*)(?=[ `\n])", text_of(page), re.MULTILINE)
    assert set(found) <= targets


def test_commands_are_found_where_pages_write_them():
    deploy = commands_of(ROOT / "docs" / "deploy.md")
    assert ["serve", "--workers", "8"] in deploy
    assert ["dispatch", "--executor", "ray", "--address", "10.0.0.5:6379"] in [c[:5] for c in deploy]
    assert sum(len(commands_of(page)) for page in PAGES) > 50


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """A data folder with a finished campaign, whose solutions are real ones of the preset."""
    folder = tmp_path_factory.mktemp("archive")
    with Store(folder) as store:
        known.submitted(store)
        work = known.dispatcher(store)
        while any(item.state != "done" for item in store.campaigns()):
            work.step()
    return folder


def cheap_commands():
    """Return the commands of all pages that are run, as they are run here, each once."""
    found = {}
    for page in PAGES:
        for words in commands_of(page):
            if " ".join(words).startswith(CHEAP) and "--url" not in words and words[1:2] != ["revoke"]:
                found[" ".join(as_here(words))] = None
    return list(found)


def as_here(words):
    """Return a command of a page with the campaign and the place of this test in it."""
    here, words = [], list(words)
    while words:
        word = words.pop(0)
        if word in PLACES:
            words.pop(0)
            here += [word, PLACES[word]] if PLACES[word] else []
        elif re.fullmatch(r"[0-9a-f]{8}", word):
            here.append("ID")
        else:
            here.append(re.sub(r"^/.*/", "", word))
    if here[0] == "report" or here[:2] == ["status", "--campaign"]:
        place = next(place for place, word in enumerate(here[1:], 1) if not word.startswith("--"))
        here[place] = "1"
    return here


@pytest.mark.parametrize("command", cheap_commands())
def test_a_cheap_command_runs(command, archive, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COASTARC_DATA", str(archive))
    with Store(archive, read_only=True) as store:
        solution = store.all_records(filter_of(), 1)[0].id[:8]
    monkeypatch.setattr(sys, "argv", ["coastarc", *command.replace("ID", solution).split()])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert not end.value.code, capsys.readouterr().err
    assert capsys.readouterr().out


@every_page
def test_specifications_in_a_page_can_be_submitted(page, tmp_path):
    for text in blocks_of(page, "toml"):
        fields = tomllib.loads(text)
        if {"campaign", "problem", "search"} <= set(fields):
            (tmp_path / "spec.toml").write_text(text, encoding="utf-8")
            assert load_spec(tmp_path / "spec.toml").campaign.name == fields["campaign"]["name"]


@every_page
def test_python_in_a_page_is_python(page):
    for text in blocks_of(page, "python"):
        compile(text, name_of(page), "exec")


def test_the_example_of_sizes_prints_what_it_says(capsys):
    (block,) = [code for code in blocks_of(ROOT / "docs" / "python.md", "python") if "n_variables" in code]
    exec(compile(block, "python.md", "exec"), {})
    said = re.search(r"n_defects\)  # (.+)", block).group(1)
    # 3 N + 4 of the reference and of realizations with 38 and 26 segments; seven defects for each.
    assert capsys.readouterr().out.splitlines()[0] == said == f"{154 + 118 + 82} {3 * 7}"
