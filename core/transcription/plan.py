"""The arcs, legs and defects of P_k as flat arrays for compiled code, and their sparsity.

Every arc runs between two moments, and every moment is linear in six time variables: (T_s, T_i, T_f) of the
reference and of the own trajectory.  Those coefficients are the table of docs/method.md, section 6; all time
derivatives follow from them.

Sparsity of second derivatives: each leg has a square matrix over its start state (7), the six times, what its
children carry, and the controls of its arcs from the last to the first.  A child is a leg that starts where
this one ends: it leaves its own matrix to its parent, in whose matrix its times and controls are the carried
variables.  Only the lower triangles count, apart from the first seven rows and columns, which are whole.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.transcription.layout import CONTROL, STATE

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
    """The plan with sizes and the sparsity pattern, which only Python uses."""

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
        return pattern_of(self.plan)

    @property
    def hessian_rows(self) -> Indices:
        """Row in z of each entry of the lower triangle of a Hessian of weighted defects."""
        return self.pattern.rows

    @property
    def hessian_columns(self) -> Indices:
        """Column in z of each of those entries."""
        return self.pattern.columns


Mask = NDArray[np.bool_]

#: First local variable after the start state and the times.
FIRST = STATE + N_TIMES


class Pattern(NamedTuple):
    """Matrices of the legs, and the entries of the Hessian of the defects that they add to."""

    #: (n_groups + 1,) first leg of each group: the runs of legs that parents and children do not leave.
    groups: Indices
    #: (n_legs,) each: size of a leg's matrix, its place in the store, number of carried variables.
    size: Indices
    store: Indices
    carried: Indices
    #: (n_legs,) of a child: the first of its variables that is carried, and where it stands at the parent's.
    shared: Indices
    into: Indices
    #: (n_legs + 1,) first place of each leg; the value that each entry of a triangle adds to, -1: none.
    first_place: Indices
    places: Indices
    #: (n_nonzeros,) row and column in z: the lower triangle.
    rows: Indices
    columns: Indices


def pattern_of(plan: Plan) -> Pattern:
    """Return the sparsity pattern of the second derivatives of a plan's defects, the same for all z."""
    return _Legs(plan).pattern()


class _Legs:
    """Collects variables and non-zeros of the legs from the last child to the first parent."""

    def __init__(self, plan: Plan) -> None:
        n: int = len(plan.leg_start)
        self.plan = plan
        self.variables: list[Indices] = [np.empty(0, np.int64)] * n
        self.masks: list[Mask] = [np.empty((0, 0), bool)] * n
        self.carried, self.shared, self.into = np.zeros(n, int), np.zeros(n, int), np.full(n, -1)
        children: list[list[int]] = [[] for _ in range(n)]
        for child in np.flatnonzero(plan.leg_start == PARENT):
            children[plan.leg_link[child]].append(int(child))
        for leg in range(n - 1, -1, -1):
            self._grow(leg, children[leg])

    def _grow(self, leg: int, children: list[int]) -> None:
        """Write variables and mask of a leg whose children have theirs."""
        plan, at = self.plan, FIRST
        parts = [self._start(leg), plan.times[plan.leg_trajectory[leg]]]
        arcs = plan.leg_first[leg] + np.arange(plan.leg_arcs[leg])
        active = [parts[0] >= 0, np.any(plan.arc_times[arcs] != 0.0, axis=(0, 1))]
        for child in children:
            is_same = plan.leg_trajectory[child] == plan.leg_trajectory[leg]
            self.shared[child], self.into[child] = FIRST if is_same else FIRST - 3, at
            parts.append(self.variables[child][self.shared[child] :])
            active.append(self._has(child)[self.shared[child] :])
            active[1] |= self._has(child)[STATE:FIRST] & (np.arange(STATE, FIRST) < self.shared[child])
            at += len(parts[-1])
        self.carried[leg] = at - FIRST
        for control in plan.arc_control[arcs][::-1]:
            if control >= 0:
                parts.append(control + np.arange(CONTROL))
                active.append(np.ones(CONTROL, bool))
        variables, used = np.concatenate(parts), np.concatenate(active)
        used &= variables >= 0
        self.variables[leg], self.masks[leg] = variables, np.outer(used, used)
        self._separate(leg, children)

    def _has(self, leg: int) -> Mask:
        """Return which of a leg's variables there are."""
        return np.diag(self.masks[leg])

    def _start(self, leg: int) -> Indices:
        kind, link = self.plan.leg_start[leg], self.plan.leg_link[leg]
        if kind == NODE:
            return np.asarray(link + np.arange(STATE))
        start = np.full(STATE, -1)
        if kind == TARGET:
            start[STATE - 1] = link
        return start

    def _separate(self, leg: int, children: list[int]) -> None:
        """Remove what two children do not share, and what a child does not have."""
        mask, stop = self.masks[leg], FIRST + self.carried[leg]
        mask[FIRST:stop, FIRST:stop] = False
        for child in children:
            own = self.masks[child][self.shared[child] :, self.shared[child] :]
            at = slice(self.into[child], self.into[child] + len(own))
            mask[at, at] = own

    def _groups(self) -> Indices:
        """Return the first leg of each group, and the number of legs."""
        n = len(self.masks)
        reach = np.arange(n)
        for leg in np.flatnonzero(self.plan.leg_start == PARENT):
            reach[self.plan.leg_link[leg]] = max(reach[self.plan.leg_link[leg]], leg)
        reach = np.maximum.accumulate(reach)
        return np.array([0, *(leg + 1 for leg in range(n) if reach[leg] == leg)])

    def _store(self, sizes: Indices, groups: Indices) -> Indices:
        store = np.zeros(len(sizes), int)
        for first, stop in pairwise(groups):
            store[first + 1 : stop] = np.cumsum(sizes[first : stop - 1] ** 2)
        return store

    def pattern(self) -> Pattern:
        sizes, groups = np.array([len(own) for own in self.variables]), self._groups()
        entries = [self._entries(leg) for leg in range(len(sizes))]
        known, places = np.unique(np.concatenate(entries), return_inverse=True)
        n = self._n_variables()
        # The first of the sorted entries is -1: what adds to nothing.
        has_none = int(known[0] < 0)
        known = known[has_none:]
        return Pattern(
            groups=groups,
            size=sizes,
            store=self._store(sizes, groups),
            carried=self.carried,
            shared=self.shared,
            into=self.into,
            first_place=np.cumsum([0, *(len(own) for own in entries)]),
            places=places - has_none,
            rows=known // n,
            columns=known % n,
        )

    def _n_variables(self) -> int:
        return 1 + max(int(own.max()) for own in self.variables)

    def _entries(self, leg: int) -> Indices:
        """Return n row + column of the entries of a lower triangle, -1: none; nothing for a child."""
        if self.plan.leg_start[leg] == PARENT:
            return np.empty(0, np.int64)
        variables, mask = self.variables[leg], self.masks[leg]
        i, j = np.tril_indices(len(variables))
        row, column = np.maximum(variables[i], variables[j]), np.minimum(variables[i], variables[j])
        return np.where(mask[i, j], row * self._n_variables() + column, -1)
