"""The process that serves: a data folder in, one writer with its web server, reaper and dispatcher out."""

from service.coordinator.coordinator import Coordinator, CoordinatorError, WebServer, WorkerSetup, open_port

__all__ = ["Coordinator", "CoordinatorError", "WebServer", "WorkerSetup", "open_port"]
