"""Trajectories as an SPK: one body for each, one segment of Hermite polynomials (type 13) for each arc.

Frame: J2000 axes, origin at the centre of the world.  Where two arcs meet, SPICE answers from the later one.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import spiceypy

from core.ephemeris.kernels import one_at_a_time
from core.ephemeris.spk import new_spk
from core.export.states import ExportedArc, ExportedTrajectory

#: Identifier of a reference; realization i has the one that is i less.
FIRST_ID = -60100


def body_id(index: int, first_id: int = FIRST_ID) -> int:
    """Return the identifier of a trajectory, the reference being number 0."""
    return first_id - index


@one_at_a_time
def write_spk(
    path: Path, trajectories: Sequence[ExportedTrajectory], comment: str, first_id: int = FIRST_ID
) -> None:
    """Write trajectories as an SPK, atomically.

    Parameters
    ----------
    path : Path
        File to make or replace; its folder exists.
    trajectories : sequence of ExportedTrajectory
        The reference, realizations, or some of them.
    comment : str
        Text for the comment area, in ASCII.
    first_id : int
        Identifier of the reference [-]; realization i has the one that is i less.
    """
    with new_spk(path, comment) as handle:
        for trajectory in trajectories:
            for arc in trajectory.arcs:
                _add(
                    handle,
                    body_id(trajectory.index, first_id),
                    f"{trajectory.name}, {_label(arc)}",
                    arc,
                    trajectory.center.naif_id,
                )


def _add(handle: int, body: int, label: str, arc: ExportedArc, center: int) -> None:
    spiceypy.spkw13(
        handle,
        body,
        center,
        "J2000",
        float(arc.et[0]),
        float(arc.et[-1]),
        label,
        arc.degree,
        len(arc.et),
        np.ascontiguousarray(arc.states[:, :6]),
        arc.et,
    )


def _label(arc: ExportedArc) -> str:
    return f"segment {arc.segment}" if arc.segment else arc.kind
