"""What a report shows beside its own numbers: nothing, unless values were published for its problem."""

from collections.abc import Sequence

from core.analysis.campaign_statistics import Summary
from core.analysis.cumulative_cost import Cumulative
from core.problem import Problem
from service.report.page import Section
from service.report.plots import Chart, Sample
from service.report.tables import Table


class Beside:
    """Published values to join to tables and figures; there are none here."""

    #: Where the values come from, for the foot of the page.
    source = ""

    def join_table(self, table: Table, groups: Sequence[Summary | Cumulative]) -> Table:
        """Return a table, one row per group, with columns of published values at its end."""
        return table

    def join_chart(self, chart: Chart, groups: Sequence[Summary | Cumulative]) -> Chart:
        """Return a forest plot, one row per group, with series of published values."""
        return chart

    def join_samples(self, samples: Sequence[Sample], groups: Sequence[Summary]) -> Sequence[Sample]:
        """Return the samples, one per group, with published means."""
        return samples

    def sentence(self, name: str) -> str:
        """Return what is to be added to a paragraph or to the caption of a figure."""
        return ""

    def sections(self, problem: Problem) -> tuple[Section, ...]:
        """Return sections that need no solve."""
        return ()
