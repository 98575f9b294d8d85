"""The files of a report: the same facts give the same bytes.

Results come first, then what is joined from the paper for campaigns of the flagship.
"""

from collections.abc import Callable, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

from core.analysis.campaign_facts import CampaignFacts
from service.report.costs import (
    changes_section,
    comparisons_section,
    cumulative_section,
    delta_v_section,
    mappings_section,
)
from service.report.page import Fact, Head, Section, page
from service.report.paper.beside import beside_of
from service.report.strategies import cases_section, groups_of, strategies_section
from service.report.style import as_png, as_svg, figure_style, lay_out
from service.report.tables import Table

EMPTY = "No solves yet: tables and figures of results appear with the first solves."
RUNNING = "This campaign has not ended; the report shows the archive at the time of writing."


def sections_of(facts: CampaignFacts) -> tuple[Section, ...]:
    """Return the sections of a report; those about solves are left out while there are none."""
    return (*result_sections(facts), *beside_of(facts.problem).sections(facts.problem))


def result_sections(facts: CampaignFacts) -> tuple[Section, ...]:
    """Return the sections about solves, none while there are none."""
    if not facts.solves:
        return ()
    groups = groups_of(facts, beside_of(facts.problem))
    has_seeds = any(solve.seed_k is not None for solve in facts.solves)
    found = (
        strategies_section(groups),
        cumulative_section(groups) if has_seeds else None,
        delta_v_section(groups),
        changes_section(groups),
        mappings_section(groups),
        comparisons_section(groups),
        cases_section(groups),
    )
    return tuple(section for section in found if section is not None)


def head_of(facts: CampaignFacts) -> Head:
    """Return the top of the page."""
    n_strict = sum(solve.strict for solve in facts.solves)
    n_paper = sum(solve.paper for solve in facts.solves)
    seconds = round(sum(solve.cpu_seconds for solve in facts.solves))
    shown = (
        Fact("state", facts.state),
        Fact("solves", f"{len(facts.solves):,}"),
        Fact("loose solutions", f"{n_paper:,}"),
        Fact("strict solutions", f"{n_strict:,}"),
        Fact("CPU time", str(timedelta(seconds=seconds))),
        Fact("cases", str(len({solve.outages for solve in facts.solves}))),
        Fact("rng_seed", str(facts.rng_seed)),
    )
    notices = [] if facts.state == "done" else [RUNNING]
    notices += [] if facts.solves else [EMPTY]
    return Head(facts.id, facts.name, shown, tuple(notices), beside_of(facts.problem).source)


def tables_of(facts: CampaignFacts) -> tuple[Table, ...]:
    """Return the tables of results."""
    return tuple(table for section in result_sections(facts) for table in section.tables)


#: The page, and the folder beside it.
PAGE, PARTS = "report.html", "parts"


def write_report(facts: CampaignFacts, folder: Path) -> Path:
    """Write the report of a campaign into a folder, replacing an earlier one; return the path of the page."""
    return write_page(lambda: (head_of(facts), sections_of(facts)), folder)


def write_page(build: Callable[[], tuple[Head, Sequence[Section]]], folder: Path) -> Path:
    """Write a page with its figures and tables into a folder; `build` is called in our figure style."""
    parts = folder / PARTS
    parts.mkdir(parents=True, exist_ok=True)
    svgs: dict[str, str] = {}
    with figure_style():
        head, sections = build()
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
    """Return the tables of results as plain data, under the names of their CSV files."""
    return {
        "id": facts.id,
        "name": facts.name,
        "state": facts.state,
        "tables": {table.name: table.as_records() for table in tables_of(facts)},
    }


def _write(path: Path, text: str) -> None:
    # newline="" makes the bytes independent of the operating system.
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(text)
