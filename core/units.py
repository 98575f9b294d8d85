"""The canonical units of the Earth's world for the flagship; those of other worlds are in `core.world`.

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
