"""Documents against code: parameters, equation numbers, links and words."""

import ast
import importlib
import inspect
import re
import tomllib
from pathlib import Path

import pytest

from core.nlp import ExitStatus
from core.search import GUESS_LAWS, HOP_LAWS, MAPPINGS
from service.db.tables import Base
from service.spec.search_spec import SearchSpec, Seeds
from workers.messages import Ending

ROOT = Path(__file__).parents[1]
METHOD = (ROOT / "docs" / "method.md").read_text(encoding="utf-8")
CAMPAIGNS = (ROOT / "docs" / "campaigns.md").read_text(encoding="utf-8")
GLOSSARY = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
SOURCES = sorted(path for top in ("core", "workers", "service") for path in (ROOT / top).rglob("*.py"))
PACKAGES = ("core", *(f"core.{path.parent.name}" for path in sorted((ROOT / "core").glob("*/__init__.py"))))
#: Words that mean a shape, a unit or a kind in the description of a parameter.
_SHAPE = re.compile(r"\(.*\) (arrays?|CSR array)|^\(")
_UNIT = re.compile(r"\[[^\]]+\]")
_KINDS = re.compile(r"^(float|int)\b")


def public_functions():
    """Return the functions that the packages of core offer, by name."""
    found = {}
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in getattr(module, "__all__", ()):
            thing = inspect.unwrap(getattr(getattr(module, name), "py_func", getattr(module, name)))
            if inspect.isfunction(thing):
                found[f"{thing.__module__}.{name}"] = thing
    return found


FUNCTIONS = public_functions()


def documented_parameters(function):
    """Return the lines (name, kind, description) of a numpydoc section Parameters."""
    text = inspect.getdoc(function)
    section = re.search(r"Parameters\n-+\n(.*?)(?:\n\n[A-Z][a-z]+\n-+\n|\Z)", text, re.DOTALL)
    if section is None:
        return {}
    entries = re.findall(r"^(\w[\w, ]*?) ?(?:: (.*))?\n((?:    .*\n?)+)", section.group(1), re.MULTILINE)
    return {name: (kind, about) for names, kind, about in entries for name in names.split(", ")}


def test_the_public_functions_of_core_are_found():
    assert {"core.nlp.solve.solve", "core.dynamics.dop853.propagate"} <= set(FUNCTIONS)
    assert len(FUNCTIONS) > 20


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_starts_with_a_sentence(name):
    first = inspect.getdoc(FUNCTIONS[name]).split("\n\n")[0]
    assert first[0].isupper() and re.search(r"[.:;]", first)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_documented_parameters_are_those_of_the_function_in_order(name):
    documented = [parameter for parameter in documented_parameters(FUNCTIONS[name])]
    if documented:
        assert documented == list(inspect.signature(FUNCTIONS[name]).parameters)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_arrays_have_a_shape_and_numbers_a_unit(name):
    for parameter, (kind, about) in documented_parameters(FUNCTIONS[name]).items():
        if "array" in kind:
            assert _SHAPE.search(kind), f"{parameter} : {kind}"
        if _KINDS.search(kind):
            assert _UNIT.search(about), f"{parameter} : {kind}: {about.strip()}"


def citations():
    """Return (file, cited text) of each line that mentions method.md, with the next line."""
    found = []
    for path in SOURCES:
        for match in re.finditer(r"[^\n]*method\.md[^\n]*\n[^\n]*", path.read_text(encoding="utf-8")):
            found.append((path.relative_to(ROOT).as_posix(), match.group()))
    return found


def cited_equations(text):
    """Return the numbers after "eq." or "eqs." in one citation, ranges written out."""
    numbers = set()
    for part in re.findall(r"eqs?\.? ((?:\(?[A-Z]?\d+\)?(?:-|, | and | to )?)+)", text):
        for first, last in re.findall(r"\(?([A-Z]?\d+)\)?(?:(?:-| to )\(?([A-Z]?\d+)\)?)?", part):
            letter = first.rstrip("0123456789")
            start, stop = (int(re.sub("[A-Z]", "", number)) for number in (first, last or first))
            numbers |= {f"{letter}{number}" for number in range(start, stop + 1)}
    return numbers


DEFINED = set(re.findall(r"^    \(([A-Z]?\d+)\)  ", METHOD, re.MULTILINE))
SECTIONS = set(re.findall(r"^## (\d+)\. ", METHOD, re.MULTILINE))
TITLES = set(re.findall(r"^#+ (?:\d+\. )?(.*)$", METHOD, re.MULTILINE))


def test_citations_are_read_as_they_are_written():
    assert cited_equations("method.md, eqs. 2-5; and") == {"2", "3", "4", "5"}
    assert cited_equations("method.md eqs. 2, 4 and 5.") == {"2", "4", "5"}
    assert cited_equations("method.md, eqs. (O5) to (O7).") == {"O5", "O6", "O7"}
    assert len(citations()) > 15


@pytest.mark.parametrize(("path", "text"), citations())
def test_what_the_code_cites_stands_in_the_method(path, text):
    assert cited_equations(text) <= DEFINED
    assert set(re.findall(r"section (\d+)", text)) <= SECTIONS
    assert set(re.findall(r'method\.md, "([^"]+)"', text)) <= TITLES


def test_equations_have_one_number_each():
    numbers = re.findall(r"^    \(([A-Z]?\d+)\)  ", METHOD, re.MULTILINE)
    assert len(numbers) == len(set(numbers))
    assert {str(number) for number in range(1, 25)} <= set(numbers)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_pages_that_the_code_names_exist(path):
    for page in re.findall(r"docs/[\w/-]+\.md", path.read_text(encoding="utf-8")):
        assert (ROOT / page).is_file(), page


ENTRIES = dict(re.findall(r"^\*\*([^*]+)\*\*: ((?:.+\n)+)", GLOSSARY, re.MULTILINE))
#: The words of the house; one that is not here is no type, field, table or column.
WORDS = """
    problem P_k, case, outage, reference, realization, segment, arc, leg, node, control, throttle, matchpoint,
    defect, guess, seed, seed chain, lineage, rng_seed, solution, S(k), S(k|k'), hop, chain, job, attempt,
    claim, lease, outcome, ending, archive, campaign, dispatcher, executor
"""


@pytest.mark.parametrize("word", [word.strip() for word in WORDS.split(",")])
def test_a_word_of_the_house_is_in_the_glossary(word):
    assert word in ENTRIES


def test_every_table_of_the_database_is_named_by_a_word_of_the_glossary():
    words = {word.removesuffix(" P_k") for word in ENTRIES}
    assert {name.replace("_", " ") for name in Base.metadata.tables} <= words


def test_endings_mappings_and_laws_are_documented_where_they_are_explained():
    assert all(ending.value in ENTRIES["ending"] for ending in Ending)
    assert all(mapping in ENTRIES["mapping"] and f"**{mapping}**" in METHOD for mapping in MAPPINGS)
    assert all(f"*{law}*" in METHOD for law in [*GUESS_LAWS, *HOP_LAWS])


def test_every_field_of_a_specification_is_documented():
    fields = {*Seeds.model_fields, *SearchSpec.model_fields} - {"id", "source"}
    assert all(f"`{name}`" in CAMPAIGNS for name in fields)
    choices = ("order", "pairing", "tolerance")
    named = [
        name for field in choices for name in re.findall(r"'([a-z_-]+)'", str(Seeds.model_fields[field]))
    ]
    assert len(named) > 8 and all(f"`{name}`" in CAMPAIGNS for name in named)


def test_every_entry_of_the_glossary_is_a_sentence_and_stands_once():
    assert all(text.rstrip().endswith(".") for text in ENTRIES.values())
    assert len(re.findall(r"^\*\*", GLOSSARY, re.MULTILINE)) == len(ENTRIES)


def test_every_member_of_an_enumeration_of_core_is_explained():
    assert all(len(status.value.split()) > 5 for status in ExitStatus)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_source_says_in_its_first_lines_what_it_is_for(path):
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))


def test_every_public_name_of_core_is_on_the_page_for_python():
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in page for name in importlib.import_module("core").__all__)


def test_every_package_of_core_with_public_names_is_in_the_reference():
    page = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    named = {package for package in PACKAGES if hasattr(importlib.import_module(package), "__all__")}
    assert named <= set(re.findall(r"automodule:: (\S+)", page))


def test_an_extra_is_added_to_the_installation_that_is_there():
    """Without -e, pip replaces an editable installation by a copy; a server's is a copy of its own."""
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "docs").rglob("*.ipynb"), *SOURCES]
    lines = [line for path in pages for line in path.read_text(encoding="utf-8").splitlines()]
    added = [line for line in lines if re.search(r"'\.\[\w+\]'", line)]
    assert len(added) > 5
    assert all(re.search(r"-e '\.\[|^/opt/coastarc/bin/pip install", line) for line in added)


def test_how_to_cite_names_the_version_and_the_license_of_the_project():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    cited = dict(re.findall(r"^([\w-]+): (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M))
    assert (cited["version"], cited["license"]) == (project["version"], project["license"])
    assert "Apache License" in (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert f"\n## {project['version']}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
