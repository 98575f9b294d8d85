import csv
import io

import pytest

from core.csv_text import csv_text, without_formula


def test_a_reader_finds_the_cells_again_and_nothing_for_none():
    rows = [["a,b", 'say "x"', 0.1 + 0.2, None], ["two\nlines", "", 1, "é"]]
    read = list(csv.reader(io.StringIO(csv_text(rows), newline="")))
    assert read == [["a,b", 'say "x"', "0.30000000000000004", ""], ["two\nlines", "", "1", "é"]]


def test_a_carriage_return_in_a_cell_survives_lines_of_rfc_4180():
    text = csv_text([["a\rb", "c"]], "\r\n")
    assert text == '"a\rb",c\r\n'


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1"])
def test_a_formula_gets_an_apostrophe(text):
    assert without_formula(text) == f"'{text}"


@pytest.mark.parametrize("text", ["", "S(1|0)", "a=1", " =1"])
def test_other_text_stays_as_it_is(text):
    assert without_formula(text) == text
