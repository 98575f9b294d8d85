"""Plain data as TOML text, laid out as people write specifications: short tables and lists on one line."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

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
        return _quoted(value)
    if isinstance(value, Mapping):
        inside = ", ".join(f"{_key(key)} = {_value(one)}" for key, one in value.items() if one is not None)
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return repr(value)


def _name(path: tuple[str, ...]) -> str:
    return ".".join(map(_key, path))


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _quoted(key)


def _quoted(text: str) -> str:
    # JSON escapes what TOML escapes, but for one character.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
