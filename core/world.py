"""The world of a problem: the body at the origin, those that pull besides, and its units and tolerances.

Frame: axes J2000, origin at the centre.  Units of the constants: km, s, kg.
"""

import difflib
import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from core.constants import (
    GM_EARTH,
    GM_JUPITER,
    GM_MOON,
    GM_SUN,
    LOWEST_OVER_EARTH_KM,
    LOWEST_OVER_MOON_KM,
    RADIUS_EARTH_KM,
    RADIUS_MOON_KM,
    SECONDS_PER_DAY,
)
from core.tolerances import Tolerance
from core.units import LU_KM, MU_KG, TU_S

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from core.problem import Problem


class Body(NamedTuple):
    """A point mass."""

    #: Name and number that SPICE knows it by.
    name: str
    naif_id: int
    gm_km3_s2: float
    #: A path that comes nearer to its centre has collided [km]; 0 for a barycentre of planet and moons.
    radius_km: float = 0.0
    #: How far above that a solution passes unless somebody asks for more [km].
    lowest_km: float = 0.0

    @property
    def title(self) -> str:
        """Its name as people read it."""
        return self.name.removesuffix(" BARYCENTER").title()


#: The bodies of DE440 that may be a centre or pull, by name; gravitational parameters are those of DE440.
BODIES = {
    body.name: body
    for body in (
        Body("SUN", 10, GM_SUN, 695_700.0),
        Body("MERCURY", 199, 22031.868551, 2440.53),
        Body("VENUS", 299, 324858.592, 6051.8),
        Body("VENUS BARYCENTER", 2, 324858.592),
        Body("EARTH", 399, GM_EARTH, RADIUS_EARTH_KM, LOWEST_OVER_EARTH_KM),
        Body("MOON", 301, GM_MOON, RADIUS_MOON_KM, LOWEST_OVER_MOON_KM),
        Body("EARTH BARYCENTER", 3, GM_EARTH + GM_MOON),
        Body("MARS BARYCENTER", 4, 42828.375816),
        Body("JUPITER BARYCENTER", 5, GM_JUPITER),
        Body("SATURN BARYCENTER", 6, 37940584.8418),
        Body("URANUS BARYCENTER", 7, 5794556.4),
        Body("NEPTUNE BARYCENTER", 8, 6836527.10058),
    )
}
#: What pulls in each world unless it says otherwise, besides the centre.
USUAL = {"EARTH": ("MOON", "SUN", "JUPITER BARYCENTER"), "SUN": ()}
#: Bodies that stand for others together.
_WHOLES = {"EARTH BARYCENTER": ("EARTH", "MOON"), "VENUS BARYCENTER": ("VENUS",)}
#: Most bodies that pull besides the centre: those for which a row of the force model has room.
MOST_BODIES = 3
#: Astronomical unit [km].
AU_KM = 149_597_870.7


@dataclass(frozen=True, slots=True)
class Units:
    """The canonical units of one world, in which the numerics work."""

    lu_km: float
    tu_s: float
    mu_kg: float

    @property
    def vu_km_s(self) -> float:
        """Velocity unit [km/s]."""
        return self.lu_km / self.tu_s

    @property
    def tu_days(self) -> float:
        """Time unit [days]."""
        return self.tu_s / SECONDS_PER_DAY

    @property
    def state(self) -> "NDArray[np.float64]":
        """Units of a state (7,): km, km/s, kg per canonical unit."""
        # Imported here: to read a problem needs no arrays.
        import numpy as np

        return np.array([self.lu_km] * 3 + [self.vu_km_s] * 3 + [self.mu_kg])

    def gm(self, gm_km3_s2: float) -> float:
        """Return a gravitational parameter given in km^3/s^2 in LU^3/TU^2."""
        return gm_km3_s2 * self.tu_s**2 / self.lu_km**3

    def thrust(self, thrust_n: float) -> float:
        """Return a thrust given in newtons in MU LU/TU^2."""
        return thrust_n * 1e-3 * self.tu_s**2 / (self.mu_kg * self.lu_km)

    def exhaust_velocity(self, isp_s: float, g0: float) -> float:
        """Return the exhaust velocity isp g0 in LU/TU for isp in s and g0 in m/s^2."""
        return isp_s * g0 * 1e-3 / self.vu_km_s


#: Lengths and times of each world's units [km, s]; the Sun's GM is 1.
_SCALES = {"EARTH": (LU_KM, TU_S), "SUN": (AU_KM, math.sqrt(AU_KM**3 / GM_SUN))}
#: Bounds of position and velocity of the loose and the strict tolerance [km, km/s].  About the Sun 0.1 km is
#: less than the doubt of a thousand days of flight.
_LOOSE, _STRICT = {"EARTH": (1.0, 0.1), "SUN": (1e3, 0.1)}, {"EARTH": (0.1, 1e-4), "SUN": (10.0, 1e-4)}
#: Bounds of the mass at the flagship's wet mass, `MU_KG`; others in proportion [kg].
_LOOSE_KG, _STRICT_KG = 1.0, 0.01


@dataclass(frozen=True, slots=True)
class World:
    """What a problem flies in."""

    center: Body
    #: Those that pull besides; the Moon is the first where it is one of them.
    bodies: tuple[Body, ...]
    units: Units
    loose: Tolerance
    strict: Tolerance
    #: Where the bodies are, if not where DE440 has them, and the digest of its content.
    kernel: Path | None = None
    digest: str | None = None

    @property
    def near(self) -> Body:
        """What the target's table is relative to: the first of the bodies, or the centre without any."""
        return self.bodies[0] if self.bodies else self.center

    @property
    def moon(self) -> Body | None:
        """The Moon, where it is one of the bodies."""
        return next((body for body in self.bodies if body.name == "MOON"), None)

    @property
    def all_gm_km3_s2(self) -> list[float]:
        """Gravitational parameters of the centre and of the bodies [km^3/s^2]."""
        return [body.gm_km3_s2 for body in (self.center, *self.bodies)]

    @property
    def solid(self) -> tuple[Body, ...]:
        """The bodies that a path may hit."""
        return tuple(body for body in (self.center, *self.bodies) if body.radius_km > 0.0)


class WorldFields(BaseModel):
    """The table `world` of a problem: which body is the origin, and which others pull."""

    model_config = ConfigDict(defer_build=True, frozen=True, extra="forbid", allow_inf_nan=False)

    center: Literal["EARTH", "SUN"] = "EARTH"
    #: SPICE names; the usual ones of the centre if None.
    bodies: Annotated[tuple[str, ...], Field(max_length=MOST_BODIES)] | None = None
    #: Gravitational parameters of the centre and of the bodies, if not those of DE440 [km^3/s^2].
    gm_km3_s2: tuple[Annotated[float, Field(gt=0)], ...] | None = None
    #: An SPK with the places of the bodies relative to the centre, if not DE440.
    kernel: Path | None = None
    #: Digest of its content, blake2b-128; filled in by `core.problem.problem_from`.
    digest: Annotated[str, Field(pattern="^[0-9a-f]{32}$")] | None = None

    @model_validator(mode="after")
    def _known(self) -> Self:
        names = self.names
        if unknown := [name for name in names if name not in BODIES]:
            near = _near_names(unknown[0])
            meant = f"; did you mean {' or '.join(near)}?" if near else ""
            raise ValueError(f"bodies: expected some of {', '.join(BODIES)}, got {', '.join(unknown)}{meant}")
        seen: dict[str, str] = {self.center: "the centre"}
        for name in names:
            if name in seen:
                raise ValueError(
                    f"bodies: expected each once, and not the centre, got {name}, which is {seen[name]}; "
                    f"leave it out"
                )
            seen[name] = "there already"
        for whole, parts in _WHOLES.items():
            if whole in seen and (both := [part for part in parts if part in seen]):
                raise ValueError(
                    f"bodies: expected a planet apart or with its moons, got {whole} and {both[0]}, so that "
                    f"it would pull twice; leave out one of them"
                )
        if self.kernel is not None and not names:
            raise ValueError(
                "kernel: expected bodies whose places it gives, got none; name them, or leave the kernel out"
            )
        if self.kernel is None and self.digest is not None:
            raise ValueError("digest: expected none without a kernel, got one; leave it out")
        if self.gm_km3_s2 is not None and len(self.gm_km3_s2) != 1 + len(names):
            raise ValueError(
                f"gm_km3_s2: expected {1 + len(names)} numbers, the centre's first, got "
                f"{len(self.gm_km3_s2)}; give one for each of {', '.join((self.center, *names))}"
            )
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies that pull besides the centre."""
        return USUAL[self.center] if self.bodies is None else self.bodies


def _near_names(unknown: str) -> list[str]:
    """Return the bodies that somebody may have meant, the likeliest first."""
    word = unknown.upper().strip()
    begin = [name for name in BODIES if word and name.startswith(word)]
    return begin or difflib.get_close_matches(word, BODIES, n=1)


def absent_if_usual(fields: WorldFields | None) -> WorldFields | None:
    """Return None for the Earth's usual world, so that it has one hash however it is written."""
    said = fields and (fields.center, fields.names, fields.gm_km3_s2, fields.kernel)
    if said is None or said == ("EARTH", USUAL["EARTH"], None, None):
        return None
    return fields


def world_of(problem: "Problem") -> World:
    """Return the world of a problem."""
    return _world(problem.world, problem.spacecraft.wet_mass_kg)


def world_from(definition: Mapping[str, Any]) -> World:
    """Return the world of a problem that is plain data, without making the problem."""
    fields = definition.get("world")
    world = None if fields is None else WorldFields.model_validate(fields)
    return _world(world, definition["spacecraft"]["wet_mass_kg"])


@functools.lru_cache(maxsize=256)
def _world(fields: WorldFields | None, wet_mass_kg: float) -> World:
    fields = fields or WorldFields()
    center, *bodies = (BODIES[name] for name in (fields.center, *fields.names))
    if fields.gm_km3_s2 is not None:
        center, *bodies = (
            body._replace(gm_km3_s2=gm) for body, gm in zip((center, *bodies), fields.gm_km3_s2, strict=True)
        )
    # Where the Sun is not the centre it is too far away to be hit.
    bodies = [body._replace(radius_km=0.0) if body.name == "SUN" else body for body in bodies]
    share = wet_mass_kg / MU_KG
    return World(
        center=center,
        bodies=tuple(sorted(bodies, key=lambda body: body.name != "MOON")),
        units=Units(*_SCALES[fields.center], wet_mass_kg),
        loose=Tolerance(*_LOOSE[fields.center], _LOOSE_KG * share),
        strict=Tolerance(*_STRICT[fields.center], _STRICT_KG * share),
        kernel=fields.kernel,
        digest=fields.digest,
    )


#: The Earth's with the flagship's mass.
EARTH = _world(None, MU_KG)
