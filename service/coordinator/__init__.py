"""The server process of a data folder: one writer with web server, reaper and dispatcher.

A name is imported when it is first asked for: whoever takes the lock of a folder needs no web server.
"""

from typing import TYPE_CHECKING

from core.lazy import on_demand

if TYPE_CHECKING:
    from service.coordinator.coordinator import (
        Coordinator,
        CoordinatorError,
        WebServer,
        WorkerSetup,
        open_port,
    )

__all__ = ["Coordinator", "CoordinatorError", "WebServer", "WorkerSetup", "open_port"]

__getattr__ = on_demand(__name__, dict.fromkeys(__all__, "coordinator"))
