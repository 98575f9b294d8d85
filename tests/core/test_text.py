"""Files as the editors of several systems write them."""

import codecs

import pytest

from core.plain_data import TextError, read_text, text_of
from core.problem import ProblemError, load_problem

TEXT = 'name = "Mond, Erde, größer"\nk = 1\n'
FORMS = {
    "plain": TEXT.encode(),
    "notepad": codecs.BOM_UTF8 + TEXT.encode(),
    "powershell": codecs.BOM_UTF16_LE + TEXT.replace("\n", "\r\n").encode("utf-16-le"),
    "utf-16-be": codecs.BOM_UTF16_BE + TEXT.encode("utf-16-be"),
    "utf-32": codecs.BOM_UTF32_LE + TEXT.encode("utf-32-le"),
    "dos": TEXT.replace("\n", "\r\n").encode(),
    "classic mac": TEXT.replace("\n", "\r").encode(),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_text_is_the_same_whatever_wrote_it(form, tmp_path):
    (tmp_path / "a.toml").write_bytes(FORMS[form])
    assert read_text(tmp_path / "a.toml") == TEXT


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"name = \xff", r"expected UTF-8, got byte 0xff at place 7; save it as UTF-8"),
        (
            codecs.BOM_UTF16_LE + b"a\0b",
            r"expected UTF-16-LE after its byte order mark, got byte 0x62 at place 4",
        ),
        (TEXT.encode("utf-16-le"), r"got byte 0xf6 at place 44"),
        ("plain".encode("utf-16-be"), r"expected text, got null bytes; save it as UTF-8"),
    ],
)
def test_bytes_that_are_no_text_are_refused_with_what_they_are(content, reason):
    with pytest.raises(TextError, match=reason):
        text_of(content)


@pytest.mark.parametrize("suffix", ["toml", "json"])
@pytest.mark.parametrize("mark", [codecs.BOM_UTF8, codecs.BOM_UTF16_LE])
def test_a_problem_is_read_with_a_byte_order_mark(suffix, mark, tmp_path):
    text = {"toml": 'preset = "ppe-drm3"\r\n', "json": '{"preset": "ppe-drm3"}\r\n'}[suffix]
    path = tmp_path / f"p.{suffix}"
    path.write_bytes(mark + text.encode("utf-8" if mark == codecs.BOM_UTF8 else "utf-16-le"))
    assert load_problem(path) == load_problem("ppe-drm3")


def test_a_problem_in_another_encoding_is_refused_in_one_line(tmp_path):
    (tmp_path / "p.toml").write_bytes('preset = "größer"'.encode("latin-1"))
    with pytest.raises(ProblemError, match=r"p\.toml: expected UTF-8, got byte 0xf6 at place 12; save it"):
        load_problem(tmp_path / "p.toml")
