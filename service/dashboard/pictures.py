"""Trajectories as JSON, rounded and downsampled to what a plot can show.

Positions to a kilometre, masses to a gram, times to a second; a sample that is not finite is null.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.analysis.flight import Arc, Flight, FlownTrajectory, Path

#: Decimals by what a field is measured in.
DAYS, KM, KM_S, KG, RAD, SHARE = 5, 0, 5, 3, 4, 4
#: Samples of all trajectories in one picture; the Moon's path and the target's leave room for so many.
MOST_SAMPLES = 4000


def flight_as_json(flight: Flight, most: int = MOST_SAMPLES, has_frames: bool = True) -> dict[str, Any]:
    """Return the trajectories, the Moon's path and the target's as plain data.

    Without its frames a flight takes half the room: they follow from the paths of the Moon.
    """
    n_samples = sum(len(trajectory.days) for trajectory in flight.trajectories)
    share = min(1.0, most / n_samples)
    sent = {
        "trajectories": [_trajectory(trajectory, share) for trajectory in flight.trajectories],
        "moon": _path(flight.moon),
        "target": _path(flight.target),
        "n_samples": n_samples,
        "world": _world(flight),
    }
    return sent if has_frames else _without_frames(sent)


def _world(flight: Flight) -> dict[str, Any]:
    """Return the names of the centre and of the main body, its mean distance and its radius [km]."""
    world = flight.world
    return {
        "center": world.center.title,
        "main": flight.main,
        "length_km": world.units.lu_km,
        "main_radius_km": world.moon.radius_km if world.moon else 0.0,
    }


def _without_frames(sent: dict[str, Any]) -> dict[str, Any]:
    for track in (*sent["trajectories"], sent["moon"]):
        del track["rotating_km"], track["moon_km"]
    # The target's path may go on after the last arrival, where the Moon's ends: it keeps a Moon of its own.
    del sent["target"]["rotating_km"]
    return sent


def _trajectory(flown: FlownTrajectory, share: float) -> dict[str, Any]:
    kept = [_downsample(arc, share) for arc in flown.arcs]
    places = np.concatenate(kept)
    stops = np.cumsum([len(own) for own in kept]).tolist()
    arcs = [
        arc._replace(first=stop - len(own), stop=stop)
        for arc, own, stop in zip(flown.arcs, kept, stops, strict=True)
    ]
    return {
        "outage": flown.outage.model_dump() if flown.outage else None,
        "arcs": [_arc(arc) for arc in arcs],
        "matchpoint": next(
            new.first for new, old in zip(arcs, flown.arcs, strict=True) if old.first == flown.matchpoint
        ),
        "days": _round(flown.days[places], DAYS),
        "inertial_km": _round(flown.inertial_km[places], KM),
        "rotating_km": _round(flown.rotating_km[places], KM),
        "moon_km": _round(flown.moon_km[places], KM),
        "speed_km_s": _round(flown.speed_km_s[places], KM_S),
        "mass_kg": _round(flown.mass_kg[places], KG),
    }


def _downsample(arc: Arc, share: float) -> NDArray[np.int64]:
    """Return the samples of an arc that are shown: evenly taken, with both ends."""
    n = arc.stop - arc.first
    n_kept = min(n, max(2, int(share * n)))
    return np.asarray(np.round(np.linspace(arc.first, arc.stop - 1, n_kept)), dtype=np.int64)


def _arc(arc: Arc) -> dict[str, Any]:
    return arc._asdict() | {
        "throttle": round(arc.throttle, SHARE),
        "in_plane_rad": round(arc.in_plane_rad, RAD),
        "out_of_plane_rad": round(arc.out_of_plane_rad, RAD),
    }


def _path(path: Path) -> dict[str, Any]:
    return {
        "days": _round(path.days, DAYS),
        "inertial_km": _round(path.inertial_km, KM),
        "rotating_km": _round(path.rotating_km, KM),
        "moon_km": _round(path.moon_km, KM),
    }


def _round(values: NDArray[np.float64], decimals: int) -> list[Any]:
    rounded = np.round(values, decimals)
    finite = np.isfinite(rounded)
    nullable: NDArray[np.object_] = rounded.astype(object)
    if decimals == 0:
        # Whole numbers travel without their ".0", a quarter of the whole.
        nullable[finite] = rounded[finite].astype(int)
    # JSON has no NaN.
    nullable[~finite] = None
    plain: list[Any] = nullable.tolist()
    return plain
