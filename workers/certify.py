"""Make certificates: verify a solution independently, and write down what was found.

Here alone the numbers of `core.verification.certificate` meet a clock and the versions of packages.
"""

import itertools
import platform
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core import constants
from core.analysis.metrics import total_delta_v_km_s, transfer_delta_v_km_s
from core.constants import SECONDS_PER_DAY
from core.epochs import calendar_epoch
from core.export import trajectory_name
from core.orbits import departure_state
from core.plain_data import content_hash
from core.problem import Problem
from core.transcription import layout_of
from core.verification.certificate import Certification, Repropagation, certify, lowest_passages
from core.verification.closest_approach import Approach
from core.verification.end_to_end import apart
from core.verification.repropagation import ATOL
from core.verification.verify import Verification
from core.world import EARTH, USUAL, World, world_of
from workers.certificate import (
    CERTIFICATE_VERSION,
    CertificateContent,
    CertificateDocument,
    CertifiedApproach,
    CertifiedIntegrator,
    CertifiedMass,
    CertifiedThird,
    CertifiedThirdTrajectory,
    CertifiedThrough,
    CertifiedTrajectory,
    Pair,
)
from workers.messages import Trajectory, VerificationRecord
from workers.provenance import provenance


def verification_record(verification: Verification, cpu_seconds: float) -> VerificationRecord:
    """Return the verifier's verdict as a message."""
    return VerificationRecord(
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
    """Return masses, times and delta-v of the reference."""
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


#: The frame of each world's certificates.
FRAMES = {"EARTH": "geocentric, axes J2000 (ICRF)", "SUN": "heliocentric, axes J2000 (ICRF)"}
#: Constants that a flight in the Earth's world depends on, by their names in `core.constants`.
CONSTANTS = ("GM_EARTH", "GM_MOON", "GM_SUN", "GM_JUPITER", "RADIUS_EARTH_KM", "RADIUS_MOON_KM", "G0")


def basis(min_altitude_km: float | None, *, with_heyoka: bool = False) -> str:
    """Return the identity of all that a certificate depends on beside its solution.

    Two certificates of one solution on one basis have the same content.
    """
    third = {"heyoka": version("heyoka")} if with_heyoka else {}
    limits = dict(lowest_passages(min_altitude_km))
    return content_hash({"min_altitudes_km": limits, **third, **_toolchain()})


def certificate_of(
    solution_id: str,
    problem: Problem,
    x: NDArray[np.float64],
    min_altitude_km: float | None = None,
    *,
    with_heyoka: bool = False,
) -> CertificateDocument:
    """Re-propagate a solution and return its certificate."""
    began = time.process_time()
    found = certify(problem, x, min_altitude_km, with_heyoka=with_heyoka)
    content, now = _content(solution_id, problem, found), datetime.now(UTC)
    return CertificateDocument(
        content=content,
        hash=content_hash(content.model_dump(mode="json")),
        made_at=now,
        made_on=provenance().host,
        cpu_seconds=time.process_time() - began,
        checked_at=now,
    )


def _content(solution_id: str, problem: Problem, found: Certification) -> CertificateContent:
    flight = found.verification
    return CertificateContent(
        solution_id=solution_id,
        problem_hash=problem.hash,
        k=problem.k,
        level=found.level,
        is_sound=found.is_sound,
        **_limits(found),
        is_marginal=flight.is_marginal,
        marks=tuple(_marks(found)),
        failure=flight.failure,
        trajectories=tuple(_trajectory(found, index) for index in range(len(found.trajectories))),
        integrator=CertifiedIntegrator(
            name=flight.integrator,
            relative_tolerance=flight.tolerance,
            absolute_tolerance=tuple(ATOL.tolist()),
            n_evaluations=flight.n_evaluations,
        ),
        kernels=dict(flight.kernels),
        third=_third(found),
        **_toolchain(world_of(problem)),
    )


def _limits(found: Certification) -> dict[str, Any]:
    lowest = min(found.min_altitudes_km.values(), default=0.0)
    differ = any(limit != lowest for limit in found.min_altitudes_km.values())
    by_body = {"min_altitudes_km": dict(found.min_altitudes_km)} if differ else {}
    return {"min_altitude_km": lowest} | by_body


def _marks(found: Certification) -> Iterator[str]:
    for mark in found.marks:
        name, passage = trajectory_name(mark.trajectory), mark.approach
        epoch = calendar_epoch(passage.et)
        place = f"the {passage.body} at {passage.altitude_km:.3f} km on {epoch} TDB"
        yield f"{name} passes {place}, below {mark.limit_km:g} km"
    for lack in found.lacks:
        name = trajectory_name(lack.trajectory)
        yield f"{name} arrives with {lack.mass_kg:.3f} kg, below the {lack.least_kg:g} kg that it has to keep"


def _constants(world: World) -> dict[str, float]:
    """Return the constants that a flight depends on, by name."""
    if world.center.name == "EARTH" and tuple(body.name for body in world.bodies) == USUAL["EARTH"]:
        return {name: getattr(constants, name) for name in CONSTANTS}
    of_bodies = {
        f"GM_{body.name.replace(' ', '_')}": body.gm_km3_s2 for body in (world.center, *world.bodies)
    }
    radii = {f"RADIUS_{body.name}_KM": body.radius_km for body in world.solid}
    return of_bodies | radii | {"G0": constants.G0}


def _toolchain(world: World = EARTH) -> dict[str, Any]:
    made = provenance()
    return {
        "certificate_version": CERTIFICATE_VERSION,
        "frame": FRAMES[world.center.name],
        "time_scale": "TDB",
        "constants": _constants(world),
        "code_version": made.code_version,
        "python_version": made.python_version,
        "package_versions": made.package_versions,
        "machine": f"{platform.machine()}, {platform.system()}",
    }


def _trajectory(found: Certification, index: int) -> CertifiedTrajectory:
    flight, flown = found.verification, found.trajectories[index]
    outage, mass = flown.outage, flown.mass._asdict()
    return CertifiedTrajectory(
        name=trajectory_name(index),
        outage_segment=outage.segment if outage else None,
        outage_days=outage.duration_days if outage else None,
        arrival_epoch=calendar_epoch(float(flight.arrival_et[index])),
        defect=tuple(map(finite_or_none, flight.defects[index])),
        position_km=finite_or_none(flight.position_km[index]),
        velocity_km_s=finite_or_none(flight.velocity_km_s[index]),
        mass_kg=finite_or_none(flight.mass_kg[index]),
        closest=_approaches(flown.closest),
        through=_through(flown),
        mass=CertifiedMass(coasts=0.0, **mass),
    )


def _through(flown: Repropagation) -> CertifiedThrough:
    through = flown.through
    return CertifiedThrough(
        insertion_miss=_pair(through.insertion_miss),
        arrival_miss=_pair(through.arrival_miss),
        mass_miss_kg=finite_or_none(through.mass_miss_kg),
        closest=_approaches(flown.closest_through),
        failure=through.failure,
    )


def _third(found: Certification) -> CertifiedThird | None:
    if found.third is None:
        return None
    pairs = zip(found.third.flights, found.trajectories, strict=True)
    return CertifiedThird(
        integrator=found.third.integrator,
        version=found.third.version,
        relative_tolerance=found.third.tolerance,
        n_steps=found.third.n_steps,
        trajectories=tuple(
            CertifiedThirdTrajectory(
                insertion_miss=_pair(third.insertion_miss),
                arrival_miss=_pair(third.arrival_miss),
                apart=_pair(apart(third, flown.through)),
                failure=third.failure,
            )
            for third, flown in pairs
        ),
    )


def _approaches(found: tuple[Approach, ...]) -> tuple[CertifiedApproach, ...]:
    return tuple(
        CertifiedApproach(
            body=one.body,
            distance_km=one.distance_km,
            altitude_km=one.altitude_km,
            epoch=calendar_epoch(one.et),
            days=one.days,
            is_turn=one.is_turn,
        )
        for one in found
    )


def _pair(miss: tuple[float, float]) -> Pair:
    return finite_or_none(miss[0]), finite_or_none(miss[1])


def finite_or_none(value: float) -> float | None:
    """Return a number as JSON can carry it."""
    return float(value) if np.isfinite(value) else None
