"""Trajectories sample by sample, as CSV for spreadsheets or NDJSON (one JSON object a line) for programs.

A sample where two arcs meet stands in both, since thrust and, at a matchpoint, states differ there.
"""

import csv
import io
import json
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from core.constants import SECONDS_PER_DAY
from core.export.epochs import tdb_texts, utc_texts
from core.export.states import ExportedArc, ExportedTrajectory

COLUMNS = (
    *("trajectory", "outage_segment", "outage_days", "arc", "segment", "is_outage"),
    *("epoch_tdb", "epoch_utc", "days_past_departure"),
    *("x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s", "mass_kg"),
    *("throttle", "in_plane_rad", "out_of_plane_rad", "thrust_x_n", "thrust_y_n", "thrust_z_n"),
    *("moon_x_km", "moon_y_km", "moon_z_km"),
)


def csv_lines(trajectories: Iterable[ExportedTrajectory], head: Sequence[str]) -> Iterator[str]:
    """Yield lines of `#`, the columns, then every sample in order of time.

    Parameters
    ----------
    trajectories : iterable of ExportedTrajectory
        The reference, realizations, or some of them.
    head : sequence of str
        What the file is about.
    """
    yield "".join(f"# {line}\n" for line in head)
    yield _written([COLUMNS])
    for rows in _rows(trajectories):
        yield _written([["" if value is None else value for value in map(_plain, row)] for row in rows])


def ndjson_lines(trajectories: Iterable[ExportedTrajectory]) -> Iterator[str]:
    """Yield every sample in order of time as one JSON object a line; what has no value is null.

    Parameters
    ----------
    trajectories : iterable of ExportedTrajectory
        As for `csv_lines`.
    """
    for rows in _rows(trajectories):
        yield "".join(json.dumps(dict(zip(COLUMNS, row, strict=True))) + "\n" for row in rows)


def _plain(value: Any) -> Any:
    return str(value).lower() if isinstance(value, bool) else value


def _written(rows: Iterable[Iterable[Any]]) -> str:
    written = io.StringIO()
    csv.writer(written, lineterminator="\n").writerows(rows)
    return written.getvalue()


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
