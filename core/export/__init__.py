"""A solution exported: its trajectories as states, and these as SPK, CCSDS OEM, CSV or NDJSON.

`states` propagates the reference and every realization and writes tables; `spk` and `oem` write one format.
"""

from core.export.oem import oem_lines
from core.export.spk import write_spk
from core.export.states import (
    ExportedArc,
    ExportedTrajectory,
    ExportError,
    csv_lines,
    export_states,
    ndjson_lines,
    trajectory_name,
)

__all__ = [
    "ExportError",
    "ExportedArc",
    "ExportedTrajectory",
    "csv_lines",
    "export_states",
    "ndjson_lines",
    "oem_lines",
    "trajectory_name",
    "write_spk",
]
