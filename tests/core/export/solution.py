"""A known robust solution, exported once for all tests of formats, and flown by SciPy and SPICE."""

import json
from functools import cache
from pathlib import Path

import numpy as np

from core.constants import G0
from core.export import export_states
from core.orbits import target_kernel
from core.problem import load_problem
from core.verification.repropagation import COAST, Pilot

_VECTORS = Path(__file__).parents[2] / "acceptance" / "vectors.json"
PROBLEM = load_problem("ppe-drm3").with_outages([(24, 1.0)])


@cache
def vector():
    return np.array(json.loads(_VECTORS.read_text(encoding="utf-8"))["S(1|0)"][1])


@cache
def trajectories():
    return export_states(PROBLEM, vector())


def flown_between_samples(trajectory, pilot_states):
    """Yield (epoch, state) inside every arc, at the middle of its longest step, by SciPy and SPICE.

    Each half is flown without a stop from its end: the departure, or the target at arrival.
    """
    pilot = _pilot(trajectory)
    meet = next(i for i, arc in enumerate(trajectory.arcs) if arc.et[0] >= trajectory.matchpoint_et - 1e-3)
    forward, backward = trajectory.arcs[:meet], trajectory.arcs[meet:][::-1]
    for half, state in zip((forward, backward), pilot_states, strict=True):
        for arc in half:
            ends = (arc.et[0], arc.et[-1]) if half is forward else (arc.et[-1], arc.et[0])
            begin, end = (et - trajectory.start_et for et in ends)
            thrust = _thrust(pilot, arc)
            longest = int(np.argmax(np.diff(arc.et)))
            middle = 0.5 * (arc.et[longest] + arc.et[longest + 1])
            yield middle, pilot.arc(begin, state, middle - trajectory.start_et - begin, thrust)
            state = pilot.arc(begin, state, end - begin, thrust)


def flown_from_samples(trajectory, arc, numbers):
    """Yield (epoch, state) in the middle between some samples and those after them, flown from the former."""
    pilot = _pilot(trajectory)
    for number in sorted(set(numbers)):
        begin, end = arc.et[number : number + 2] - trajectory.start_et
        flown = pilot.arc(begin, arc.states[number], 0.5 * (end - begin), _thrust(pilot, arc))
        yield 0.5 * (arc.et[number] + arc.et[number + 1]), flown


def _pilot(trajectory):
    craft = PROBLEM.spacecraft
    return Pilot(trajectory.start_et, craft.max_thrust_n, craft.isp_s * G0 * 1e-3)


def _thrust(pilot, arc):
    return (
        pilot.thrust(np.array([arc.throttle, arc.in_plane_rad, arc.out_of_plane_rad]))
        if arc.throttle
        else COAST
    )


def ends_of(trajectory):
    """Return the states at the departure and on the target at arrival, where the two halves begin."""
    departure = PROBLEM.departure
    start = np.array([*departure.position_km, *departure.velocity_km_s, departure.mass_kg])
    pilot = Pilot(trajectory.start_et, 1.0, 1.0)
    on_target = pilot.target_state(target_kernel(PROBLEM)[1], trajectory.stop_et - trajectory.start_et)
    return start, np.append(on_target, trajectory.arcs[-1].states[-1, 6])
