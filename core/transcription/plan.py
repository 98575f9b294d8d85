"""The arcs, legs and defects of P_k as flat arrays that compiled code walks through.

Every arc runs between two moments, and every moment is linear in six time variables: (T_s, T_i, T_f) of the
reference and of the own trajectory.  Those coefficients are the table of docs/method.md, section 6; all time
derivatives follow from them.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from core.transcription.pattern import Pattern

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Time variables on which a moment can depend.
N_TIMES = 6

#: What a leg starts from: the departure, the target, a shooting node, the end of another leg.
DEPARTURE, TARGET, NODE, PARENT = range(4)

#: Fixed controls during an outage: (duration [TU], control) from its start; the rest coasts.
OutageProfile = tuple[tuple[float, tuple[float, float, float]], ...]


class Plan(NamedTuple):
    """Arcs, legs and defect blocks, in the order in which they are evaluated."""

    #: Whether the controls in z are throttle vectors, not throttles and angles, docs/method.md eq. S6.
    has_thrust_vectors: bool
    #: (n_arcs,) index of the arc's throttle in z, -1 where the control is fixed.
    arc_control: Indices
    #: (n_arcs, 3) control where it is fixed: zero on coasts.
    arc_fixed: Array
    #: (n_arcs, 2) constant part of start and end [TU past departure].
    arc_constant: Array
    #: (n_arcs, 2, 6) coefficients of start and end on the time variables.
    arc_times: Array
    #: (n_trajectories, 6) index of the time variables in z, -1 where there is none.
    times: Indices
    #: (n_legs,) each: what it starts from, the index that goes with it (of m_f, of a node's first entry, of a
    #: leg), its first arc and number of arcs, its trajectory, the node it ends on (-1: none).
    leg_start: Indices
    leg_link: Indices
    leg_first: Indices
    leg_arcs: Indices
    leg_trajectory: Indices
    leg_node: Indices
    #: (n_legs + 1,) first column of each leg in the store of partials.
    leg_columns: Indices
    #: (n_blocks,) legs whose ends are added and subtracted (-1: none), the node that is, and its sign.
    block_plus: Indices
    block_minus: Indices
    block_node: Indices
    block_sign: Array
    #: (n_blocks + 1,) first value of each block.
    block_values: Indices


@dataclass(frozen=True, eq=False)
class Structure:
    """The plan with what only Python needs: sizes and the sparsity pattern."""

    plan: Plan
    #: Length of z, nodes included.
    n_variables: int
    #: (n_nonzeros,) row and column of each entry, and its place among the values of the blocks.
    rows: Indices
    columns: Indices
    places: Indices
    #: Node of each (trajectory, boundary): index of its first entry in z.
    nodes: dict[tuple[int, int], int]
    #: Block of the matchpoint of each trajectory.
    matchpoints: tuple[int, ...]

    @cached_property
    def pattern(self) -> "Pattern":
        """Where the second derivatives of the defects stand."""
        from core.transcription.pattern import pattern_of

        return pattern_of(self.plan)

    @property
    def hessian_rows(self) -> Indices:
        """Row in z of each entry of the lower triangle of a Hessian of weighted defects."""
        return self.pattern.rows

    @property
    def hessian_columns(self) -> Indices:
        """Column in z of each of those entries."""
        return self.pattern.columns
