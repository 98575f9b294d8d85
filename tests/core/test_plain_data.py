"""Texts that are made to cost more than their length: each is refused in one line, within a bound."""

import time
import tomllib
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.plain_data import MOST_KEY_PARTS, MOST_NESTED, MOST_TEXT_BYTES, read_json, read_toml
from core.problem import ProblemError, load_problem

LONG_KEY = "a." * 15000 + "a"

#: A text, and what its refusal says.
REFUSED = [
    (f"{LONG_KEY} = 1\n", "a key of at most 16 parts"),
    (f"[{LONG_KEY}]\n", "a key of at most 16 parts"),
    (f"x = {{ {LONG_KEY} = 1 }}\n", "a key of at most 16 parts"),
    (" . ".join(["a"] * 17) + " = 1\n", "a key of at most 16 parts"),
    (".".join(['"a"'] * 17) + " = 1\n", "a key of at most 16 parts"),
    # Quotes at the end of a text in three of them belong to it; what follows does not.
    (f'x = {{ b = """c""""", {LONG_KEY} = 1 }}\n', "a key of at most 16 parts"),
    (f"x = {{ b = '''c'''', {LONG_KEY} = 1 }}\n", "a key of at most 16 parts"),
    (f'x = {{ b = "\\"", {LONG_KEY} = 1 }}\n', "a key of at most 16 parts"),
    ("x = " + "[" * 30000, "at most 32 brackets"),
    ("x = " + "{a=" * 10000, "at most 32 brackets"),
    ("x = 0x" + "f" * 20000, "integers of fewer than 128 bits, got 80000"),
    ("# " + "-" * 40000, "lines of at most 32768 characters, got 40002"),
    ("a = 1\n" * 20000, "a text of at most 65536 bytes"),
    ("\u00e9" * 40000, "a text of at most 65536 bytes"),
]
#: As deep as it may be, or full of what only looks like keys.
TAKEN = [
    ".".join("a" * MOST_KEY_PARTS) + " = 1",
    "x = " + "[" * MOST_NESTED + "]" * MOST_NESTED,
    f'x = "{"a." * 50}"',
    f"x = '''\n{'a.' * 50}\n'''",
    f"# {'a.' * 50}\n",
    "x = [" + "1.5, " * 5000 + "]",
    "\n".join(f"a{i}.b.c = 1" for i in range(4000)),
]


@pytest.mark.parametrize(("text", "reason"), REFUSED)
def test_a_text_that_would_cost_more_than_its_length_is_refused(text, reason):
    tracemalloc.start()
    begun = time.process_time()
    try:
        with pytest.raises(ValueError, match=reason):
            read_toml(text)
        # A copy for each line and one as bytes; the key of 30 kB alone took 0.9 GiB and 4 s before.
        assert tracemalloc.get_traced_memory()[1] < 16 * 2**20 and time.process_time() - begun < 5.0
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("text", TAKEN)
def test_what_is_deep_and_in_use_is_read_as_before(text):
    assert read_toml(text) == tomllib.loads(text)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[" * 30000, "at most 32 brackets"),
        ('{"a":' * 33, "at most 32 brackets"),
        ("9" * 60, "integers of fewer than 128 bits"),
        ("[" + "1," * MOST_TEXT_BYTES + "1]", "a text of at most 65536 bytes"),
    ],
)
def test_json_has_the_same_bounds(text, reason):
    with pytest.raises(ValueError, match=reason):
        read_json(text)
    assert read_json('{"a": "[[[\\"[[["}') == {"a": '[[["[[['}


@given(st.lists(st.sampled_from(["a", ".", "=", '"', "'", '"""', "\\", "\n", " ", "{", "}", "[", "]", "#"])))
@settings(max_examples=500, deadline=None, derandomize=True)
def test_whatever_toml_takes_with_a_long_key_somewhere_is_refused(tokens):
    text = "".join(tokens) + "\n" + ".".join("z" * 17) + " = 1\n"
    try:
        found = tomllib.loads(text)
    except ValueError:
        return
    if "z" in found:
        with pytest.raises(ValueError, match="at most 16 parts"):
            read_toml(text)


def test_a_file_of_a_problem_has_bounds_as_well(tmp_path):
    (tmp_path / "deep.toml").write_text(f"{LONG_KEY} = 1\n")
    (tmp_path / "large.json").write_text("[" + "1," * 600_000 + "1]")
    with pytest.raises(ProblemError, match=r"got .*deep\.toml: expected a key of at most 16 parts"):
        load_problem(tmp_path / "deep.toml")
    with pytest.raises(ProblemError, match=r"got .*large\.json: expected a file of at most 1048576 bytes"):
        load_problem(tmp_path / "large.json")
