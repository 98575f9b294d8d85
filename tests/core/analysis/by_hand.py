"""Transfers whose decision vector is exact by construction, because they are flown before it is written.

A list of arcs is integrated forwards by another method (LSODA) with the accelerations written in another
form; the target is then an SPK of the coasts that the flights ended on.  Units: km, km/s, kg, days.
"""

from typing import NamedTuple

import numpy as np
import spiceypy
from scipy.integrate import solve_ivp

from core.ephemeris.kernels import furnish
from core.epochs import seconds_past_j2000
from core.problem import load_problem, problem_from

PRESET = load_problem("ppe-drm3")
ORIGIN_ET = seconds_past_j2000(PRESET.departure.epoch)
START = np.array([*PRESET.departure.position_km, *PRESET.departure.velocity_km_s, PRESET.departure.mass_kg])
TARGET_ID = -77077
GM = {399: 398600.43550702266, 301: 4902.8001184575496, 10: 132712440041.27942, 5: 1.26712764e8}


class Arc(NamedTuple):
    days: float
    throttle: float = 0.0
    azimuth: float = 0.0
    elevation: float = 0.0


def rates(t, y, arc):
    """Attractions of all bodies on the craft, minus their attractions on the Earth."""
    total = -GM[399] * y[:3] / np.linalg.norm(y[:3]) ** 3
    for body in (301, 10, 5):
        at, _ = spiceypy.spkezp(body, ORIGIN_ET + t, "J2000", "NONE", 399)
        total += GM[body] * ((at - y[:3]) / np.linalg.norm(at - y[:3]) ** 3 - at / np.linalg.norm(at) ** 3)
    in_plane = np.array([np.cos(arc.azimuth), np.sin(arc.azimuth), 0.0])
    direction = np.cos(arc.elevation) * in_plane + np.sin(arc.elevation) * np.array([0.0, 0.0, 1.0])
    thrust = arc.throttle * 3.0e-3
    return np.concatenate([y[3:6], total + thrust * direction / y[6], [-thrust / (2708.0 * 9.806e-3)]])


def fly(days, state, arcs):
    """Return the states after each arc, and the epochs in days past departure."""
    furnish()
    states, epochs = [np.asarray(state)], [days]
    for arc in arcs:
        stop = epochs[-1] + arc.days
        span = (epochs[-1] * 86400, stop * 86400)
        if arc.days:
            flown = solve_ivp(rates, span, states[-1], "LSODA", args=(arc,), rtol=1e-12, atol=1e-10)
            states.append(flown.y[:, -1])
        else:
            states.append(states[-1])
        epochs.append(stop)
    return states, epochs


def write_target(path, ends):
    """Write the coasts through each (days, state), from 0.8 days before to 0.1 after, as one SPK."""
    handle = spiceypy.spkopn(str(path), "by hand", 0)
    for days, state in ends:
        before, after = (coasted(days, state, days + reach) for reach in (-0.8, 0.1))
        times = np.concatenate([before[0][::-1], after[0][1:]])
        rows = np.ascontiguousarray(np.concatenate([before[1][::-1], after[1][1:]]))
        span = (times[0], times[-1])
        spiceypy.spkw13(handle, TARGET_ID, 399, "J2000", *span, "coast", 7, len(times), rows, times)
    spiceypy.spkcls(handle)


def coasted(days, state, stop):
    """Return epochs [TDB s past J2000] and states (n, 6) of a coast, in the order flown."""
    times = 86400 * np.linspace(days, stop, 801)
    span = (times[0], times[-1])
    flown = solve_ivp(rates, span, state, "LSODA", times, args=(Arc(0),), rtol=1e-12, atol=1e-10)
    return ORIGIN_ET + flown.t, flown.y[:6].T


def problem_with(path, n_segments, outages, **changes):
    target = {"kind": "spk", "path": str(path), "naif_id": TARGET_ID}
    listed = [{"segment": segment, "duration_days": duration} for segment, duration in outages]
    fields = {"preset": "ppe-drm3", "n_segments": n_segments, "outages": listed, "target": target}
    return problem_from(fields | changes)


def vector(shooting, initial, final, segments, final_mass):
    controls = [number for arc in segments for number in arc[1:]]
    return np.array([shooting, initial, final, *controls, final_mass])


SEGMENTS = [
    Arc(1.5, 0.9, 0.3, 0.1),
    Arc(1.5, 0.0, 0.7, 0.2),
    Arc(1.5, 0.6, -1.2, 0.4),
    Arc(1.5, 1.0, 2.5, -0.3),
    Arc(1.5, 0.4, -2.9, -0.6),
    Arc(1.5, 0.8, 1.1, 0.5),
]
#: Recoveries after outages of 0.5 days at segments 2 (in the forward half) and 5 (in the backward half).
EARLY = [Arc(1.2, 0.7, 1.9, 0.2), Arc(1.2, 0.3, -0.4, 0.1), Arc(1.2, 1.0, 0.6, -0.8), Arc(1.2, 0.5, 3.0, 0.3)]
LATE = [Arc(1.0, 0.9, -2.0, 0.7)]


def known_transfer(path):
    """Return a P_2 and its exact x: initial coasts 2, 0.25 and 0 days, final ones 0.5, 0.25 and 0.75 days."""
    reference, epochs = fly(0.0, START, [Arc(2.0), *SEGMENTS, Arc(0.5)])
    early, early_epochs = fly(epochs[2], reference[2], [Arc(0.5), Arc(0.25), *EARLY, Arc(0.25)])
    late, late_epochs = fly(epochs[5], reference[5], [Arc(0.5), *LATE, Arc(0.75)])
    ends = [(epochs[-1], reference[-1]), (early_epochs[-1], early[-1]), (late_epochs[-1], late[-1])]
    write_target(path, ends)
    x = np.concatenate(
        [
            vector(9.0, 2.0, 0.5, SEGMENTS, reference[-1][6]),
            vector(4.8, 0.25, 0.25, EARLY, early[-1][6]),
            vector(1.0, 0.0, 0.75, LATE, late[-1][6]),
        ]
    )
    return problem_with(path, 6, [(2, 0.5), (5, 0.5)]), x
