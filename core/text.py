"""Text of a file that somebody wrote, in whatever Unicode form their editor chose."""

import codecs
from pathlib import Path

#: What each byte order mark says; that of UTF-32 begins like the one of UTF-16, so it is looked for first.
_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}


class TextError(ValueError):
    """Bytes that are no text; the message says what they are."""


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
