"""Exports a solution to a file: trajectories, format, name.

The formats are those of `core.export`; here they get what the archive knows: whose solution, how it was
certified, by which code.  A message (OEM) is about one object, so several of them come as a ZIP.
"""

import io
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from core.constants import KERNEL_MD5
from core.ephemeris.kernels import kernel_paths
from core.export import (
    ExportedTrajectory,
    ExportError,
    csv_lines,
    export_states,
    ndjson_lines,
    oem_lines,
    write_spk,
)
from core.export.spk import FIRST_ID, body_id
from core.export.states import tdb_texts
from core.problem import problem_from
from core.world import World, world_of
from service.schemas.solution import RecordWithVector

#: Of every entry of a ZIP: when it was made is not what it says.
ZIP_DATE = (1980, 1, 1, 0, 0, 0)
ALL, REFERENCE = "all", "reference"


class ExportFormat(StrEnum):
    """What the states of a solution can be written as."""

    SPK = "spk"
    OEM = "oem"
    CSV = "csv"
    NDJSON = "ndjson"


MEDIA = {
    ExportFormat.SPK: "application/octet-stream",
    ExportFormat.OEM: "text/plain; charset=utf-8",
    ExportFormat.CSV: "text/csv",
    ExportFormat.NDJSON: "application/x-ndjson",
}
ZIP = "application/zip"
_ENDINGS = {
    ExportFormat.SPK: "bsp",
    ExportFormat.OEM: "oem",
    ExportFormat.CSV: "csv",
    ExportFormat.NDJSON: "ndjson",
}


@dataclass(frozen=True, slots=True)
class ExportedBody:
    """A trajectory in a file: its SPK identifier, and its span in TDB."""

    trajectory: str
    body_id: int
    departure_tdb: str
    arrival_tdb: str


@dataclass(frozen=True, slots=True)
class ExportedFile:
    """An exported file."""

    name: str
    media_type: str
    bodies: tuple[ExportedBody, ...]
    content: Iterator[bytes]


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is asked for."""

    format: ExportFormat
    #: "all", "reference" or the number of a realization.
    trajectory: str = ALL
    #: SPK identifier of the reference.
    first_id: int = FIRST_ID


def export_solution(
    record: RecordWithVector, definition: dict[str, Any], wanted: Wanted, created: str
) -> ExportedFile:
    """Return the trajectories of a solution as a file; `created` is its date in UTC.

    Raises
    ------
    ExportError
        When there is no such trajectory, or one cannot be written down.
    """
    numbers = _numbers(wanted.trajectory, record.k)
    problem = problem_from(definition)
    flown = export_states(problem, np.array(record.x))
    chosen = [flown[number] for number in numbers]
    content, media = _Writer(record, wanted, created, world_of(problem)).content(chosen)
    ending = "zip" if media == ZIP else _ENDINGS[wanted.format]
    return ExportedFile(
        name=f"{_stem(record, wanted.trajectory)}.{ending}",
        media_type=media,
        bodies=tuple(_body(trajectory, wanted.first_id) for trajectory in chosen),
        content=content,
    )


def _numbers(trajectory: str, k: int) -> Sequence[int]:
    if trajectory == ALL:
        return range(1 + k)
    if trajectory == REFERENCE:
        return [0]
    if trajectory.isdecimal() and 1 <= int(trajectory) <= k:
        return [int(trajectory)]
    known = "all or reference" if k == 0 else f"all, reference or a realization, 1 to {k}"
    raise ExportError(f"trajectory: expected {known}, got {trajectory!r}")


def _stem(record: RecordWithVector, trajectory: str) -> str:
    which = f"realization-{int(trajectory)}" if trajectory.isdecimal() else trajectory
    return f"coastarc-{record.id[:8]}-{which}"


def _body(trajectory: ExportedTrajectory, first_id: int) -> ExportedBody:
    departure, arrival = tdb_texts(np.array([trajectory.start_et, trajectory.stop_et]))
    return ExportedBody(trajectory.name, body_id(trajectory.index, first_id), departure, arrival)


@dataclass(frozen=True, slots=True)
class _Writer:
    """Writes trajectories of a solution in the format that is wanted."""

    record: RecordWithVector
    wanted: Wanted
    created: str
    world: World

    def content(self, chosen: Sequence[ExportedTrajectory]) -> tuple[Iterator[bytes], str]:
        """Return a file, and the type of its content."""
        made, media = self.wanted.format, MEDIA[self.wanted.format]
        if made is ExportFormat.SPK:
            return iter([_spk(chosen, "\n".join(self._about(chosen)), self.wanted.first_id)]), media
        if made is ExportFormat.CSV:
            return _encode(csv_lines(chosen, self._about(chosen))), media
        if made is ExportFormat.NDJSON:
            return _encode(ndjson_lines(chosen)), media
        if self.wanted.trajectory != ALL:
            return _encode(self._message(chosen[0])), media
        return iter([self._zip(chosen)]), ZIP

    def _about(self, chosen: Sequence[ExportedTrajectory]) -> list[str]:
        return _about(self.record, chosen, self.wanted.first_id, self.world)

    def _message(self, trajectory: ExportedTrajectory) -> Iterator[str]:
        key = str(body_id(trajectory.index, self.wanted.first_id))
        name = f"coastarc {self.record.id[:8]} {trajectory.name}"
        return oem_lines(trajectory, key, name, self.created, self._about([trajectory]))

    def _zip(self, chosen: Sequence[ExportedTrajectory]) -> bytes:
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for trajectory in chosen:
                name = f"{_stem(self.record, str(trajectory.index or REFERENCE))}.oem"
                text = "".join(self._message(trajectory))
                archive.writestr(zipfile.ZipInfo(name, ZIP_DATE), text, zipfile.ZIP_DEFLATED)
        return packed.getvalue()


def _spk(chosen: Sequence[ExportedTrajectory], comment: str, first_id: int) -> bytes:
    with tempfile.TemporaryDirectory(prefix="coastarc-") as folder:
        path = Path(folder) / "solution.bsp"
        write_spk(path, chosen, comment, first_id)
        return path.read_bytes()


def _encode(lines: Iterable[str]) -> Iterator[bytes]:
    return (line.encode() for line in lines)


def _about(
    record: RecordWithVector, chosen: Sequence[ExportedTrajectory], first_id: int, world: World
) -> list[str]:
    """Return lines of ASCII that say what a file is, where it comes from and how it is meant."""
    departure = tdb_texts(np.array([chosen[0].start_et]))[0]
    level = "strict" if record.strict else "paper"
    own = f"bodies where a kernel with BLAKE2b digest {world.digest} has them" if world.kernel else None
    return [
        f"states and controls of solution {record.id}, made by coastarc",
        f"problem {record.problem_hash} with k = {record.k}; found by search {_ascii(record.search)}, "
        f"code {_ascii(record.code_version)}",
        _frame_line(chosen[0]),
        f"units: km, km/s, kg, rad, N, days; time scale TDB; departure epoch {departure} TDB",
        "angles: azimuth in the xy-plane and elevation above it; a sample where two arcs meet stands in both",
        f"kernel de440.bsp with MD5 {KERNEL_MD5}; leap seconds of {kernel_paths()[1].name}",
        *([own] if own else []),
        f"certified at the {level} tolerance by an independent integrator; at a matchpoint the states jump",
        "by the defect, and the later arc holds; a realization flies the reference until its outage",
        *_trajectory_lines(record, chosen, first_id),
    ]


def _frame_line(trajectory: ExportedTrajectory) -> str:
    main = f"the {trajectory.main.title}" if trajectory.main else "the target"
    return (
        f"frame: origin {trajectory.center.title}, axes J2000 of SPICE, which are those of the ICRF; "
        f"{main} in the same frame"
    )


def _trajectory_lines(
    record: RecordWithVector, chosen: Sequence[ExportedTrajectory], first_id: int
) -> Iterator[str]:
    for trajectory in chosen:
        body, outage = _body(trajectory, first_id), trajectory.outage
        missed = f", outage of {outage.duration_days} days at segment {outage.segment}" if outage else ""
        jump = np.array(record.defects_verified[trajectory.index], dtype=np.float64)
        sizes = f"{np.linalg.norm(jump[:3]):.2e} km and {np.linalg.norm(jump[3:6]):.2e} km/s"
        matchpoint = tdb_texts(np.array([trajectory.matchpoint_et]))[0]
        yield f"body {body.body_id}: {body.trajectory}{missed}"
        yield f"  {body.departure_tdb} to {body.arrival_tdb} TDB; matchpoint {matchpoint}, jump {sizes}"


def _ascii(text: str) -> str:
    return text.encode("ascii", "replace").decode()
