"""The command line as a whole: what its help says without importing the commands, and its version."""

import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
import typer

from service.cli import app_of
from service.cli.command import COMMANDS

ARCHIVE = Path(__file__).parents[1] / "data" / "archive-7.sqlite"
REAL = typer.main.get_command(app_of()).commands
NAMED = typer.main.get_command(app_of(())).commands


def coastarc(*words):
    """Run a command in a process of its own; return its exit code and what it printed."""
    program = f"import sys; from service.cli import main; sys.argv = {['coastarc', *words]}; main()"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    return ran.returncode, ran.stdout + ran.stderr


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_all_says_of_a_command_what_its_own_help_begins_with(name):
    assert NAMED[name].help == REAL[name].help.partition("\n\n")[0].replace("\n", " ")


def test_the_help_of_all_needs_no_numerics_and_no_server():
    program = (
        "import sys\nfrom service.cli import main\nsys.argv = ['coastarc', '--help']\n"
        "try:\n    main()\nexcept SystemExit:\n"
        "    print([name for name in ('numpy', 'pydantic', 'sqlalchemy', 'fastapi') if name in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert all(name in ran.stdout for name in COMMANDS)
    assert ran.stdout.splitlines()[-1] == "[]"


def test_the_version_is_that_of_the_package():
    code, printed = coastarc("--version")
    assert code == 0 and printed.startswith(f"coastarc {version('coastarc')}")


def test_a_word_that_is_nearly_a_command_is_asked_about():
    code, printed = coastarc("statsu")
    assert code == 2 and "did you mean 'status'" in printed


LISTS = ["status", "status --campaign 1", "solutions list", "solutions show e1ac2535", "token list"]


@pytest.mark.parametrize("words", LISTS)
def test_lists_of_an_archive_need_no_numerics_and_no_server(words, tmp_path):
    shutil.copy(ARCHIVE, tmp_path / "coastarc.db")
    typed = ["coastarc", *words.split(), "--data", str(tmp_path)]
    heavy = ("numpy", "scipy", "numba", "spiceypy", "alembic", "fastapi", "httpx")
    program = (
        f"import sys; from service.cli import main; sys.argv = {typed}\n"
        "try: main()\n"
        "except SystemExit as end: assert not end.code\n"
        f"print([name for name in {heavy} if name in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ran.stdout.splitlines()[-1] == "[]", ran.stderr
