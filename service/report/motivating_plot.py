"""The motivating example as the paper draws it: both paths, and mass and throttle beside each other."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from core.analysis.flight import Flight, FlownTrajectory
from service.missed_thrust.motivating import mean_throttle
from service.report.style import GREEN, INK, ORANGE, SERIES, WIDTH, as_png, as_svg, house_style, lay_out

#: Of the two trajectories: name and colour.
NOMINAL, RECOVERED = ("nominal", GREEN), ("under the outage", SERIES[4])


def write_motivating(flight: Flight, folder: Path) -> list[Path]:
    """Draw the example into a folder, as SVG and as PNG; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    with house_style():
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
