"""The structure of a problem: sizes, sparsity of the Jacobian, probabilities of outages.

An arc is T_i + T_s, as in docs/method.md, "Coverage".
"""

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from core.analysis.safe_modes import (
    LONGEST_ARC,
    RECOVERIES,
    SAFE_MODES,
    Weibull,
    count_distribution,
    duration_cdf,
)
from core.analysis.sparsity import dense_entries, pattern
from core.epochs import calendar_epoch
from core.orbits import departure_state
from core.problem import Problem
from core.transcription import TrajectoryLayout, layout_of
from service.schemas.problem import (
    ArcChance,
    DurationChance,
    LawView,
    OutageView,
    ProblemStructure,
    TrajectoryShape,
)

#: Runs of entries in one picture.
MOST_RUNS = 5000
#: Points of the curves: arcs, and durations up to so many days.
N_ARCS, N_DURATIONS, LONGEST_DURATION_DAYS = 13, 41, 10.0


def structure_of(problem: Problem) -> ProblemStructure:
    """Return all that the page of a problem draws without asking what was found."""
    layout = layout_of(problem)
    entries = pattern(problem)
    runs, gap = _runs(entries.indptr, entries.indices)
    n_defects, n_variables = entries.shape
    start = departure_state(problem.departure, problem.spacecraft)
    segments = [outage.segment for outage in problem.outages]
    bounds = problem.bounds
    return ProblemStructure(
        hash=problem.hash,
        n_variables=n_variables,
        n_defects=n_defects,
        n_nonzeros=entries.nnz,
        n_dense=dense_entries(problem.n_segments, segments, problem.segmentation),
        trajectories=[_shape(own, layout.reference) for own in layout.trajectories],
        runs=runs,
        filled_gap=gap,
        departure_epoch=calendar_epoch(start.et),
        departure_mass_kg=start.mass_kg,
        between=_law(SAFE_MODES),
        recovery=_law(RECOVERIES),
        chances=list(_chances(bounds.initial_coast_days[1] + bounds.shooting_days[1])),
        durations=_durations(problem),
    )


def _shape(own: TrajectoryLayout, reference: TrajectoryLayout) -> TrajectoryShape:
    leaves: Literal["forward", "backward"] | None = None
    if own.outage is not None:
        leaves = "forward" if own.outage.segment <= reference.matchpoint else "backward"
    return TrajectoryShape(
        outage=OutageView.model_validate(own.outage) if own.outage else None,
        n_segments=own.n_segments,
        first_variable=own.offset,
        n_variables=own.stop - own.offset,
        matchpoint=own.matchpoint,
        leaves=leaves,
    )


def _runs(
    row_starts: NDArray[np.int64], columns: NDArray[np.int64]
) -> tuple[list[tuple[int, int, int]], int]:
    """Return runs of neighbouring entries row by row, with gaps filled until there are few enough."""
    rows = np.repeat(np.arange(len(row_starts) - 1), np.diff(row_starts))
    order = np.lexsort((columns, rows))
    rows, columns = rows[order], columns[order]
    gap = 0
    while True:
        is_first = np.append(True, (np.diff(rows) != 0) | (np.diff(columns) > 1 + gap))
        if np.count_nonzero(is_first) <= MOST_RUNS:
            break
        gap = max(1, 2 * gap)
    first = np.flatnonzero(is_first)
    last = np.append(first[1:], len(columns)) - 1
    widths = columns[last] - columns[first] + 1
    return list(zip(rows[first].tolist(), columns[first].tolist(), widths.tolist(), strict=True)), gap


def _law(law: Weibull) -> LawView:
    return LawView(scale_days=law.scale_days, shape=law.shape, mean_days=law.mean(), median_days=law.median())


@lru_cache(maxsize=64)
def _chances(longest_days: float) -> tuple[ArcChance, ...]:
    # The counts of a renewal process take a while, and the problems of a family share them.
    reach = min(longest_days, LONGEST_ARC * SAFE_MODES.mean())
    counts = (count_distribution(float(days), n_max=1) for days in np.linspace(0.0, reach, N_ARCS))
    return tuple(
        ArcChance(
            arc_days=found.arc_days,
            none=float(found.probabilities[0]),
            one=float(found.probabilities[1]),
            several=max(0.0, 1.0 - found.at_most_one),
        )
        for found in counts
    )


def _durations(problem: Problem) -> list[DurationChance]:
    asked = {outage.duration_days for outage in problem.outages}
    days = np.array(sorted(asked | set(np.linspace(0.0, LONGEST_DURATION_DAYS, N_DURATIONS).tolist())))
    return [
        DurationChance(days=float(day), at_most=float(share))
        for day, share in zip(days, duration_cdf(days), strict=True)
    ]
