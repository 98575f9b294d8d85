"""From a verified decision vector to what the archive stores about it."""

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.analysis.metrics import total_delta_v_km_s, transfer_delta_v_km_s
from core.constants import SECONDS_PER_DAY
from core.orbits import departure_state
from core.problem import Problem, calendar_epoch
from core.transcription import layout_of
from core.verification.closest_approach import Approach
from core.verification.verify import Verification
from workers.job import Certificate, Trajectory


def certificate(verification: Verification, cpu_seconds: float) -> Certificate:
    """Return the verifier's verdict as a message."""
    return Certificate(
        paper=bool(verification.paper),
        strict=bool(verification.strict),
        defects=tuple(tuple(row) for row in verification.defects.tolist()),
        details=_details(verification),
        cpu_seconds=cpu_seconds,
    )


def _details(verification: Verification) -> dict[str, Any]:
    return {
        "integrator": verification.integrator,
        "tolerance": verification.tolerance,
        "target_error": verification.target_error.tolist(),
        "final_mass_kg": verification.final_mass_kg.tolist(),
        "arrival_epochs": [calendar_epoch(float(et)) for et in verification.arrival_et],
        "kernels": dict(verification.kernels),
        "n_evaluations": int(verification.n_evaluations),
        "is_marginal": bool(verification.is_marginal),
        "closest": [[_passage(one) for one in flown] for flown in verification.closest],
        "lowest_km": _lowest(verification),
    }


def _passage(approach: Approach) -> dict[str, Any]:
    return {
        "body": approach.body,
        "altitude_km": approach.altitude_km,
        "epoch": calendar_epoch(approach.et),
    }


def _lowest(verification: Verification) -> dict[str, float]:
    """Return the lowest altitude over each body that any trajectory comes to [km]."""
    lowest: dict[str, float] = {}
    for approach in itertools.chain.from_iterable(verification.closest):
        lowest[approach.body] = min(approach.altitude_km, lowest.get(approach.body, approach.altitude_km))
    return lowest


def trajectory(problem: Problem, x: NDArray[np.float64], verification: Verification) -> Trajectory:
    """Return the reference's masses, times and delta-v."""
    layout = layout_of(problem).reference
    shooting, initial_coast = float(x[layout.shooting_time]), float(x[layout.initial_coast])
    final_coast = float(x[layout.final_coast])
    departure_mass = departure_state(problem.departure, problem.spacecraft).mass_kg
    final_mass = float(verification.final_mass_kg[0])
    arrival_et = float(verification.arrival_et[0])
    return Trajectory(
        final_mass_kg=final_mass,
        propellant_kg=departure_mass - final_mass,
        delta_v_km_s=transfer_delta_v_km_s(problem, departure_mass, final_mass),
        delta_v_total_km_s=total_delta_v_km_s(problem, final_mass),
        shooting_days=shooting,
        initial_coast_days=initial_coast,
        final_coast_days=final_coast,
        time_of_flight_days=shooting + initial_coast + final_coast,
        insertion_epoch=calendar_epoch(arrival_et - final_coast * SECONDS_PER_DAY),
        arrival_epoch=calendar_epoch(arrival_et),
    )
