"""The certificate of a solution as a document: what an independent verification found, and with what.

`content` is the same for the same solution on the same machine with the same packages, and `hash` is its
hash; who made the document and when stands beside it.  Lengths are km, speeds km/s, masses kg; the frame is
geocentric J2000, epochs are TDB.  docs/verification.md explains every field.
"""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field

from workers.messages import Message

#: Grows with every change of what a certificate says.
CERTIFICATE_VERSION = 2

Pair = tuple[float | None, float | None]


class CertifiedApproach(Message):
    """The closest approach of a trajectory to a body."""

    body: str
    #: From the centre, and above the mean equatorial radius.
    distance_km: float
    altitude_km: float
    epoch: str
    #: The same epoch, counted from the departure.
    days: float
    #: Whether the range rate is zero there; else the flight, or a half of it, begins or ends there.
    is_turn: bool


class CertifiedThrough(Message):
    """End-to-end propagation of a trajectory: from departure to target, no matchpoint, nothing corrected."""

    #: Distance and relative speed [km, km/s] between it and the target when the last segment ends, and at
    #: arrival; None where it was not flown so far.
    insertion_miss: Pair
    arrival_miss: Pair
    #: Its mass at arrival minus the one of the decision vector.
    mass_miss_kg: float | None
    closest: tuple[CertifiedApproach, ...]
    #: Why it could not be flown, empty if it was.
    failure: str


class CertifiedMass(Message):
    """Where the mass of a trajectory goes [kg]; coasts and outages use nothing."""

    wet: float
    spiral: float
    departure: float
    #: Used by the reference before the outage, on the coasts and the outage, and in its own segments.
    before_outage: float
    coasts: float
    segments: float
    #: By the flight, and by the decision vector.
    arrival: float
    stated_arrival: float
    #: Above the dry mass.
    spare: float


class CertifiedTrajectory(Message):
    """The reference or one realization."""

    name: str
    outage_segment: int | None
    outage_days: float | None
    arrival_epoch: str
    #: Forward minus backward at the matchpoint: position, velocity, mass; None where it was not flown.
    defect: tuple[float | None, ...]
    position_km: float | None
    velocity_km_s: float | None
    mass_kg: float | None
    #: Of the halves, which are the trajectory as planned.
    closest: tuple[CertifiedApproach, ...]
    through: CertifiedThrough
    mass: CertifiedMass


class CertifiedIntegrator(Message):
    """What the arcs were integrated with."""

    name: str
    relative_tolerance: float
    #: Per component (x, y, z, vx, vy, vz) [km, km/s].
    absolute_tolerance: tuple[float, ...]
    n_evaluations: int


class CertifiedThirdTrajectory(Message):
    """The reference or one realization, propagated end to end by a third integrator."""

    insertion_miss: Pair
    arrival_miss: Pair
    #: Largest distance and relative speed [km, km/s] between it and `through`, at the ends of its segments.
    apart: Pair
    failure: str


class CertifiedThird(Message):
    """The cross-check by an integrator of another kind, with another reading of the ephemeris."""

    integrator: str
    version: str
    #: Of the remainder of a series, relative to the largest component of the state.
    relative_tolerance: float
    n_steps: int
    trajectories: tuple[CertifiedThirdTrajectory, ...]


def _is_absent(value: object) -> bool:
    return value is None


class CertificateContent(Message):
    """What is certified; the hash of a certificate is the hash of this."""

    certificate_version: int
    solution_id: str
    problem_hash: str
    k: int
    #: The tolerance that the defects hold, by the independent flight.
    level: Literal["strict", "paper", "none"]
    #: Whether they hold one, no passage is below the lowest altitude allowed and no mass below the dry mass.
    is_sound: bool
    #: Lowest passage that is not marked, of any body; and of each, where they differ.
    min_altitude_km: float
    min_altitudes_km: Annotated[dict[str, float] | None, Field(exclude_if=_is_absent)] = None
    #: Whether the level differs with the integrator's tolerance, the lower one being stated; left out by
    #: certificates made before that was asked.
    is_marginal: Annotated[bool | None, Field(exclude_if=_is_absent)] = None
    #: What is not sound but the level, in words; and why a half could not be flown.
    marks: tuple[str, ...]
    failure: str
    trajectories: tuple[CertifiedTrajectory, ...]
    frame: str
    time_scale: str
    integrator: CertifiedIntegrator
    constants: dict[str, float]
    #: Hashes of the kernels flown with, by file name.
    kernels: dict[str, str]
    code_version: str
    python_version: str
    package_versions: dict[str, str]
    machine: str
    #: Left out where nobody asked for it, so that certificates without it keep their hashes.
    third: Annotated[CertifiedThird | None, Field(exclude_if=_is_absent)] = None


class CertificateFile(Message):
    """A certificate as a file of its own: what the same flight makes again."""

    content: CertificateContent
    #: BLAKE2b-128 of the content: keys sorted, floats in hexadecimal.
    hash: str


class CertificateDocument(CertificateFile):
    """A certificate as it is stored, shown and handed out."""

    #: When [UTC], where and with how much processor time it was made, and when it was last found again.
    made_at: datetime
    made_on: str
    cpu_seconds: Annotated[float, Field(ge=0)]
    checked_at: datetime
    #: Whether it came with a portable file, and nobody has found it again here.
    is_from_elsewhere: bool = False
