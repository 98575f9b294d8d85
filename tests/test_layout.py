"""Where the three names come from, what may import what, and files that must be there."""

import importlib
import re
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NAMES = ("core", "workers", "service")


@pytest.mark.parametrize("name", NAMES)
def test_the_three_names_come_from_this_project(name):
    # Whatever comes earlier on the path wins: a test folder named core would, without its __init__.py.
    origin = Path(importlib.import_module(name).__file__).resolve()
    assert origin == (ROOT / name / "__init__.py").resolve()


def test_a_process_started_elsewhere_finds_the_installed_names(tmp_path):
    code = "import core, workers, service; print(core.__file__, workers.__file__, service.__file__)"
    command = [sys.executable, "-c", code]
    said = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert said.split() == [str((ROOT / name / "__init__.py").resolve()) for name in NAMES]


def test_the_project_is_installed_and_never_to_be_uploaded():
    metadata = distribution("coastarc").metadata
    assert "Private :: Do Not Upload" in metadata.get_all("Classifier")


def test_imports_point_downwards():
    program = Path(sys.executable).with_name("lint-imports")
    # The contracts and their reasons are in pyproject.toml.
    ran = subprocess.run([program, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout


def folders_with_python(top):
    return sorted({path.parent for path in (ROOT / top).rglob("*.py")})


@pytest.mark.parametrize("folder", folders_with_python("tests"), ids=str)
def test_every_folder_of_tests_is_a_package(folder):
    while folder != ROOT:
        assert (folder / "__init__.py").is_file(), folder
        folder = folder.parent


@pytest.mark.parametrize("name", NAMES)
def test_every_folder_of_sources_is_a_package_with_types(name):
    for folder in folders_with_python(name):
        assert (folder / "__init__.py").is_file(), folder
    assert (ROOT / name / "py.typed").is_file()


@pytest.mark.parametrize("name", ["docs", "examples", "docker"])
def test_folders_that_hold_no_code_are_no_packages(name):
    assert not list((ROOT / name).rglob("__init__.py"))


def test_no_source_is_named_after_nothing():
    vague = {"utils", "helpers", "common", "base", "manager", "misc"}
    found = [path for top in (*NAMES, "tests") for path in (ROOT / top).rglob("*.py") if path.stem in vague]
    assert not found


def test_no_file_of_the_project_is_longer_than_600_lines():
    for top in (*NAMES, "tests"):
        for path in (ROOT / top).rglob("*.py"):
            assert len(path.read_text(encoding="utf-8").splitlines()) <= 600, path


@pytest.mark.parametrize("name", ["quick", "paper-small", "paper"])
def test_an_example_that_the_service_offers_too_is_kept_once(name):
    offered = ROOT / "service" / "spec" / "templates" / f"{name}.toml"
    assert (ROOT / "examples" / offered.name).resolve() == offered
    assert not offered.is_symlink()


@pytest.mark.parametrize(
    ("asked", "spared"),
    [
        ("verify", ("core.nlp", "core.search", "core.transcription.evaluate")),
        ("Problem", ("core.nlp", "core.search", "core.orbits", "numba")),
        ("SolveSettings", ("core.search",)),
    ],
)
def test_who_asks_core_for_one_thing_imports_only_what_it_needs(asked, spared):
    code = (
        f"import core, sys; from core import {asked}; assert '{asked}' in vars(core), 'asked again'\n"
        "print(*sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(ran.stdout.split()) & set(spared)


def test_all_exceptions_of_workers_have_one_root():
    sources = [path.read_text(encoding="utf-8") for path in sorted((ROOT / "workers").glob("*.py"))]
    found = [one for source in sources for one in re.findall(r"^class (\w+Error)\((.*)\):", source, re.M)]
    roots = [name for name, bases in found if not {name for name, _ in found} & set(bases.split(", "))]
    assert len(found) > 10 and roots == ["WorkerError"]
