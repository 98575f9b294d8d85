"""What a certificate looks like, as an example for the OpenAPI document."""

from typing import Any

from pydantic import BaseModel

from service.schemas.examples import AT, LATER, OUTAGE, ROBUST, SOLUTION
from workers.certify import CertificateDocument

_EARTH = {
    "body": "Earth",
    "distance_km": 163214.97,
    "altitude_km": 156836.83,
    "epoch": "2026-04-26T17:42:25.318",
    "days": 0.1211,
    "is_turn": True,
}
_MOON = _EARTH | {
    "body": "Moon",
    "distance_km": 3332.72,
    "altitude_km": 1595.32,
    "epoch": "2026-08-06T13:08:02.101",
    "days": 101.9306,
}
_REFERENCE = {
    "name": "reference",
    "outage_segment": None,
    "outage_days": None,
    "arrival_epoch": "2026-08-09T12:37:23.504",
    "defect": [0.0017, -0.0009, 0.0006, 1.1e-8, -2.3e-8, 5.1e-9, 0.0],
    "position_km": 0.00208,
    "velocity_km_s": 2.6e-8,
    "mass_kg": 0.0,
    "closest": [_EARTH, _MOON],
    "through": {
        "insertion_miss": [0.0405, 2.03e-7],
        "arrival_miss": [0.1391, 6.38e-7],
        "mass_miss_kg": 0.0,
        "closest": [_EARTH, _MOON],
        "failure": "",
    },
    "mass": {
        "wet": 15000.0,
        "spiral": 1723.96,
        "departure": 13276.04,
        "before_outage": 0.0,
        "coasts": 0.0,
        "segments": 176.21,
        "arrival": 13099.83,
        "stated_arrival": 13099.83,
        "spare": 8099.83,
    },
}
_REALIZATION = _REFERENCE | {
    "name": "realization 1",
    "outage_segment": OUTAGE["segment"],
    "outage_days": OUTAGE["duration_days"],
}
_CONTENT = {
    "certificate_version": 1,
    "solution_id": SOLUTION,
    "problem_hash": ROBUST,
    "k": 1,
    "level": "strict",
    "is_sound": True,
    "min_altitude_km": 100.0,
    "marks": [],
    "failure": "",
    "trajectories": [_REFERENCE, _REALIZATION],
    "frame": "geocentric, axes J2000 (ICRF)",
    "time_scale": "TDB",
    "integrator": {
        "name": "scipy.integrate.DOP853",
        "relative_tolerance": 1e-13,
        "absolute_tolerance": [1e-7, 1e-7, 1e-7, 1e-13, 1e-13, 1e-13],
        "n_evaluations": 48210,
    },
    "constants": {"GM_EARTH": 398600.43550702266, "G0": 9.806},
    "kernels": {"de440.bsp": "c9d581bfd84209dbeee8b1583939b148"},
    "code_version": "0.1.0+9f3c2a1b7d5e",
    "python_version": "3.11.7",
    "package_versions": {"numpy": "2.3.4", "scipy": "1.16.3"},
    "machine": "x86_64, Linux",
}
EXAMPLES: dict[type[BaseModel], Any] = {
    CertificateDocument: {
        "content": _CONTENT,
        "hash": "5d0c8e1f2a7b4963b8e6d1c0f9a35742",
        "made_at": AT,
        "made_on": "node-3 (x86_64, Linux)",
        "cpu_seconds": 2.4,
        "checked_at": LATER,
    },
}
