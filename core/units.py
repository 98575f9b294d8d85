"""The canonical units of the numerics, and the only place where units are converted.

Lengths in LU, times in TU, velocities in VU = LU/TU, masses in MU.  With these GM_EARTH + GM_MOON is 1
to 1e-8.  Public functions speak km, km/s, kg and days; everything inside speaks canonical units.
"""

from core.constants import SECONDS_PER_DAY

#: Length unit [km].
LU_KM = 384400.0
#: Time unit [s]; see docs/method.md, section 1.
TU_S = 375190.25852
#: Velocity unit [km/s].
VU_KM_S = LU_KM / TU_S
#: Mass unit [kg].
MU_KG = 15000.0
#: Time unit [days].
TU_DAYS = TU_S / SECONDS_PER_DAY


def gm_canonical(gm_km3_s2: float) -> float:
    """Return a gravitational parameter given in km^3/s^2 in LU^3/TU^2."""
    return gm_km3_s2 * TU_S**2 / LU_KM**3


def thrust_canonical(thrust_n: float) -> float:
    """Return a thrust given in newtons in MU LU/TU^2."""
    return thrust_n * 1e-3 * TU_S**2 / (MU_KG * LU_KM)


def exhaust_velocity_canonical(isp_s: float, g0: float) -> float:
    """Return the exhaust velocity isp g0 in LU/TU for isp in s and g0 in m/s^2."""
    return isp_s * g0 * 1e-3 / VU_KM_S
