"""Messages that docs/troubleshooting.md quotes, against the messages of the source."""

import ast
import functools
import re

import pytest

from core.nlp import ExitStatus
from tests.pages import ROOT, prose_of

PAGE = prose_of(ROOT / "docs" / "troubleshooting.md")
QUOTED = [line for line in re.findall(r"^    (.+)$", PAGE, re.MULTILINE) if not line.startswith("coastarc ")]
#: A pattern with fewer letters of its own, besides the words that all have, would fit anything.
LEAST_LETTERS = 8


def pattern_of(node):
    """Return the pattern of a text or an f-string of the source, and how many letters are its own."""
    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
    texts = [part.value if isinstance(part, ast.Constant) else None for part in parts]
    own = re.sub(r"expected|got|[^a-z]", "", "".join(text or "" for text in texts))
    return "".join(".*?" if text is None else re.escape(text) for text in texts), len(own)


@functools.cache
def patterns():
    """Return the patterns of all texts of the source that say what was expected."""
    found = set()
    for top in ("core", "workers", "service"):
        for path in (ROOT / top).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                is_text = isinstance(node, ast.JoinedStr) or (
                    isinstance(node, ast.Constant) and isinstance(node.value, str)
                )
                if is_text:
                    pattern, letters = pattern_of(node)
                    if letters >= LEAST_LETTERS and "expected" in pattern:
                        found.add(pattern)
    return found


@pytest.fixture(scope="module")
def known():
    # Around a message stand the table, field or search that it is about, and the address of what was asked.
    return [re.compile(rf"(?:[^;]*(?:: |\.))?{pattern}(?:; .*)?") for pattern in patterns()]


def test_messages_are_quoted_and_found():
    assert len(QUOTED) > 12 and len(patterns()) > 100


@pytest.mark.parametrize("message", QUOTED)
def test_a_quoted_message_is_one_of_the_source(message, known):
    assert any(pattern.fullmatch(message) for pattern in known), message


def test_a_message_that_nobody_writes_is_found_out(known):
    assert not any(
        pattern.fullmatch("port 1: expected a quiet one, got noise; use --port") for pattern in known
    )


def test_advice_of_a_status_is_that_of_the_solver():
    said = " ".join(status.value for status in ExitStatus)
    quoted = re.findall(r"^- \*([^*]+)\*:", PAGE, re.MULTILINE)
    assert len(quoted) == 2 and all(words in said for words in quoted)
