"""Where in a TOML text a field stands: what the parser of the standard library does not tell.

Headers and the keys at the beginning of lines are found, which is how specifications are written; a field
inside an inline table is found by the line on which that begins.
"""

import re
from collections import Counter
from collections.abc import Sequence

#: Names, and places in lists, from the root on.
Path = tuple[str | int, ...]

# Possessive, and with one way to match: what a user typed must not cost more than its length.
_HEADER = re.compile(r"\s*+(\[\[?)([^\[\]]++)\]\]?\s*+(?:#.*)?$")
_KEY = re.compile(r"""\s*+((?:[\w-]++|"[^"]*+"|'[^']*+')(?:\s*+\.\s*+(?:[\w-]++|"[^"]*+"|'[^']*+'))*)\s*+=""")
_SYNTAX = re.compile(r"\(at (?:line (\d+), column \d+|end of document)\)$")


def line_of(text: str, path: Sequence[str | int]) -> int | None:
    """Return the line, counted from 1, of the longest beginning of a path that stands in the text."""
    lines = field_lines(text)
    for end in range(len(path), 0, -1):
        if (found := lines.get(tuple(path[:end]))) is not None:
            return found
    return None


def field_lines(text: str) -> dict[Path, int]:
    """Return the line of each table and field."""
    lines: dict[Path, int] = {}
    n_of_list: Counter[Path] = Counter()
    table: Path = ()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = _parts(header[2])
            if header[1] == "[[":
                n_of_list[table] += 1
                table = (*table, n_of_list[table] - 1)
            lines.setdefault(table, number)
        elif key := _KEY.match(line):
            path = (*table, *_parts(key[1]))
            lines.setdefault(path, number)
    return lines


def _parts(name: str) -> Path:
    found = re.findall(r"""[\w-]+|"[^"]*"|'[^']*'""", name)
    return tuple(part.strip("\"'") for part in found)


def syntax_fault(error: ValueError, text: str) -> tuple[str, int]:
    """Return what the parser says about a text, and the line that it means."""
    words = str(error)
    place = _SYNTAX.search(words)
    line = int(place[1]) if place and place[1] else max(1, len(text.splitlines()))
    return _SYNTAX.sub("", words).rstrip(), line
