"""A specification as the TOML text that a user would have written, and the line on which a field stands.

Text is laid out as people write specifications: short tables and lists on one line.  Lines are found by
headers and by the keys that begin a line; a field inside an inline table has the line on which that begins.
"""

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from core.problem import ProblemError, presets, problem_from

#: A table or a list in a field is written on one line up to this length.
LINE = 100
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(fields: Mapping[str, Any]) -> str:
    """Return tables as TOML that reads back to equal data; what is None is left out."""
    blocks = ["\n".join(block) for name, value in fields.items() for block in _blocks((name,), value)]
    return "\n\n".join(blocks) + "\n"


def _blocks(path: tuple[str, ...], value: Any) -> Iterator[list[str]]:
    if isinstance(value, Mapping):
        yield from _table(f"[{_name(path)}]", path, value)
    else:
        for entry in value:
            yield from _table(f"[[{_name(path)}]]", path, entry)


def _table(head: str, path: tuple[str, ...], table: Mapping[str, Any]) -> Iterator[list[str]]:
    given = {key: value for key, value in table.items() if value is not None}
    # Tables of their own follow the fields, or the fields would belong to them.
    own = {key: value for key, value in given.items() if _is_table(key, value)}
    yield [head, *(_field(key, value) for key, value in given.items() if key not in own)]
    for key, value in own.items():
        yield from _table(f"[{_name((*path, key))}]", (*path, key), value)


def _is_table(key: str, value: Any) -> bool:
    return isinstance(value, Mapping) and len(_field(key, value)) > LINE


def _field(key: str, value: Any) -> str:
    line = f"{_key(key)} = {_value(value)}"
    if isinstance(value, list | tuple) and len(line) > LINE:
        return "\n".join([f"{_key(key)} = [", *(f"  {_value(entry)}," for entry in value), "]"])
    return line


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quote(value)
    if isinstance(value, Mapping):
        inside = ", ".join(f"{_key(key)} = {_value(one)}" for key, one in value.items() if one is not None)
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return repr(value)


def _name(path: tuple[str, ...]) -> str:
    return ".".join(map(_key, path))


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _quote(key)


def _quote(text: str) -> str:
    # JSON escapes what TOML escapes, but for one character.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def spec_text(fields: Mapping[str, Any]) -> str:
    """Return a stored specification as TOML; a problem that is near a preset is written by what differs."""
    return toml_text({**fields, "problem": _short_problem(fields["problem"])})


def _short_problem(fields: dict[str, Any]) -> dict[str, Any]:
    written = [fields, *(_beside(name, fields) for name in presets())]
    wanted = problem_from(fields).hash
    same = [one for one in written if _hash_of(one) == wanted]
    return min(same, key=lambda one: len(toml_text({"problem": one})))


def _hash_of(fields: Mapping[str, Any]) -> str | None:
    """Return the hash of a problem, or None where laid over a preset it is none."""
    try:
        return problem_from(fields).hash
    except ProblemError:
        return None


def _beside(name: str, fields: dict[str, Any]) -> dict[str, Any]:
    base = problem_from({"preset": name}).model_dump(mode="json")
    return {"preset": name, **_changes(base, fields)}


def _changes(base: Mapping[str, Any], fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields that differ from those of a preset, which are laid over it when they are read."""
    changed = {}
    for name, value in fields.items():
        old = base.get(name)
        if value == old:
            continue
        is_inside = isinstance(value, dict) and isinstance(old, dict) and value.get("kind") == old.get("kind")
        changed[name] = _changes(old, value) if is_inside and old is not None else value
    return changed


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
