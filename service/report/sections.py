"""What a report holds, in its order: results first, then what needs no solve."""

from datetime import timedelta

from core.analysis.campaign_statistics import CampaignFacts
from service.report.cases_section import cases_section
from service.report.cells import Table
from service.report.cumulative_section import cumulative_section
from service.report.delta_v_section import changes_section, delta_v_section
from service.report.factors_section import comparisons_section, mappings_section
from service.report.groups import groups_of
from service.report.page import Fact, Head, Section
from service.report.strategies_section import strategies_section
from service.report.structure_section import outages_section, sparsity_section

EMPTY = "No solves yet: the tables and figures of results appear as soon as the first solves are handed in."
RUNNING = "This campaign has not ended; the report holds what the archive had when it was written."


def sections_of(facts: CampaignFacts) -> tuple[Section, ...]:
    """Return the sections of a report; those about solves are left out while there are none."""
    return (*result_sections(facts), sparsity_section(facts.problem), outages_section())


def result_sections(facts: CampaignFacts) -> tuple[Section, ...]:
    """Return the sections about solves, none while there are none."""
    if not facts.solves:
        return ()
    groups = groups_of(facts)
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
    """Return what the page says first."""
    n_strict = sum(solve.strict for solve in facts.solves)
    n_paper = sum(solve.paper for solve in facts.solves)
    seconds = round(sum(solve.cpu_seconds for solve in facts.solves))
    shown = (
        Fact("state", facts.state),
        Fact("solves", f"{len(facts.solves):,}"),
        Fact("solutions, paper's tolerance", f"{n_paper:,}"),
        Fact("solutions, strict", f"{n_strict:,}"),
        Fact("CPU time", str(timedelta(seconds=seconds))),
        Fact("cases", str(len({solve.outages for solve in facts.solves}))),
        Fact("rng_seed", str(facts.rng_seed)),
    )
    notices = [] if facts.state == "done" else [RUNNING]
    return Head(facts.id, facts.name, shown, (*notices, *([] if facts.solves else [EMPTY])))


def tables_of(facts: CampaignFacts) -> tuple[Table, ...]:
    """Return the tables about solves alone."""
    return tuple(table for section in result_sections(facts) for table in section.tables)
