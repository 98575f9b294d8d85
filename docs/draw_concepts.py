"""Draw the pictures of docs/concepts.md from the archive of the study in docs/reproduction.md.

python docs/draw_concepts.py STUDY    (a data folder in which examples/paper-small.toml ran)
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from core.analysis.flight import Flight, FlownTrajectory, fly, to_rotating
from core.constants import G0, SECONDS_PER_DAY
from core.ephemeris import furnish
from core.orbits import departure_state, target_kernel
from core.problem import Problem, load_problem
from core.verification.repropagation import MOON, Pilot
from service.schemas.solution import RecordWithVector
from service.store.filters import filter_of
from service.store.store import Store

matplotlib.use("Agg")
Array = NDArray[np.float64]

IMAGES = Path(__file__).parent / "images"
#: The outage of the pictures stops a burn of the cheapest transfer that seeded both problems.
SEGMENT, DURATION_DAYS = 12, 1.5
SINGLE = ((SEGMENT, DURATION_DAYS),)
TRIPLE = ((4, DURATION_DAYS), (8, DURATION_DAYS), (12, DURATION_DAYS))
REFERENCE, THRUST, OUTAGE, TARGET = "#5b7f9e", "#1f3d5a", "#e07b00", "#b0b0b0"
REALIZATIONS = ("#2a9d6f", "#c9a400", "#8e5bb5")
#: Places on the path without recovery, for each segment.
SAMPLES = 12


def main(study: Path) -> None:
    """Draw all pictures."""
    with Store(study, read_only=True) as store:
        seeds = store.all_records(filter_of(strategy="S(0)", strict=True))
        singles, triples = _by_seed(store, "S(1|0)", SINGLE), _by_seed(store, "S(3|0)", TRIPLE)
        chains = store.all_records(filter_of(campaign=1, search="s0", strict=True))
    seed = next(record for record in seeds if record.id in singles and record.id in triples)
    single, triple = singles[seed.id], triples[seed.id]
    problem = load_problem("ppe-drm3")
    flights = [_flight(problem, record) for record in (seed, single, triple)]
    _draw_reference(flights[0])
    _draw_outage(problem, np.array(seed.x), flights[0], flights[1])
    _draw_seeds(flights, (seed, single, triple))
    _draw_hops(chains)


def _by_seed(
    store: Store, strategy: str, case: tuple[tuple[int, float], ...]
) -> dict[str | None, RecordWithVector]:
    """Return the solutions of a case by their seeds."""
    records = store.all_records(filter_of(strategy=strategy, strict=True))
    return {
        record.seed_id: record
        for record in records
        if tuple((outage.segment, outage.duration_days) for outage in record.outages) == case
    }


def _flight(problem: Problem, record: RecordWithVector) -> Flight:
    return fly(
        problem.with_outages([(o.segment, o.duration_days) for o in record.outages]), np.array(record.x)
    )


def _figure(n: int, width: float = 10.0, height: float = 4.2) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(1, n, squeeze=False)[0]
    return figure, list(axes)


def _save(figure: Figure, name: str) -> None:
    figure.savefig(IMAGES / f"concept-{name}.png", dpi=110)


def _plane(axes: Axes, title: str, sideways: bool = False) -> None:
    axes.set_title(title, fontsize=10, loc="left")
    axes.set_xlabel("x towards the Moon, 1000 km", fontsize=8)
    axes.set_ylabel("z, 1000 km" if sideways else "y along its motion, 1000 km", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.set_aspect("equal", adjustable="datalim")


def _bodies(axes: Axes, flight: Flight, second: int) -> None:
    target = flight.target.rotating_km / 1e3
    axes.plot(target[:, 0], target[:, second], color=TARGET, lw=2.5, zorder=1)
    axes.plot(384.4, 0, "o", color="#888888", ms=6, zorder=5)
    axes.annotate("Moon", (384.4, 0), (8, -16), textcoords="offset points", fontsize=8)


def _track(
    axes: Axes, flown: FlownTrajectory, second: int, colour: str, burns: str | None = None, lw: float = 1.1
) -> None:
    """Draw a trajectory: burns thick where they have a colour, its outage dashed."""
    place = flown.rotating_km[:, [0, second]] / 1e3
    for arc in flown.arcs:
        path = place[arc.first : arc.stop]
        if arc.kind == "outage":
            axes.plot(*path.T, color=OUTAGE, lw=3, zorder=4)
        elif arc.throttle > 0.05 and burns:
            axes.plot(*path.T, color=burns, lw=2.4, zorder=3)
        else:
            axes.plot(*path.T, color=colour, lw=lw, zorder=2)


def _draw_reference(flight: Flight) -> None:
    figure, (plan, side) = _figure(2)
    (flown,) = flight.trajectories
    for axes, second, title in ((plan, 1, "from above"), (side, 2, "from the side, near the Moon")):
        _plane(axes, title, second == 2)
        _bodies(axes, flight, second)
        _track(axes, flown, second, REFERENCE, THRUST)
        at = flown.rotating_km[[0, flown.matchpoint]][:, [0, second]] / 1e3
        axes.plot(*at[1], "s", color="#c0392b", ms=5, zorder=6)
    start, match = flown.rotating_km[[0, flown.matchpoint], :2] / 1e3
    plan.plot(0, 0, "o", color="#3b6fb5", ms=9, zorder=5)
    plan.annotate("Earth", (0, 0), (8, -12), textcoords="offset points", fontsize=8)
    plan.plot(*start, "^", color="#222222", ms=6, zorder=6)
    plan.annotate("departure", start, (8, -4), textcoords="offset points", fontsize=8)
    plan.annotate("matchpoint", match, (-62, 8), textcoords="offset points", fontsize=8, color="#c0392b")
    side.set_aspect("equal", adjustable="box")
    side.set_xlim(300, 460)
    side.set_ylim(-90, 40)
    for label, colour, width in (("coast", REFERENCE, 1.1), ("thrust", THRUST, 2.4), ("target", TARGET, 2.5)):
        plan.plot([], [], color=colour, lw=width, label=label)
    plan.legend(fontsize=8, frameon=False, loc="lower left")
    _save(figure, "reference")


def _draw_outage(problem: Problem, x: Array, seed: Flight, robust: Flight) -> None:
    figure, (left, right) = _figure(2)
    path, miss = _without_recovery(problem, x)
    _plane(left, f"not prepared: {1000 * round(miss / 1e3):,} km from the target at the arrival")
    _plane(right, "P_1: a reference and its realization")
    for axes, flight in ((left, seed), (right, robust)):
        _bodies(axes, flight, 1)
        _track(axes, flight.trajectories[0], 1, REFERENCE)
        _track(axes, robust.trajectories[1], 1, "none")
    left.plot(*path.T, color="#c0392b", lw=1.4, zorder=3)
    _track(right, robust.trajectories[1], 1, REALIZATIONS[0], lw=1.6)
    for label, colour in (("reference", REFERENCE), ("outage", OUTAGE), ("as planned after it", "#c0392b")):
        left.plot([], [], color=colour, label=label)
    right.plot([], [], color=REALIZATIONS[0], label="realization")
    for axes in (left, right):
        axes.legend(fontsize=8, frameon=False, loc="lower left")
    _save(figure, "outage")


def _without_recovery(problem: Problem, x: Array) -> tuple[Array, float]:
    """Fly the planned controls at their planned times, but for the outage.

    Return where that leads, in thousands of km, and how far from the target it is at insertion [km].
    """
    departure = departure_state(problem.departure, problem.spacecraft)
    craft = problem.spacecraft
    pilot = Pilot(departure.et, craft.max_thrust_n, craft.isp_s * G0 * 1e-3)
    shooting, coast, _ = x[:3] * SECONDS_PER_DAY
    h, controls = shooting / problem.n_segments, x[3:-1].reshape(-1, 3)
    state = np.append(np.concatenate([departure.position_km, departure.velocity_km_s]), departure.mass_kg)
    state = pilot.arc(0.0, state, coast)
    lit = coast + (SEGMENT - 1) * h + DURATION_DAYS * SECONDS_PER_DAY
    time, times, places = coast, [], []
    for number, control in enumerate(controls, start=1):
        step = h / SAMPLES
        for _ in range(SAMPLES):
            off = number >= SEGMENT and time + step / 2 < lit
            state = pilot.arc(time, state, step, pilot.thrust(control * (0, 1, 1) if off else control))
            time += step
            if time >= lit:
                times.append(time)
                places.append(state[:3])
    moon = np.array([pilot.state_of(MOON, moment) for moment in times])
    kernel, naif_id = target_kernel(problem)
    furnish(kernel)
    target = pilot.target_state(naif_id, time)
    miss = float(np.linalg.norm(state[:3] - target[:3]))
    return to_rotating(np.array(places), moon[:, :3], moon[:, 3:])[:, :2] / 1e3, miss


def _draw_seeds(flights: list[Flight], records: tuple[RecordWithVector, ...]) -> None:
    figure, panels = _figure(3, 11.0, 4.0)
    for axes, flight, record in zip(panels, flights, records, strict=True):
        k = len(flight.trajectories) - 1
        made = "S(0), no seed" if k == 0 else f"S({k}|0), from the seed on the left"
        _plane(axes, f"P_{k}: {made}\n{record.propellant_kg:.1f} kg")
        _bodies(axes, flight, 1)
        _track(axes, flight.trajectories[0], 1, REFERENCE, THRUST)
        for flown, colour in zip(flight.trajectories[1:], REALIZATIONS, strict=False):
            _track(axes, flown, 1, colour, lw=1.6)
        axes.set_aspect("equal", adjustable="box")
        axes.set_xlim(-250, 480)
        axes.set_ylim(-330, 330)
    _save(figure, "seeds")


def _draw_hops(records: list[RecordWithVector]) -> None:
    figure, (axes,) = _figure(1, 7.0, 3.4)
    chains: dict[int, list[tuple[int, float]]] = {}
    for record in records:
        chain, hop = (int(number) for number in record.rng_key.split("/")[-2:])
        chains.setdefault(chain, []).append((hop, record.propellant_kg))
    for number, solves in sorted(chains.items()):
        hops, propellant = np.array(sorted(solves)).T
        best = np.minimum.accumulate(propellant)
        colour = f"C{number % 10}"
        axes.step(hops, best, where="post", color=colour, lw=1.2)
        axes.plot(hops, propellant, "o", color=colour, ms=4, alpha=0.6)
    axes.set_xlabel("hop of the chain (0 is its draw)", fontsize=8)
    axes.set_ylabel("propellant, kg", fontsize=8)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.tick_params(labelsize=8)
    _save(figure, "hops")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
