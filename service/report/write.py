"""The files of a report: the same facts give the same bytes."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from core.analysis.campaign_statistics import CampaignFacts
from service.report.page import Head, Section, page
from service.report.sections import head_of, sections_of, tables_of
from service.report.style import as_png, as_svg, house_style, lay_out

#: The page, and the folder beside it.
PAGE, PARTS = "report.html", "parts"


def write_report(facts: CampaignFacts, folder: Path) -> Path:
    """Write the report of a campaign into a folder, over an earlier one, and return where the page is."""
    return write_page(lambda: (head_of(facts), sections_of(facts)), folder)


def write_page(made: Callable[[], tuple[Head, Sequence[Section]]], folder: Path) -> Path:
    """Write a page with its figures and tables into a folder; `made` draws in the style of the house."""
    parts = folder / PARTS
    parts.mkdir(parents=True, exist_ok=True)
    svgs: dict[str, str] = {}
    with house_style():
        head, sections = made()
        for section in sections:
            for table in section.tables:
                _write(parts / f"{table.name}.csv", table.as_csv())
            for picture in section.pictures:
                lay_out(picture.figure)
                svgs[picture.name] = as_svg(picture.figure)
                _write(parts / f"{picture.name}.svg", svgs[picture.name])
                (parts / f"{picture.name}.png").write_bytes(as_png(picture.figure))
    path = folder / PAGE
    _write(path, page(head, sections, svgs))
    return path


def tables_as_json(facts: CampaignFacts) -> dict[str, Any]:
    """Return the tables about solves as plain data, under the names of their CSV files."""
    return {
        "id": facts.id,
        "name": facts.name,
        "state": facts.state,
        "tables": {table.name: table.as_records() for table in tables_of(facts)},
    }


def _write(path: Path, text: str) -> None:
    # With newline="" the bytes do not depend on the system.
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(text)
