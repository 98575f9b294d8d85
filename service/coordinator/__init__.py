"""The server process of a data folder: one writer with web server, reaper and dispatcher."""

from service.coordinator.coordinator import Coordinator, CoordinatorError, WebServer, WorkerSetup, open_port

__all__ = ["Coordinator", "CoordinatorError", "WebServer", "WorkerSetup", "open_port"]
