"""Cross-check of the end-to-end propagation by heyoka's Taylor series, on the Chebyshev records of DE440.

The equations of motion are written independently, as expressions that heyoka differentiates, with the
coefficients of the records as parameters: within a record the bodies are polynomials of time, and no
ephemeris is evaluated.  SPICE only reads the words of the file, and nothing comes from
`core.ephemeris.tables`.  x and the target are read as in `core.verification.repropagation`.  Bodies are
points here: a passage through one is not detected.  Frame: J2000 axes.  Units: km, km/s, kg, s past the
departure epoch; TDB s past J2000 in the file.
"""

import functools
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import count
from typing import Any, NamedTuple

import heyoka
import numpy as np
import spiceypy

from core.ephemeris.kernels import check_kernels, planetary_kernel
from core.problem import Problem
from core.verification.end_to_end import CrossCheck, propagate_end_to_end
from core.verification.repropagation import Array, Pilot, Plan, UnflyableError, departure_of, pilot_of
from core.world import Body, World, world_of

#: Target and centre of a run of records.
Link = tuple[int, int]


class Record(NamedTuple):
    """A position as a polynomial of (et - middle) / radius, from -1 to 1."""

    middle: float
    radius: float
    #: (n_coefficients, 3) of T_0, T_1, ... [km].
    coefficients: Array


class Run(NamedTuple):
    """Successive records of one body relative to another, of one length."""

    start_et: float
    length: float
    #: (n_records, 2 + 3 n_coefficients): middle, radius, and the coefficients axis by axis.
    words: Array

    @property
    def n_coefficients(self) -> int:
        """Number of coefficients per axis."""
        return int((self.words.shape[1] - 2) // 3)

    def record_at(self, et: float) -> Record:
        """Return the record that holds from et on; at a boundary, the one that begins there."""
        middle, radius, *axes = self.words[int((et - self.start_et) // self.length)].tolist()
        return Record(middle, radius, np.array(axes).reshape(3, -1).T)


def chain_of(body: Body) -> tuple[Link, ...]:
    """Return the runs that lead from the barycentre of the solar system to a body, the last one first.

    In DE440 Earth, Moon, Mercury and Venus are about the barycentre of their planet, and what else there is
    about that of the solar system.
    """
    number = body.naif_id
    return ((number, 0),) if number < 100 else ((number, number // 100), (number // 100, 0))


def links_of(world: World) -> tuple[Link, ...]:
    """Return the runs that the places of a world's bodies relative to its centre are made of."""
    chains = (chain_of(body) for body in (world.center, *world.bodies))
    return tuple(dict.fromkeys(link for chain in chains for link in chain)) if world.bodies else ()


def read_runs(links: tuple[Link, ...], start_et: float, stop_et: float) -> tuple[Run, ...]:
    """Return the records of each link that touch a span.

    Parameters
    ----------
    links : tuple of Link
        From `links_of`.
    start_et, stop_et : float
        The span [TDB s past J2000].
    """
    check_kernels()
    with _open_daf(str(planetary_kernel())) as handle:
        placed = {(target, centre): (first, last) for target, centre, first, last in _segments(handle)}
        return tuple(_run(handle, *placed[link], start_et, stop_et) for link in links)


@contextmanager
def _open_daf(path: str) -> Iterator[int]:
    handle = spiceypy.dafopr(path)
    try:
        yield handle
    finally:
        spiceypy.dafcls(handle)


def _segments(handle: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield target, centre, first and last address of every segment."""
    spiceypy.dafbfs(handle)
    while spiceypy.daffna():
        _, integers = spiceypy.dafus(spiceypy.dafgs(), 2, 6)
        target, centre, _, _, first, last = (int(number) for number in integers)
        yield target, centre, first, last


def _run(handle: int, first: int, last: int, start_et: float, stop_et: float) -> Run:
    # SPK type 2 ends with the beginning and the length of its records, their width, and their number.
    begin, length, width, n_records = spiceypy.dafgda(handle, last - 3, last)
    low, high = (min(int((et - begin) // length), int(n_records) - 1) for et in (start_et, stop_et))
    words = spiceypy.dafgda(handle, first + low * int(width), first + (high + 1) * int(width) - 1)
    return Run(float(begin + low * length), float(length), np.array(words).reshape(high + 1 - low, -1))


INTEGRATOR = "heyoka.taylor_adaptive"
#: Bound on the remainder of a series, relative to the largest component of the state: the last bit.
TOLERANCE = 2.0**-52
#: Limit of steps per arc, exceeded only in close orbits about a body; usual are 10.
MAX_STEPS = 20_000


def cross_check(problem: Problem, plans: list[Plan], naif_id: int, stop_et: float) -> CrossCheck:
    """Propagate every trajectory end to end; `stop_et` is past the last arrival [TDB s past J2000]."""
    world = world_of(problem)
    runs = read_runs(links_of(world), departure_of(problem)[0], stop_et)
    pilot = TaylorPilot(pilot_of(problem), runs, world)
    flights = propagate_end_to_end(pilot, problem, plans, naif_id, [None] * len(plans))
    return CrossCheck(INTEGRATOR, heyoka.__version__, TOLERANCE, pilot.n_evaluations, tuple(flights))


class TaylorPilot(Pilot):
    """Propagates arcs forward as `Pilot` does, by another integrator; `n_evaluations` counts its steps."""

    def __init__(self, pilot: Pilot, runs: tuple[Run, ...], world: World) -> None:
        super().__init__(pilot.origin_et, 0.0, pilot.exhaust_velocity, world=world)
        self.max_thrust = pilot.max_thrust
        self._runs = runs
        self._integrator = _integrator(world, tuple(run.n_coefficients for run in runs))

    def _integrate(self, start: float, state: Array, stop: float, thrust: tuple[float, ...]) -> Array:
        assert start < stop
        force, flow = thrust[:3], thrust[3]
        flown, time = state[:6], start
        while time < stop:
            records = [run.record_at(self.origin_et + time) for run in self._runs]
            # Epochs of one magnitude: their differences are exact, so that no record is entered too early.
            middles = [record.middle - self.origin_et for record in records]
            end = min(stop, *(middle + one.radius for middle, one in zip(middles, records, strict=True)))
            values = [float(state[6]) - flow * (time - start), flow, *force]
            for middle, record in zip(middles, records, strict=True):
                values += [(time - middle) / record.radius, 1.0 / record.radius]
                values += record.coefficients.ravel().tolist()
            flown = self._piece(flown, end - time, values, time)
            time = end
        return flown

    def _piece(self, state: Array, duration: float, values: list[float], time: float) -> Array:
        solver = self._integrator
        solver.time, solver.state[:], solver.pars[:] = 0.0, state, values
        outcome, _, _, n_steps, *_ = solver.propagate_until(duration, max_steps=MAX_STEPS)
        self.n_evaluations += n_steps
        if outcome != heyoka.taylor_outcome.time_limit or not np.all(np.isfinite(solver.state)):
            raise UnflyableError(
                f"integration gave up {(time + solver.time) / 86400:.3f} days after departure"
            )
        return np.array(solver.state)


@functools.cache
def _integrator(world: World, n_coefficients: tuple[int, ...]) -> Any:
    """Return heyoka's integrator of eqs 1 to 3; it is compiled once, which takes seconds, and cached."""
    x, y, z, vx, vy, vz = heyoka.make_vars("x", "y", "z", "vx", "vy", "vz")
    parameters = (heyoka.par[index] for index in count())
    mass_at_start, flow, *force = (next(parameters) for _ in range(5))
    links = dict(zip(links_of(world), (_position(parameters, n) for n in n_coefficients), strict=True))
    bodies = [(body.gm_km3_s2, _from_center(world.center, body, links)) for body in world.bodies]
    mass = mass_at_start - flow * heyoka.time
    terms = [
        [component / mass, pull]
        for component, pull in zip(force, _pull(world.center.gm_km3_s2, [x, y, z]), strict=True)
    ]
    for gm, body in bodies:
        # The origin accelerates with the centre, so only the difference of the two attractions counts.
        pulls = _pull(gm, _difference([x, y, z], body)), _pull(gm, body)
        for axis, pair in enumerate(zip(*pulls, strict=True)):
            terms[axis] += pair
    rates = [vx, vy, vz, *(heyoka.sum(axis) for axis in terms)]
    system = list(zip((x, y, z, vx, vy, vz), rates, strict=True))
    return heyoka.taylor_adaptive(system, [0.0] * 6, tol=TOLERANCE, compact_mode=True)


def _position(parameters: Iterator[Any], n_coefficients: int) -> list[Any]:
    """Return three sums of Chebyshev polynomials of time, by their recurrence."""
    begin, rate = next(parameters), next(parameters)
    place = begin + rate * heyoka.time
    basis = [heyoka.expression(1.0), place]
    while len(basis) < n_coefficients:
        basis.append(2.0 * place * basis[-1] - basis[-2])
    rows = [[next(parameters) * term for _ in range(3)] for term in basis]
    return [heyoka.sum(list(axis)) for axis in zip(*rows, strict=True)]


def _from_center(center: Body, body: Body, links: Mapping[Link, list[Any]]) -> list[Any]:
    """Return the place of a body relative to the centre; what both are about cancels."""
    ours, theirs = (
        [link for link in chain_of(one) if link not in chain_of(other)]
        for one, other in ((center, body), (body, center))
    )
    near, far = (_sum([links[link] for link in reversed(chain)]) for chain in (ours, theirs))
    return _difference(far, near)


def _sum(places: list[list[Any]]) -> list[Any]:
    total = places[0] if places else [heyoka.expression(0.0)] * 3
    for place in places[1:]:
        total = [a + b for a, b in zip(total, place, strict=True)]
    return total


def _difference(one: list[Any], other: list[Any]) -> list[Any]:
    return [a - b for a, b in zip(one, other, strict=True)]


def _pull(gm: float, place: list[Any]) -> list[Any]:
    """Return the attraction by a body at the origin on what is at a place [km/s^2]."""
    square = heyoka.sum([component**2.0 for component in place])
    return [-gm * component * square**-1.5 for component in place]
