"""A solution as states that others can interpolate: every trajectory from departure to arrival, and as CSV.

Frame: axes of the ICRF ("J2000" in SPICE), origin at the centre of the world.  Units: km, km/s, kg, N;
epochs in TDB seconds past J2000, as text TDB to the microsecond and UTC by the leap seconds kernel.  States
are propagated by the integrator of the solver, forwards from the departure and backwards from the target,
so a jump remains at each matchpoint: the defect.  Control changes only between arcs, and no arc is
interpolated into the next. A sample where two arcs meet stands in both, since thrust and, at a matchpoint,
states differ there.      ExportError(ValueError)   a solution that cannot be exported
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import spiceypy
from numpy.typing import NDArray

from core.analysis.flight import MAX_SAMPLES, Arc, FlownTrajectory, fly
from core.constants import SECONDS_PER_DAY
from core.csv_text import csv_text
from core.ephemeris.kernels import furnish, one_at_a_time
from core.errors import UserError
from core.orbits import departure_state
from core.problem import Outage, Problem
from core.world import Body, world_of

Array = NDArray[np.float64]

#: Samples per radian of the local circular orbit.  With these, and polynomials of `DEGREE` through positions
#: and velocities, interpolation between two samples is accurate to a millimetre.
SAMPLES_PER_RADIAN = 40.0
#: Degree of the Hermite polynomials that states are to be read with, through four samples.
DEGREE = 7
#: Relative tolerance of the integrator [-].
TOLERANCE = 1e-13
#: Shorter arcs are dropped [s]: neighbouring epochs must differ, and motion in them is below a metre.
SHORTEST_S = 1e-3


class ExportError(UserError, ValueError):
    """A solution that cannot be exported; the message says why."""


@dataclass(frozen=True, slots=True, eq=False)
class ExportedArc:
    """An arc under one control; the next one begins where it ends."""

    #: "coast", "thrust" or "outage".
    kind: str
    #: Segment from 1; 0 on coasts and outages.
    segment: int
    #: Throttle [-] and angles [rad]; zero on coasts and outages.
    throttle: float
    in_plane_rad: float
    out_of_plane_rad: float
    #: (3,) thrust [N].
    thrust_n: Array
    #: (n,) epochs [TDB s past J2000], rising.
    et: Array
    #: (n, 7) positions [km], velocities [km/s] and mass [kg].
    states: Array
    #: (n, 3) positions of the first body of the world [km], of the target where it has none.
    moon_km: Array

    @property
    def degree(self) -> int:
        """Degree of the polynomials that fit into the arc."""
        return min(DEGREE, 2 * len(self.et) - 1)


@dataclass(frozen=True, slots=True, eq=False)
class ExportedTrajectory:
    """The reference (number 0) or a complete realization, which follows the reference until its outage."""

    index: int
    #: The outage that it recovers from; None for the reference.
    outage: Outage | None
    #: Epochs at which its own halves meet, and its outage begins [TDB s past J2000].
    matchpoint_et: float
    outage_et: float | None
    arcs: tuple[ExportedArc, ...]
    #: What its states are relative to, and the body whose places go along: the Moon near the Earth.
    center: Body
    main: Body | None

    @property
    def name(self) -> str:
        """What it is called."""
        return trajectory_name(self.index)

    @property
    def start_et(self) -> float:
        """Departure [TDB s past J2000]."""
        return float(self.arcs[0].et[0])

    @property
    def stop_et(self) -> float:
        """Arrival [TDB s past J2000]."""
        return float(self.arcs[-1].et[-1])


def trajectory_name(index: int) -> str:
    """Return what a trajectory is called, the reference being number 0."""
    return f"realization {index}" if index else "reference"


def export_states(
    problem: Problem, x: Array, samples_per_radian: float = SAMPLES_PER_RADIAN
) -> tuple[ExportedTrajectory, ...]:
    """Return the reference and every realization as states, dense enough for interpolation.

    Parameters
    ----------
    problem : Problem
        P_k.
    x : (n_variables,) array
        Decision vector [days, rad, kg].
    samples_per_radian : float
        Of the local circular orbit [1/rad]; fewer than the default are not to be interpolated.

    Returns
    -------
    tuple of ExportedTrajectory
        The reference, then the realizations in order of outage.

    Raises
    ------
    ExportError
        When a trajectory passes through a body, or winds so often that its samples run out.
    ValueError
        When x has another shape or is not finite.
    """
    flight, world = fly(problem, x, samples_per_radian, TOLERANCE), world_of(problem)
    departure_et = float(departure_state(problem.departure, problem.spacecraft).et)
    max_thrust_n = problem.spacecraft.max_thrust_n
    whole = [_arcs(i, flown, departure_et, max_thrust_n) for i, flown in enumerate(flight.trajectories)]
    exported = []
    for index, flown in enumerate(flight.trajectories):
        # Arc n of the reference is segment n: the arcs before it are the coast and segments 1 to n - 1.
        before = whole[0][: flown.outage.segment] if flown.outage else []
        exported.append(
            ExportedTrajectory(
                index=index,
                outage=flown.outage,
                matchpoint_et=departure_et + float(flown.days[flown.matchpoint]) * SECONDS_PER_DAY,
                outage_et=float(whole[index][0].et[0]) if flown.outage else None,
                arcs=tuple(_drop_shortest([*before, *whole[index]])),
                center=world.center,
                main=world.bodies[0] if world.bodies else None,
            )
        )
    return tuple(exported)


def _arcs(index: int, flown: FlownTrajectory, departure_et: float, max_thrust_n: float) -> list[ExportedArc]:
    if not np.all(np.isfinite(flown.inertial_km)):
        where = np.argmin(np.all(np.isfinite(flown.inertial_km), axis=1))
        raise ExportError(
            f"{trajectory_name(index)}: expected a flight from departure to target, got one that meets a "
            f"body {float(flown.days[where]):.3f} days after departure"
        )
    et = departure_et + flown.days * SECONDS_PER_DAY
    states = np.hstack([flown.inertial_km, flown.velocity_km_s, flown.mass_kg[:, None]])
    return [_arc(index, arc, flown, et, states, max_thrust_n) for arc in flown.arcs]


def _arc(
    index: int, arc: Arc, flown: FlownTrajectory, et: Array, states: Array, max_thrust_n: float
) -> ExportedArc:
    if arc.stop - arc.first >= MAX_SAMPLES:
        raise ExportError(
            f"{trajectory_name(index)}: expected arcs of less than {MAX_SAMPLES} samples, got a {arc.kind} "
            f"with too many revolutions"
        )
    own = slice(arc.first, arc.stop)
    azimuth, elevation = arc.in_plane_rad, arc.out_of_plane_rad
    level = np.cos(elevation)
    direction = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    return ExportedArc(
        *(arc.kind, arc.segment, arc.throttle, azimuth, elevation),
        thrust_n=arc.throttle * max_thrust_n * direction,
        et=et[own],
        states=states[own],
        moon_km=flown.moon_km[own],
    )


def _drop_shortest(arcs: Iterable[ExportedArc]) -> list[ExportedArc]:
    """Drop arcs that are too short, and extend the next one back to their start."""
    kept: list[ExportedArc] = []
    begin_et: float | None = None
    for arc in arcs:
        if arc.et[-1] - arc.et[0] < SHORTEST_S:
            begin_et = float(arc.et[0]) if begin_et is None else begin_et
            continue
        kept.append(arc if begin_et is None else _extend_back(arc, begin_et))
        begin_et = None
    return kept


def _extend_back(arc: ExportedArc, begin_et: float) -> ExportedArc:
    et, states = arc.et.copy(), arc.states.copy()
    # Over a millisecond linear extrapolation is accurate to a micrometre.
    states[0, :3] -= states[0, 3:6] * (et[0] - begin_et)
    et[0] = begin_et
    return replace(arc, et=et, states=states)


def tdb_texts(et: NDArray[np.float64]) -> list[str]:
    """Return TDB seconds past J2000 (n,) [s] as calendar epochs; their doubles are spaced by 1.2e-7 s."""
    origin = np.datetime64("2000-01-01T12:00:00", "us")
    return [str(origin + np.timedelta64(round(moment * 1e6), "us")) for moment in et.tolist()]


@one_at_a_time
def utc_texts(et: NDArray[np.float64]) -> Sequence[str]:
    """Return TDB seconds past J2000 (n,) [s] as UTC to the microsecond; later leap seconds are not known."""
    furnish()
    texts: list[str] = spiceypy.et2utc(et, "ISOC", 6).tolist()
    return texts


COLUMNS = (
    *("trajectory", "outage_segment", "outage_days", "arc", "segment", "is_outage"),
    *("epoch_tdb", "epoch_utc", "days_past_departure"),
    *("x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s", "mass_kg"),
    *("throttle", "in_plane_rad", "out_of_plane_rad", "thrust_x_n", "thrust_y_n", "thrust_z_n"),
)


def columns_of(main: Body | None) -> tuple[str, ...]:
    """Return the columns of a table of samples, the last three of the main body or the target."""
    name = main.title.lower() if main else "target"
    return (*COLUMNS, *(f"{name}_{axis}_km" for axis in "xyz"))


def csv_lines(trajectories: Iterable[ExportedTrajectory], head: Sequence[str]) -> Iterator[str]:
    """Yield lines of `#`, the columns, then every sample in order of time.

    Parameters
    ----------
    trajectories : iterable of ExportedTrajectory
        The reference, realizations, or some of them.
    head : sequence of str
        What the file is about.
    """
    chosen = list(trajectories)
    yield "".join(f"# {line}\n" for line in head)
    yield csv_text([columns_of(chosen[0].main if chosen else None)])
    for rows in _rows(chosen):
        yield csv_text(map(_plain, row) for row in rows)


def ndjson_lines(trajectories: Iterable[ExportedTrajectory]) -> Iterator[str]:
    """Yield every sample in order of time as one JSON object a line; what has no value is null.

    Parameters
    ----------
    trajectories : iterable of ExportedTrajectory
        As for `csv_lines`.
    """
    for trajectory in trajectories:
        columns = columns_of(trajectory.main)
        for rows in _rows([trajectory]):
            yield "".join(json.dumps(dict(zip(columns, row, strict=True))) + "\n" for row in rows)


def _plain(value: Any) -> Any:
    return str(value).lower() if isinstance(value, bool) else value


def _rows(trajectories: Iterable[ExportedTrajectory]) -> Iterator[list[tuple[Any, ...]]]:
    """Yield the samples of one arc after the other."""
    for trajectory in trajectories:
        outage = trajectory.outage
        missed = (outage.segment, outage.duration_days) if outage else (None, None)
        for arc in trajectory.arcs:
            begin = (trajectory.name, *missed, arc.kind, arc.segment or None, arc.kind == "outage")
            yield [(*begin, *sample) for sample in _samples(arc, trajectory.start_et)]


def _samples(arc: ExportedArc, departure_et: float) -> Iterator[tuple[Any, ...]]:
    days = (arc.et - departure_et) / SECONDS_PER_DAY
    control = (arc.throttle, arc.in_plane_rad, arc.out_of_plane_rad, *arc.thrust_n.tolist())
    columns = (tdb_texts(arc.et), utc_texts(arc.et), days.tolist(), arc.states.tolist(), arc.moon_km.tolist())
    for tdb, utc, day, state, moon in zip(*columns, strict=True):
        yield (tdb, utc, day, *state, *control, *moon)
