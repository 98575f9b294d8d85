"""The propagation of an evaluation without its assembly, and the cost of its body positions."""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.dynamics import ForceModel, no_trail
from core.dynamics.force import FIELD_WIDTH, field_at
from core.ephemeris import EphemerisTable
from core.jit import compiled
from core.transcription import Transcription
from core.transcription.evaluate import _fly_arc, _moment, _start_state
from core.transcription.plan import Plan

Array = NDArray[np.float64]
_CALLS = 20000


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """All arcs of a plan at one point."""

    #: (n_arcs, 7) states at which they begin [LU, VU, MU].
    starts: Array
    #: (n_arcs, 2) when they begin and end [TU past departure].
    moments: Array
    #: (n_arcs, 3) controls [-, rad, rad].
    controls: Array
    #: Accepted steps.
    steps: int

    @property
    def ephemeris_calls(self) -> int:
        """Evaluations of body positions: one at the start of an arc, twelve in an accepted step."""
        return len(self.starts) + 12 * self.steps


def flight(transcription: Transcription, z: Array, width: int) -> Flight:
    """Fly all arcs of the lifted form with that many columns."""
    plan, setting = transcription.lifted.plan, transcription.setting
    n_arcs = len(plan.arc_control)
    starts, moments = np.empty((n_arcs, 7)), np.empty((n_arcs, 2))
    steps = _fly(
        setting.model,
        setting.target,
        setting.departure,
        plan,
        z,
        transcription.tolerance,
        width,
        starts,
        moments,
    )
    free = np.where(plan.arc_control < 0, 0, plan.arc_control)
    controls = np.where(plan.arc_control[:, None] < 0, plan.arc_fixed, z[free[:, None] + np.arange(3)])
    return Flight(starts, moments, controls, steps)


@compiled
def _fly(
    model: ForceModel,
    target: EphemerisTable,
    departure: Array,
    plan: Plan,
    z: Array,
    tolerance: float,
    width: int,
    starts: Array,
    moments: Array,
) -> int:
    ends = np.zeros((plan.leg_start.shape[0], 7))
    r, v, work = np.zeros((3, width)), np.zeros((3, width)), np.zeros((16, 3, width))
    accelerations, thrust, d_thrust, d_rate = np.zeros((2, 3)), np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    transition, by_control, rates = np.zeros((7, 7)), np.zeros((7, 3)), np.zeros((2, 7))
    d_start, trail = np.zeros(7), no_trail()
    steps = 0
    for leg in range(plan.leg_start.shape[0]):
        _start_state(model, target, departure, plan, z, leg, ends, d_start)
        for arc in range(plan.leg_first[leg], plan.leg_first[leg] + plan.leg_arcs[leg]):
            starts[arc] = ends[leg]
            for end in range(2):
                moments[arc, end] = _moment(plan, arc, end, plan.leg_trajectory[leg], z)
            steps += _fly_arc(
                model, plan, z, arc, plan.leg_trajectory[leg], tolerance, ends[leg], r, v, work,
                accelerations, thrust, d_thrust, d_rate, transition, by_control, rates, trail,
            )  # fmt: skip
    return steps


def ephemeris_nanoseconds(transcription: Transcription) -> float:
    """Return the CPU time of one evaluation of the body positions [ns]."""
    field = transcription.setting.model.field
    arguments = (field.start, field.record, field.coefficients, np.empty(FIELD_WIDTH))
    spent = []
    for _ in range(6):
        begin = time.thread_time()
        _ask(*arguments)
        spent.append(time.thread_time() - begin)
    return 1e9 * min(spent) / _CALLS


@compiled
def _ask(start: float, record: float, coefficients: Array, out: Array) -> float:
    total = 0.0
    for n in range(_CALLS):
        field_at(start, record, coefficients, start + (5.0 + 1e-4 * n) * record, out)
        total += out[0]
    return total
