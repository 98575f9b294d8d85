"""Cross-check of the end-to-end propagation by heyoka's Taylor series, on the Chebyshev records of a kernel.

The equations of motion are written independently, as expressions that heyoka differentiates, with the
coefficients of the records as parameters: within a record the bodies are polynomials of time, and no
ephemeris is evaluated.  The kernel is DE440, or that of a world.  SPICE only reads the words of the file,
and nothing comes from `core.ephemeris.tables`.  x and the target are read as in
`core.verification.repropagation`.  Bodies are points here: a passage through one is not detected.
Frame: J2000 axes.  Units: km, km/s, kg, s past the departure epoch; TDB s past J2000 in the file.
"""

import functools
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import count
from typing import Any, NamedTuple

import heyoka
import numpy as np
import spiceypy

from core.ephemeris.daf import SpkError, segments_of
from core.ephemeris.kernels import check_kernels, planetary_kernel, spice_name
from core.problem import Problem
from core.verification.end_to_end import CrossCheck, propagate_end_to_end
from core.verification.repropagation import Array, Pilot, Plan, UnflyableError, departure_of, pilot_of
from core.world import EARTH, Body, World, world_of

#: Frame and type of the segments that are read.
_J2000_CHEBYSHEV = (1, 2)
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
        place = min(max(int((et - self.start_et) // self.length), 0), len(self.words) - 1)
        middle, radius, *axes = self.words[place].tolist()
        return Record(middle, radius, np.array(axes).reshape(3, -1).T)


#: What each body is about in DE440, by their numbers.
_CENTRES = {**dict.fromkeys(range(1, 11), 0), 199: 1, 299: 2, 301: 3, 399: 3}


def _centres_of(world: World) -> Mapping[int, int]:
    """Return what each body is about in the kernel of a world."""
    if world.kernel is None:
        return _CENTRES
    segments = segments_of(world.kernel, "world.kernel")
    centres = {segment.body: segment.centre for segment in segments}
    if len(centres) < len(segments) or any(one[4:6] != _J2000_CHEBYSHEV for one in segments):
        kinds = ", ".join(sorted({f"type {one.kind} in frame {one.frame}" for one in segments}))
        raise SpkError(
            f"world.kernel {world.kernel}: expected Chebyshev records (SPK type 2) in J2000, one segment for "
            f"each body, which heyoka's flight reads, got {len(segments)} segments of {kinds}; verify "
            f"without heyoka, or write the kernel so"
        )
    return centres


def _chain_of(body: Body, centres: Mapping[int, int]) -> tuple[Link, ...]:
    """Return the runs that lead to a body from what nothing else is about, the last one first."""
    chain: list[Link] = []
    number = body.naif_id
    while number in centres and len(chain) < len(centres):
        chain.append((number, centres[number]))
        number = centres[number]
    return tuple(chain)


def _chains_of(world: World) -> dict[Body, tuple[Link, ...]]:
    centres = _centres_of(world) if world.bodies else {}
    return {body: _chain_of(body, centres) for body in (world.center, *world.bodies)}


def links_of(world: World) -> tuple[Link, ...]:
    """Return the runs that the places of a world's bodies relative to its centre are made of."""
    return tuple(dict.fromkeys(link for chain in _chains_of(world).values() for link in chain))


def read_runs(
    links: tuple[Link, ...], start_et: float, stop_et: float, world: World = EARTH
) -> tuple[Run, ...]:
    """Return the records of each link that touch a span.

    Parameters
    ----------
    links : tuple of Link
        From `links_of`.
    start_et, stop_et : float
        The span [TDB s past J2000].
    world : World
        Says in which kernel they are.
    """
    check_kernels()
    with _open_daf(spice_name(world.kernel or planetary_kernel())) as handle:
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
    last_record = int(n_records) - 1
    low, high = (min(max(int((et - begin) // length), 0), last_record) for et in (start_et, stop_et))
    words = spiceypy.dafgda(handle, first + low * int(width), first + (high + 1) * int(width) - 1)
    return Run(float(begin + low * length), float(length), np.array(words).reshape(high + 1 - low, -1))


INTEGRATOR = "heyoka.taylor_adaptive"
#: Bound on the remainder of a series, relative to the largest component of the state: the last bit.
TOLERANCE = 2.0**-52
#: Least length of a piece [s]: more than the spacing of epochs, in which no body moves by a millimetre.
_LEAST_PIECE_S = 1e-6
#: Limit of steps per arc, exceeded only in close orbits about a body; usual are 10.
MAX_STEPS = 20_000


def cross_check(problem: Problem, plans: list[Plan], naif_id: int, stop_et: float) -> CrossCheck:
    """Propagate every trajectory end to end; `stop_et` is past the last arrival [TDB s past J2000]."""
    world = world_of(problem)
    runs = read_runs(links_of(world), departure_of(problem)[0], stop_et, world)
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
            ends = [middle + one.radius for middle, one in zip(middles, records, strict=True)]
            end = min([stop, *ends])
            # Where a record ends at no epoch of SPICE, rounding may enter it again.
            end = max(end, min(stop, time + _LEAST_PIECE_S))
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
    chains = _chains_of(world)
    ours = chains[world.center]
    bodies = [(body.gm_km3_s2, _from_center(ours, chains[body], links)) for body in world.bodies]
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


def _from_center(
    center: tuple[Link, ...], body: tuple[Link, ...], links: Mapping[Link, list[Any]]
) -> list[Any]:
    """Return the place of a body relative to the centre by their chains; what both are about cancels."""
    ours, theirs = (
        [link for link in one if link not in other] for one, other in ((center, body), (body, center))
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
