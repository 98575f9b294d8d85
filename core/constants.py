"""Physical constants that define the problems, and the span of the planetary kernel.

Gravitational parameters are those of DE440; a test compares them with the values that DE440 carries.
Units: km, s, kg.
"""

#: Gravitational parameters [km^3/s^2].
GM_EARTH = 398600.43550702266
GM_MOON = 4902.8001184575496
GM_SUN = 132712440041.27942
GM_JUPITER = 126712764.1

#: Mean equatorial radii [km]; a trajectory below one of them has collided.
RADIUS_EARTH_KM = 6378.137
RADIUS_MOON_KM = 1737.4

#: Least altitudes [km] of a solution unless other values are given: above the atmosphere, and above the
#: mountains and what a flight is off by.
LOWEST_OVER_EARTH_KM = 200.0
LOWEST_OVER_MOON_KM = 100.0

#: Standard gravity of the paper [m/s^2]; 9.80665 would be another problem.
G0 = 9.806

#: Mass parameter of the Earth-Moon CR3BP, used only to start the NRHO correction.
MU_CR3BP = 0.01215058560962404

#: Coverage of DE440 [TDB seconds past J2000]: 1549-12-31 to 2650-01-25.
KERNEL_SPAN = (-14200747200.0, 20514081600.0)

#: MD5 of the planetary kernel de440.bsp as NAIF publishes it; part of every problem's identity.
KERNEL_MD5 = "c9d581bfd84209dbeee8b1583939b148"

SECONDS_PER_DAY = 86400.0
