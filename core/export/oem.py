"""One trajectory as an Orbit Ephemeris Message: CCSDS 502.0-B-2, version 2.0, in keywords and values.

A message describes one object, so every trajectory has its own.  Its segments are the arcs: between two of
them the control changes, and interpolation must not cross.  Mass and thrust, for which the message has
no field, are in the comments of each segment.
"""

from collections.abc import Iterator, Sequence

from core.export.states import ExportedArc, ExportedTrajectory, tdb_texts

#: Kept short, since the standard ends lines at 254 characters.
_LONGEST = 240


def oem_lines(
    trajectory: ExportedTrajectory, object_id: str, object_name: str, created: str, comment: Sequence[str]
) -> Iterator[str]:
    """Yield the text of a message, arc by arc.

    Parameters
    ----------
    trajectory : ExportedTrajectory
        The reference or a realization.
    object_id, object_name : str
        What the object is called.
    created : str
        Date of the message, UTC as YYYY-MM-DDTHH:MM:SS.
    comment : sequence of str
        Lines on where it comes from.
    """
    yield _lines(
        "CCSDS_OEM_VERS = 2.0",
        *(f"COMMENT {line[:_LONGEST]}" for line in comment if line),
        f"CREATION_DATE = {created}",
        "ORIGINATOR = COASTARC",
        "",
    )
    for arc in trajectory.arcs:
        yield from _segment(arc, object_id, object_name, trajectory.center.name)


def _segment(arc: ExportedArc, object_id: str, object_name: str, center: str) -> Iterator[str]:
    epochs = tdb_texts(arc.et)
    yield _lines(
        "META_START",
        *(f"COMMENT {line}" for line in _about(arc)),
        f"OBJECT_NAME = {object_name}",
        f"OBJECT_ID = {object_id}",
        f"CENTER_NAME = {center}",
        "REF_FRAME = ICRF",
        "TIME_SYSTEM = TDB",
        f"START_TIME = {epochs[0]}",
        f"STOP_TIME = {epochs[-1]}",
        "INTERPOLATION = HERMITE",
        f"INTERPOLATION_DEGREE = {arc.degree}",
        "META_STOP",
        "",
    )
    # A nanometre and 1e-15 km/s, below what a double holds of most of them.
    rows = arc.states[:, :6].tolist()
    yield _lines(*(f"{epoch} {_numbers(row)}" for epoch, row in zip(epochs, rows, strict=True)), "")


def _about(arc: ExportedArc) -> Iterator[str]:
    x, y, z = arc.thrust_n.tolist()
    yield f"{arc.kind}{f', segment {arc.segment}' if arc.segment else ''}; throttle {arc.throttle:.9f}"
    yield f"thrust in the axes of the frame {x:.9f} {y:.9f} {z:.9f} N"
    yield f"mass {arc.states[0, 6]:.6f} kg at the start, {arc.states[-1, 6]:.6f} kg at the end"


def _numbers(row: Sequence[float]) -> str:
    return " ".join([*(f"{value:.12f}" for value in row[:3]), *(f"{value:.15f}" for value in row[3:])])


def _lines(*lines: str) -> str:
    return "".join(f"{line}\n" for line in lines)
