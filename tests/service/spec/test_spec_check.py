"""Specifications as somebody types them: faults with their lines, plans, and texts that read back."""

import time
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.api.problems import TEMPLATES
from service.spec import load_spec, spec_from
from service.spec.spec_check import check_fields, check_text, planned
from service.spec.spec_text import spec_text, toml_text

EXAMPLES = Path(__file__).parents[3] / "examples"
QUICK = (EXAMPLES / "quick.toml").read_text(encoding="utf-8")


def line_with(text):
    return next(n for n, line in enumerate(QUICK.splitlines(), start=1) if text in line)


@pytest.mark.parametrize(
    ("old", "new", "path", "words"),
    [
        ("guesses = 30", "guesses = -3", "search.0.guesses", "at least 1, got -3"),
        ('"S(1|0)"', '"S(1|2)"', "search.1.strategy", "got S(1|2)"),
        ("segment = 24, ", "segment = 240, ", "search.1.outages", "got 240"),
        ('seeds = { from = "s0" }', 'seeds = { from = "s9" }', "search.1.seeds", "got 's9'"),
        ('preset = "ppe-drm3"', 'preset = "moon"', "problem.preset", "got 'moon'"),
        ('id = "s3-0"', 'id = "s0"', "search.2.id", "'s0' 2 times"),
    ],
)
def test_a_fault_has_its_field_and_its_line(old, new, path, words):
    faults = check_text(QUICK.replace(old, new, 1)).faults
    assert [(fault.path, fault.line) for fault in faults] == [(path, line_with(old))]
    assert words in faults[0].message


def test_a_text_that_is_no_toml_names_the_line():
    (fault,) = check_text(QUICK.replace("[problem]", "[problem")).faults
    assert fault.line == line_with("[problem]") and "expected TOML" in fault.message


def test_what_is_missing_is_told_at_its_table():
    (fault,) = check_text(QUICK.replace("rng_seed = 2026\n", "")).faults
    assert (fault.path, fault.line) == ("campaign.rng_seed", line_with("[campaign]"))


def test_nothing_and_numbers_and_lists_are_faults_and_no_errors():
    for text in (
        "",
        "a = 1",
        "{",
        "[]",
        '{"search": 3}',
        "search = [1, {id = 3}]",
        "\x00",
        "[[search]]\nid=[]",
    ):
        assert check_text(text).faults, text


def test_a_plan_bounds_what_seeds_may_lead_to():
    bounds = {one.id: one.n_guesses_most for one in planned(check_text(QUICK).spec)}
    assert bounds == {"s0": 30, "s1-0": 30, "s3-0": 30}


def test_the_route_answers_what_can_be_submitted(client):
    answer = client.post("/api/v1/specs/check", json={"text": QUICK}).json()
    assert answer["faults"] == [] and answer["plan"]["n_guesses_most"] == 90
    assert client.post("/api/v1/campaigns", json=answer["fields"]).status_code == 201


def test_a_path_on_the_machine_is_refused_unread():
    target = '[problem.target]\nkind = "spk"\npath = "/etc/passwd"\n\n'
    text = QUICK.replace("[[search]]", target + "[[search]]", 1)
    (fault,) = check_text(text).faults
    assert fault.path == "problem.target" and "without a file" in fault.message


@pytest.mark.parametrize("name", TEMPLATES)
def test_a_template_is_the_example_of_its_name(client, name):
    items = {item["name"]: item["toml"] for item in client.get("/api/v1/specs/templates").json()["items"]}
    assert items[name] == (EXAMPLES / f"{name}.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", TEMPLATES)
def test_a_clone_is_the_same_specification_and_keeps_its_preset(store, client, name):
    spec = load_spec(EXAMPLES / f"{name}.toml")
    store.submit(spec)
    text = client.get("/api/v1/campaigns/1/spec").json()["toml"]
    assert spec_from(tomllib.loads(text)).hash == spec.hash
    assert 'preset = "ppe-drm3"' in text and "departure" not in text


def test_a_problem_that_differs_from_the_preset_is_written_by_what_differs():
    fields = tomllib.loads(QUICK)
    fields["problem"] |= {"spacecraft": {"max_thrust_n": 1.25}, "departure": {"epoch": "2026-05-01T00:00:00"}}
    spec = spec_from(fields)
    text = spec_text(spec.as_fields())
    assert spec_from(tomllib.loads(text)).hash == spec.hash
    assert "max_thrust_n = 1.25" in text and "isp_s" not in text


WORDS = st.text(max_size=6)
PLAIN = st.one_of(st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False), WORDS)
DATA = st.recursive(
    PLAIN, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3), max_leaves=5
)


@settings(max_examples=30, deadline=None)
@given(st.dictionaries(WORDS, st.dictionaries(WORDS, DATA, max_size=4), min_size=1, max_size=3))
def test_what_is_written_as_toml_reads_back(tables):
    assert tomllib.loads(toml_text(tables)) == tables


#: Fields of a problem and of a specification by the ten thousand, each of them a fault.
FLOODS = [
    {"problem": {f"key{i}": i for i in range(20_000)}},
    {"problem": {"preset": "ppe-drm3", "outages": [{}] * 20_000}},
    {f"key{i}": i for i in range(20_000)},
    {"search": [{}] * 20_000},
]


@pytest.mark.parametrize("fields", FLOODS)
def test_ten_thousands_of_faults_cost_little_and_the_first_are_told(fields):
    begun = time.process_time()
    faults = check_fields(fields).faults
    # The comparison of each fault with each other took 50 s and more.
    assert time.process_time() - begun < 10.0
    assert 50 <= len(faults) <= 55 and any("expected fewer faults" in fault.message for fault in faults)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a." * 15000 + "a = 1\n", "a key of at most 16 parts"),
        (QUICK.replace("guesses = 30", "guesses = 0x" + "f" * 20000), "integers of fewer than 128 bits"),
        (QUICK.replace("guesses = 30", "guesses = " + "9" * 5000), "expected TOML"),
        ('{"a":' + "[" * 30000, "at most 32 brackets"),
        ('{"a":' + "9" * 5000 + "}", "expected JSON"),
        ('y = """\n[' + " " * 20000 + '\n"""\n', "expected a value"),
        ('y = """\n' + "a ." * 10000 + '\n"""\n', "expected a value"),
    ],
)
def test_a_text_made_to_cost_more_than_its_length_is_a_fault(text, words):
    begun = time.process_time()
    fault = check_text(text).faults[0]
    assert words in fault.message and time.process_time() - begun < 5.0


def test_thrust_that_cannot_suffice_is_told_before_it_is_run(client):
    weak = "wet_mass_kg = 1500.0\ndry_mass_kg = 700.0\nmax_thrust_n = 0.002\nisp_s = 3000.0\n"
    text = (
        f'[campaign]\nname = "weak"\nrng_seed = 1\n[problem]\npreset = "earth-mars"\n'
        f'[problem.spacecraft]\n{weak}[[search]]\nid = "s0"\nstrategy = "S(0)"\nguesses = 2\n'
    )
    answer = client.post("/api/v1/specs/check", json={"text": text}).json()
    assert answer["faults"] == [] and answer["plan"]["n_guesses_most"] == 2
    assert "no guess can close: 0.002 N for 700 days on 1500 kg" in answer["remarks"][0]
    assert client.post("/api/v1/specs/check", json={"text": QUICK}).json()["remarks"] == []
