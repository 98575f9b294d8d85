"""The paper's motivating example, and its figure: an outage of 60 hours on the first burn of a transfer.

The nominal transfer is solved from a stored guess, the recovery from the rest of the nominal one; both are
verified independently.  The paper's trajectory is not public, so the numbers differ.
"""

import json
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from core.analysis.flight import Flight, FlownTrajectory, fly
from core.analysis.missed_thrust import attempt, missed_thrust
from core.analysis.safe_modes import THRUSTING
from core.constants import SECONDS_PER_DAY
from core.epochs import calendar_epoch, seconds_past_j2000
from core.nlp import solve
from core.orbits import departure_state
from core.problem import Problem, load_problem
from core.search import solve_recovery
from core.transcription import transcribe
from core.verification.verify import verify
from service.report.paper.values import FLAGSHIP
from service.report.style import GREEN, INK, ORANGE, SERIES, WIDTH, as_png, as_svg, figure_style, lay_out
from service.schemas.answer import Answer

Array = NDArray[np.float64]

OUTAGE_DAYS = 2.5
#: Start of the spiral that ends in the preset's departure; examples/spiral.toml.
SPIRAL_EPOCH = "2025-11-01T00:00:00"


class ExampleFailedError(RuntimeError):
    """A solve of the example that does not converge on this machine."""


class Side(Answer):
    """The nominal transfer, or the one under the outage."""

    #: Since the departure from the spiral, and with the spiral.
    propellant_kg: float
    propellant_total_kg: float
    final_mass_kg: float
    #: End of the last burn, after which it coasts on the target.
    last_burn_epoch: str
    #: Until then, since the departure from the spiral and since the start of the spiral.
    transfer_days: float
    flight_days: float
    #: Time average from the start of the outage to the end of the last burn.
    mean_throttle: float
    #: Largest position defect by the verifier.
    position_defect_km: float


class MotivatingView(Answer):
    """Cost of the outage."""

    outage_segment: int
    outage_days: float
    outage_epoch: str
    nominal: Side
    recovered: Side
    propellant_change_kg: float
    arrival_change_days: float
    mean_throttle_change_percent: float
    strict: bool


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """The example with the trajectories to draw."""

    view: MotivatingView
    problem: Problem
    flight: Flight


def motivating() -> Example:
    """Solve, miss the first burn, recover and verify; takes up to a minute.

    Raises
    ------
    ExampleFailedError
        When one of the two solves does not converge on this machine.
    """
    problem = load_problem(FLAGSHIP)
    nominal = solve(transcribe(problem), _start())
    if not nominal.is_feasible:
        raise ExampleFailedError(f"nominal transfer: expected a solution, got {nominal.status.name}")
    robust = problem.with_outages([(_first_burn(problem, nominal.x), OUTAGE_DAYS)])
    recovered = solve_recovery(problem, nominal.x, robust)
    if not recovered.is_feasible:
        raise ExampleFailedError(f"recovery: expected a solution, got {recovered.status.name}")
    return Example(_view(robust, recovered.x), robust, fly(robust, recovered.x))


def _start() -> Array:
    """Return the stored guess of the nominal transfer."""
    text = (files("service.report.paper") / "motivating.json").read_text(encoding="utf-8")
    stored = json.loads(text)
    controls = np.array(stored["controls"]).ravel()
    return np.concatenate([stored["times_days"], controls, [stored["final_mass_kg"]]])


def _first_burn(problem: Problem, x: Array) -> int:
    """Return the first segment of a reference that thrusts, counted from 1."""
    return int(np.flatnonzero(x[3 : 3 + 3 * problem.n_segments : 3] > THRUSTING)[0]) + 1


def _view(problem: Problem, x: Array) -> MotivatingView:
    flown = fly(problem, x).trajectories
    judged = verify(problem, x)
    found = missed_thrust(problem, x, [attempt(problem, x)])
    begun, late = float(found.starts_days[0]), float(found.delay_days[0, 0])
    arrivals = (found.arrival_days, found.arrival_days + late)
    masses = (found.final_mass_kg, found.final_mass_kg - float(found.propellant_kg[0, 0]))
    nominal, recovered = (
        _side(problem, flown[i], begun, arrivals[i], masses[i], float(judged.position_km[i])) for i in (0, 1)
    )
    return MotivatingView(
        outage_segment=problem.outages[0].segment,
        outage_days=OUTAGE_DAYS,
        outage_epoch=_epoch(problem, begun),
        nominal=nominal,
        recovered=recovered,
        propellant_change_kg=recovered.propellant_kg - nominal.propellant_kg,
        arrival_change_days=late,
        mean_throttle_change_percent=100.0 * (recovered.mean_throttle / nominal.mean_throttle - 1.0),
        strict=judged.strict,
    )


def _side(
    problem: Problem, flown: FlownTrajectory, begun: float, arrival: float, mass: float, defect: float
) -> Side:
    start = departure_state(problem.departure, problem.spacecraft)
    spiral = (start.et - seconds_past_j2000(SPIRAL_EPOCH)) / SECONDS_PER_DAY
    return Side(
        propellant_kg=start.mass_kg - mass,
        propellant_total_kg=problem.spacecraft.wet_mass_kg - mass,
        final_mass_kg=mass,
        last_burn_epoch=_epoch(problem, arrival),
        transfer_days=arrival,
        flight_days=spiral + arrival,
        mean_throttle=mean_throttle(flown, begun, arrival),
        position_defect_km=defect,
    )


def mean_throttle(flown: FlownTrajectory, begin: float, end: float) -> float:
    """Return the time average of the throttle between two epochs [days past departure]."""
    total = 0.0
    for arc in flown.arcs:
        a, b = flown.days[arc.first], flown.days[arc.stop - 1]
        total += arc.throttle * max(0.0, min(b, end) - max(a, begin))
    return float(total / (end - begin))


def _epoch(problem: Problem, days: float) -> str:
    start = departure_state(problem.departure, problem.spacecraft)
    return calendar_epoch(start.et + days * SECONDS_PER_DAY)


#: Of the two trajectories: name and colour.
NOMINAL, RECOVERED = ("nominal", GREEN), ("under the outage", SERIES[4])


def write_motivating(flight: Flight, folder: Path) -> list[Path]:
    """Draw the example into a folder, as SVG and as PNG; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    with figure_style():
        figure = motivating_figure(flight)
        lay_out(figure)
        svg, png = folder / "motivating.svg", folder / "motivating.png"
        svg.write_text(as_svg(figure), encoding="utf-8", newline="")
        png.write_bytes(as_png(figure))
    return [svg, png]


def motivating_figure(flight: Flight) -> Figure:
    """Return paths in the rotating frame above masses and throttles over time."""
    figure = Figure(figsize=(WIDTH, 7.0), layout="constrained")
    path, mass, throttle = figure.subplots(3, 1, height_ratios=(3.2, 1.0, 1.0))
    _paths(path, flight)
    nominal, recovered = flight.trajectories
    begin, end = _outage(recovered)
    last = max(
        flown.days[arc.stop - 1] for flown in flight.trajectories for arc in flown.arcs if arc.throttle
    )
    for axes in (mass, throttle):
        axes.axvspan(begin, end, color=ORANGE, alpha=0.22, linewidth=0.0)
        axes.set_xlim(0.0, max(nominal.days[-1], recovered.days[-1]))
    for flown, (name, colour) in ((nominal, NOMINAL), (recovered, RECOVERED)):
        mass.plot(flown.days, flown.mass_kg, color=colour, label=name)
        days, throttles = _steps(flown)
        throttle.plot(days, throttles, color=colour, linewidth=1.1)
        throttle.axhline(mean_throttle(flown, begin, last), color=colour, linewidth=1.0, linestyle="--")
    mass.set(ylabel="mass, kg")
    mass.tick_params(labelbottom=False)
    throttle.set(xlabel="days since the end of the spiral", ylabel="throttle", ylim=(-0.04, 1.08))
    return figure


def _paths(axes: Axes, flight: Flight) -> None:
    nominal, recovered = flight.trajectories
    scale = 1e-3
    for flown, (name, colour) in ((nominal, NOMINAL), (recovered, RECOVERED)):
        axes.plot(*(flown.rotating_km[:, :2] * scale).T, color=colour, linewidth=1.1, label=name)
    target = flight.target.rotating_km[:, :2] * scale
    axes.plot(*target.T, color=SERIES[0], linewidth=1.3, label="target orbit", zorder=4)
    drift = next(arc for arc in recovered.arcs if arc.kind == "outage")
    missed = recovered.rotating_km[drift.first : drift.stop, :2] * scale
    axes.plot(*missed.T, color=ORANGE, linewidth=2.4, label="outage, 60 h", zorder=5)
    axes.plot(0.0, 0.0, "o", color=INK, markersize=6)
    axes.plot(384.4, 0.0, "o", color=INK, markersize=4, zorder=6)
    for text, x, shift in (("Earth", 0.0, (8, -3)), ("Moon", 384.4, (-34, 4))):
        axes.annotate(text, (x, 0.0), shift, textcoords="offset points", fontsize=8.0)
    axes.set_aspect("equal")
    axes.set(xlabel="towards the Moon, thousand km", ylabel="across, thousand km")
    axes.legend(loc="lower right")


def _outage(flown: FlownTrajectory) -> tuple[float, float]:
    """Return when the outage of a realization begins and ends [days past departure]."""
    arc = next(arc for arc in flown.arcs if arc.kind == "outage")
    return float(flown.days[arc.first]), float(flown.days[arc.stop - 1])


def _steps(flown: FlownTrajectory) -> tuple[np.ndarray, np.ndarray]:
    """Return the throttle as a line of steps over the days past departure."""
    days = np.array([[flown.days[arc.first], flown.days[arc.stop - 1]] for arc in flown.arcs])
    return days.ravel(), np.repeat([arc.throttle for arc in flown.arcs], 2)
