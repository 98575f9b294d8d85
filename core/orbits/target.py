"""The target of a transfer, as an SPK kernel, and as a table for the numerics.

The generated NRHO is stored in the cache folder under a hash of all its inputs, and generated again if the
content does not match its digest.  Tables are relative to the first body of the world (near the Earth the
Moon), axes J2000, in canonical units and TU past the departure epoch.
"""

import functools
import math
from pathlib import Path

from spiceypy.utils.exceptions import SpiceyError

from core.cache import cache_folder as users_folder
from core.cache import is_sealed, seal
from core.constants import (
    GM_EARTH,
    GM_JUPITER,
    GM_MOON,
    GM_SUN,
    KERNEL_MD5,
    MU_CR3BP,
    SECONDS_PER_DAY,
)
from core.dynamics import force_model
from core.ephemeris import EphemerisTable, body_table, one_at_a_time
from core.ephemeris.daf import SpkError
from core.ephemeris.kernels import KernelError, spice_name
from core.ephemeris.spk import (
    ChebyshevOrbit,
    bodies_of,
    check_coverage,
    check_world,
    orbit_of,
    read_orbit,
    write_orbit,
)
from core.ephemeris.tables import coefficients_through, record_nodes
from core.epochs import seconds_past_j2000
from core.orbits.nrho import PatchedOrbit, margin_days, nrho
from core.orbits.spiral import departure_state
from core.plain_data import content_hash
from core.problem import NrhoTarget, Problem, SpkTarget
from core.units import LU_KM, TU_S
from core.world import EARTH, Units, World, world_of

#: Identifier of the generated NRHO: private, and not the -60000 of the public reference.
NRHO_ID = -60092

#: The NRHO is known from here to there at least [days past departure].
NRHO_WINDOW_DAYS = (-5.0, 200.0)

# Perilune passes in an hour.  With fewer coefficients the velocity there is wrong by more than 1e-8 km/s.
_RECORD_S = 3600.0
_N_COEFFICIENTS = 24
# Counts the changes of the algorithm that change the orbit.
_VERSION = 2


def target_kernel(problem: Problem, cache_folder: Path | None = None) -> tuple[Path, int]:
    """Return the SPK of a problem's target and the identifier of the target in it.

    Parameters
    ----------
    problem : Problem
        The problem; its departure epoch and bounds say which span is needed.
    cache_folder : Path, optional
        Where the generated NRHO is kept; by default the user's cache folder of coastarc.

    Raises
    ------
    SpkError
        When a given kernel cannot be read, lacks the target or a part of the span, or has been changed.
    HaloError, ShootingError
        When there is no NRHO of the given period.
    """
    start, stop = window_days(problem)
    departure_et = departure_state(problem.departure, problem.spacecraft).et
    if isinstance(problem.target, SpkTarget):
        _given_orbit(problem.target, departure_et, start, stop, world_of(problem))
        return problem.target.path, problem.target.naif_id
    return _nrho_kernel(problem, problem.target, departure_et, start, stop, cache_folder)


def _given_orbit(
    target: SpkTarget, departure_et: float, start: float, stop: float, world: World
) -> ChebyshevOrbit:
    """Return the orbit of a user's kernel after validating the kernel, and that of the world."""
    span = tuple(departure_et + days * SECONDS_PER_DAY for days in (start, stop))
    check_world(world, *span)
    if world.kernel is not None and target.naif_id in bodies_of(world.kernel):
        raise SpkError(
            f"world.kernel {world.kernel}: expected the bodies that pull alone, got the target "
            f"{target.naif_id} among them, which comes from its own file; take it out with NAIF's spkmerge"
        )
    spice_name(target.path)
    digest = target.digest_now()
    if target.digest not in (None, digest):
        raise SpkError(
            f"target {target.path}: expected the file with digest {target.digest}, got {digest}; "
            f"it has been changed since"
        )
    check_coverage(target.path, target.naif_id, *span)
    return orbit_of(target.path, target.naif_id, *span, digest, world)


def _nrho_kernel(
    problem: Problem,
    target: NrhoTarget,
    departure_et: float,
    start: float,
    stop: float,
    cache_folder: Path | None,
) -> tuple[Path, int]:
    folder = users_folder() if cache_folder is None else cache_folder
    path = folder / f"nrho-{_identity(target, departure_et, start, stop)}.bsp"
    if not is_sealed(path):
        # It takes seconds, during which SPICE must stay available; of two made at once one is kept.
        _write_once(path, _records(_ballistic(problem, departure_et), departure_et, start, stop), target)
    return path, NRHO_ID


@one_at_a_time
def _write_once(path: Path, orbit: ChebyshevOrbit, target: NrhoTarget) -> None:
    if is_sealed(path):
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_orbit(path, NRHO_ID, orbit, _provenance(target))
        seal(path)
    except (OSError, SpiceyError) as error:
        raise KernelError(
            f"kernel {path}: expected a place to write it, got "
            f"{getattr(error, 'strerror', None) or getattr(error, 'short', error)}"
        ) from error


def target_table(problem: Problem, cache_folder: Path | None = None) -> EphemerisTable:
    """Return the target relative to `World.near`: three columns [LU], time in TU past the departure epoch.

    Parameters
    ----------
    problem, cache_folder
        As for `target_kernel`.
    """
    departure_et = departure_state(problem.departure, problem.spacecraft).et
    if isinstance(problem.target, SpkTarget):
        world = world_of(problem)
        orbit = _given_orbit(problem.target, departure_et, *window_days(problem), world)
        return _table_of(orbit, departure_et, world.units)
    return _generated_table(*target_kernel(problem, cache_folder), departure_et)


@functools.cache
@one_at_a_time
def _generated_table(path: Path, naif_id: int, departure_et: float) -> EphemerisTable:
    orbit = read_orbit(path, naif_id)
    assert orbit is not None
    return _table_of(orbit, departure_et, EARTH.units)._replace(is_ballistic=True)


def _table_of(orbit: ChebyshevOrbit, departure_et: float, units: Units) -> EphemerisTable:
    first = (orbit.start_et - departure_et) / units.tu_s
    record, coefficients = orbit.record_s / units.tu_s, orbit.coefficients / units.lu_km
    return EphemerisTable(first, record, coefficients, tu_days=units.tu_days)


def is_target_ballistic(problem: Problem) -> bool:
    """Return whether coasting keeps a spacecraft on the target, in our own model of forces.

    The generated NRHO is made so.  Of the orbit of another kernel nothing is known.
    """
    return isinstance(problem.target, NrhoTarget)


def window_days(problem: Problem) -> tuple[float, float]:
    """Return the span over which a problem needs its target [days past departure]."""
    latest = problem.latest_arrival_days - (getattr(problem.departure, "duration_days", None) or 0.0)
    if isinstance(problem.target, SpkTarget):
        return 0.0, latest
    return NRHO_WINDOW_DAYS[0], max(NRHO_WINDOW_DAYS[1], math.ceil(latest))


def _identity(target: NrhoTarget, departure_et: float, start: float, stop: float) -> str:
    return content_hash(
        {
            "version": _VERSION,
            "target": target.model_dump(mode="json"),
            "window": [departure_et, start, stop],
            "records": [_RECORD_S, _N_COEFFICIENTS],
            "model": [GM_EARTH, GM_MOON, GM_SUN, GM_JUPITER, MU_CR3BP, KERNEL_MD5],
        }
    )


def _provenance(target: NrhoTarget) -> str:
    return (
        "Near-rectilinear halo orbit about the Moon, ballistic under point masses of Earth, Moon, Sun and\n"
        "Jupiter's system at their places in DE440; made by coastarc.\n"
        f"Period of the CR3BP orbit: {target.period_days} days. Perilune near {target.perilune_epoch} TDB."
    )


def _ballistic(problem: Problem, departure_et: float) -> PatchedOrbit:
    assert isinstance(problem.target, NrhoTarget)
    window = window_days(problem)
    period, margin = problem.target.period_days, margin_days(problem.target.period_days)
    bodies = body_table(departure_et, window[0] - margin, window[1] + margin)
    perilune_days = (seconds_past_j2000(problem.target.perilune_epoch) - departure_et) / SECONDS_PER_DAY
    return nrho(force_model(problem, bodies), period, perilune_days, window)


def _records(orbit: PatchedOrbit, departure_et: float, start: float, stop: float) -> ChebyshevOrbit:
    """Return an orbit as records that cover a span [days past departure]."""
    n_records = math.ceil((stop - start) * SECONDS_PER_DAY / _RECORD_S)
    seconds = record_nodes(start * SECONDS_PER_DAY, _RECORD_S, n_records, _N_COEFFICIENTS)
    coefficients = coefficients_through(orbit.states_from_moon(seconds / TU_S)[:, :, :3] * LU_KM)
    return ChebyshevOrbit(departure_et + start * SECONDS_PER_DAY, _RECORD_S, coefficients)
