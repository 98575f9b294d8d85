"""Construction of the plan of P_k: its trajectories, divided into legs and arcs."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from core.problem import Problem
from core.transcription.layout import CONTROL, STATE, Layout, TrajectoryLayout
from core.transcription.plan import (
    DEPARTURE,
    N_TIMES,
    NODE,
    PARENT,
    TARGET,
    Indices,
    OutageProfile,
    Plan,
    Structure,
)


@dataclass(frozen=True, slots=True)
class _Moment:
    constant: float
    times: tuple[float, ...]


@dataclass(slots=True)
class _Leg:
    start: int
    link: int
    trajectory: int
    first: int
    arcs: int
    node: int = -1
    #: Variable of each column after the time columns, and whether the mass depends on it.
    variables: list[int] = field(default_factory=list)
    mass: list[bool] = field(default_factory=list)
    times_used: list[bool] = field(default_factory=lambda: [False] * N_TIMES)
    mass_times: list[bool] = field(default_factory=lambda: [False] * N_TIMES)


class _Builder:
    """Collects the arcs, legs and blocks of one problem."""

    def __init__(
        self,
        problem: Problem,
        layout: Layout,
        n_legs: int,
        profiles: tuple[OutageProfile, ...],
        has_thrust_vectors: bool,
        begin: float,
    ) -> None:
        self.has_thrust_vectors, self.begin = has_thrust_vectors, begin
        self.problem, self.layout, self.n_legs, self.profiles = problem, layout, n_legs, profiles
        self.arcs: list[tuple[int, tuple[float, ...], _Moment, _Moment]] = []
        self.legs: list[_Leg] = []
        self.blocks: list[tuple[int, int, int, float]] = []
        self.nodes: dict[tuple[int, int], int] = {}
        self.ends: dict[tuple[int, int], int] = {}
        self.matchpoints: list[int] = []
        self.n_variables = layout.n_variables

    def build(self) -> Structure:
        for index, trajectory in enumerate(self.layout.trajectories):
            self._trajectory(index, trajectory)
        return self._structure()

    def _origin(self, trajectory: TrajectoryLayout) -> _Moment:
        """Return when a trajectory begins: departure, or the start of the missed segment."""
        if trajectory.outage is None:
            return _Moment(self.begin, (0.0,) * N_TIMES)
        share = (trajectory.outage.segment - 1) / self.problem.n_segments
        return _Moment(self.begin, (share, 1.0, 0.0, 0.0, 0.0, 0.0))

    def _moment(self, trajectory: TrajectoryLayout, boundary: int, arrival: float = 0.0) -> _Moment:
        origin = self._origin(trajectory)
        own = ((boundary - 1) / trajectory.n_segments, 1.0, arrival)
        if trajectory.outage is None:
            return _Moment(origin.constant, (*own, 0.0, 0.0, 0.0))
        missed = trajectory.outage.duration_days / self.layout.units.tu_days
        return _Moment(origin.constant + missed, (*origin.times[:3], *own))

    def _trajectory(self, index: int, trajectory: TrajectoryLayout) -> None:
        nodes, breaks = self._boundaries(index, trajectory)
        for boundary in nodes:
            self.nodes[index, boundary] = self.n_variables
            self.n_variables += STATE
        match = trajectory.matchpoint
        forward = self._forward(index, trajectory, [b for b in breaks if b < match] + [match])
        backward = self._backward(index, trajectory, [b for b in reversed(breaks) if b > match] + [match])
        self.matchpoints.append(len(self.blocks))
        self.blocks.append((forward, backward, -1, 0.0))

    def _boundaries(self, index: int, trajectory: TrajectoryLayout) -> tuple[list[int], list[int]]:
        """Return the boundaries with a node, and all at which a leg ends short of the matchpoint."""
        n, lifted = trajectory.n_segments, self.n_legs > 1
        n_legs = max(2, round(self.n_legs * n / self.problem.n_segments)) if lifted else 1
        even = {round(1 + i * n / n_legs) for i in range(1, n_legs)}
        starts = {outage.segment for outage in self.problem.outages} if index == 0 else set()
        inside = {b for b in even | starts if 1 < b <= n and b != trajectory.matchpoint}
        nodes = inside if lifted else set()
        return sorted(nodes), sorted((nodes | starts) - {trajectory.matchpoint})

    def _forward(self, index: int, trajectory: TrajectoryLayout, ends: list[int]) -> int:
        leg, segment = self._first_leg(index, trajectory), 1
        for end in ends:
            for p in range(segment, end):
                start = self._moment(trajectory, p)
                self._arc(leg, trajectory.control(p), start, self._moment(trajectory, p + 1))
            segment = end
            done = self._close(leg, index, end, sign=-1.0)
            if end != ends[-1]:
                leg = self._next_leg(index, end, done)
        return done

    def _first_leg(self, index: int, trajectory: TrajectoryLayout) -> _Leg:
        start = self._moment(trajectory, 1)
        if trajectory.outage is None:
            leg = self._leg(DEPARTURE, -1, index)
            self._arc(leg, -1, self._origin(trajectory), start)
            return leg
        source = trajectory.outage.segment
        leg = self._next_leg(index, source, self.ends[0, source], of=0)
        origin = self._origin(trajectory)
        elapsed = origin.constant
        for duration, control in self._profile(index):
            end = _Moment(elapsed + duration, origin.times)
            self._arc(leg, -1, _Moment(elapsed, origin.times), end, fixed=control)
            elapsed += duration
        rest = self._profile_rest(index)
        self._arc(leg, -1, _Moment(elapsed, origin.times), start, fixed=rest)
        return leg

    def _profile(self, index: int) -> OutageProfile:
        """Return the fixed controls before the last one, which lasts until the outage's coast ends."""
        return self.profiles[index - 1][:-1] if self.profiles else ()

    def _profile_rest(self, index: int) -> tuple[float, float, float]:
        return self.profiles[index - 1][-1][1] if self.profiles else (0.0, 0.0, 0.0)

    def _backward(self, index: int, trajectory: TrajectoryLayout, ends: list[int]) -> int:
        n = trajectory.n_segments
        leg = self._leg(TARGET, trajectory.final_mass, index)
        leg.variables.append(trajectory.final_mass)
        leg.mass.append(True)
        self._arc(leg, -1, self._moment(trajectory, n + 1, 1.0), self._moment(trajectory, n + 1))
        segment = n
        for end in ends:
            for p in range(segment, end - 1, -1):
                start = self._moment(trajectory, p + 1)
                self._arc(leg, trajectory.control(p), start, self._moment(trajectory, p))
            segment = end - 1
            done = self._close(leg, index, end, sign=1.0)
            if end != ends[-1]:
                leg = self._next_leg(index, end, done)
        return done

    def _leg(self, start: int, link: int, index: int) -> _Leg:
        return _Leg(start, link, index, len(self.arcs), 0)

    def _next_leg(self, index: int, boundary: int, parent: int, of: int | None = None) -> _Leg:
        """Return a leg that starts at a boundary: from its node if it has one, else from a leg's end."""
        node = self.nodes.get((index if of is None else of, boundary))
        if node is not None:
            leg = self._leg(NODE, node, index)
            leg.variables.extend(range(node, node + STATE))
            leg.mass.extend([False] * 6 + [True])
            return leg
        leg, before = self._leg(PARENT, parent, index), self.legs[parent]
        leg.variables.extend(before.variables)
        leg.mass.extend(before.mass)
        leg.times_used, leg.mass_times = list(before.times_used), list(before.mass_times)
        return leg

    def _arc(
        self,
        leg: _Leg,
        control: int,
        start: _Moment,
        end: _Moment,
        fixed: tuple[float, ...] = (0.0, 0.0, 0.0),
    ) -> None:
        self.arcs.append((control, fixed, start, end))
        leg.arcs += 1
        if control >= 0:
            leg.variables.extend(range(control, control + CONTROL))
            leg.mass.extend([True] + 2 * [self.has_thrust_vectors])
        for slot, (a, b) in enumerate(zip(start.times, end.times, strict=True)):
            leg.times_used[slot] |= a != 0.0 or b != 0.0
            leg.mass_times[slot] |= a != b and (control >= 0 or fixed[0] != 0.0)

    def _close(self, leg: _Leg, index: int, boundary: int, sign: float) -> int:
        """Store a leg that ends at a boundary, with the defect of the node there."""
        number = len(self.legs)
        self.legs.append(leg)
        node = self.nodes.get((index, boundary))
        if node is not None:
            leg.node = node
            plus, minus = (number, -1) if sign < 0 else (-1, number)
            self.blocks.append((plus, minus, node, sign))
        # At the matchpoint both halves end: outages there start from the forward one.
        self.ends.setdefault((index, boundary), number)
        return number

    def _structure(self) -> Structure:
        rows, columns, places, offsets = [], [], [], [0]
        for block, entries in enumerate(self.blocks):
            variables, pattern = self._pattern(*entries)
            row, column = np.nonzero(pattern)
            rows.append(STATE * block + row)
            columns.append(variables[column])
            places.append(offsets[-1] + row * len(variables) + column)
            offsets.append(offsets[-1] + pattern.size)
        return Structure(
            plan=self._plan(offsets),
            n_variables=self.n_variables,
            rows=np.concatenate(rows),
            columns=np.concatenate(columns),
            places=np.concatenate(places),
            nodes=self.nodes,
            matchpoints=tuple(self.matchpoints),
        )

    def _pattern(self, plus: int, minus: int, node: int, sign: float) -> tuple[Indices, NDArray[np.bool_]]:
        """Return the variables of a block's columns, and which of its entries can be non-zero."""
        legs = [self.legs[leg] for leg in (plus, minus) if leg >= 0]
        used = np.any([leg.times_used for leg in legs], axis=0)
        mass = np.any([leg.mass_times for leg in legs], axis=0)
        variables = list(self._times(legs[0].trajectory))
        for leg in legs:
            # A leg may have no variables: without a type, its empty list would be one of floats.
            used = np.append(used, np.ones(len(leg.variables), dtype=bool))
            mass = np.append(mass, np.array(leg.mass, dtype=bool))
            variables.extend(leg.variables)
        pattern = np.vstack([np.tile(used, (6, 1)), mass & used])
        if node >= 0:
            variables.extend(range(node, node + STATE))
            pattern = np.hstack([pattern, np.eye(STATE, dtype=bool)])
        return np.array(variables), pattern

    def _times(self, index: int) -> list[int]:
        reference, own = self.layout.reference, self.layout.trajectories[index]
        listed = [reference.shooting_time, reference.initial_coast, reference.final_coast]
        if own.outage is None:
            return [*listed, -1, -1, -1]
        return [*listed, own.shooting_time, own.initial_coast, own.final_coast]

    def _plan(self, offsets: list[int]) -> Plan:
        widths = [N_TIMES + len(leg.variables) for leg in self.legs]
        return Plan(
            has_thrust_vectors=self.has_thrust_vectors,
            arc_control=np.array([arc[0] for arc in self.arcs]),
            arc_fixed=np.array([arc[1] for arc in self.arcs]),
            arc_constant=np.array([[arc[2].constant, arc[3].constant] for arc in self.arcs]),
            arc_times=np.array([[arc[2].times, arc[3].times] for arc in self.arcs]),
            times=np.array([self._times(index) for index in range(len(self.layout.trajectories))]),
            leg_start=np.array([leg.start for leg in self.legs]),
            leg_link=np.array([leg.link for leg in self.legs]),
            leg_first=np.array([leg.first for leg in self.legs]),
            leg_arcs=np.array([leg.arcs for leg in self.legs]),
            leg_trajectory=np.array([leg.trajectory for leg in self.legs]),
            leg_node=np.array([leg.node for leg in self.legs]),
            leg_columns=np.cumsum([0, *widths]),
            block_plus=np.array([block[0] for block in self.blocks]),
            block_minus=np.array([block[1] for block in self.blocks]),
            block_node=np.array([block[2] for block in self.blocks]),
            block_sign=np.array([block[3] for block in self.blocks]),
            block_values=np.array(offsets),
        )


def build_plan(
    problem: Problem,
    layout: Layout,
    n_legs: int = 1,
    profiles: tuple[OutageProfile, ...] = (),
    has_thrust_vectors: bool = False,
    begin: float = 0.0,
) -> Structure:
    """Return the plan of a problem.

    Parameters
    ----------
    problem : Problem
        The problem P_k.
    layout : Layout
        Its decision vector.
    n_legs : int
        Shooting legs of the reference, realizations in proportion; 1 is the paper's single matchpoint.
    profiles : tuple of k OutageProfile
        Fixed controls (throttle, rad, rad) held during the outages, none by default; the last control of a
        profile holds until the initial coast after the outage ends [TU].
    has_thrust_vectors : bool
        Whether z holds throttle vectors where x has throttles and angles.
    begin : float
        When the reference begins [TU past departure].
    """
    return _Builder(problem, layout, n_legs, profiles, has_thrust_vectors, begin).build()
