"""Unreported outcomes as files, so that they outlive the dispatcher that holds them.

A file is the body of `POST /jobs/complete` as it stands, `job-17-attempt-1.json`, written whole or not at
all.  The next dispatcher of the same folder offers what it finds there.  What is refused for good is moved to
`refused`, where somebody may look at it, mend the reason and move it back.
"""

import logging
import os
from collections.abc import Iterator
from pathlib import Path

from pydantic import ValidationError

from workers.messages import CompleteRequest, Ended, Finished, Ticket, sealed

log = logging.getLogger(__name__)


class Outbox:
    """A folder of reports; a disk that takes none is logged, and never stops the work."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def reports(self) -> Iterator[Finished]:
        """Yield the outcomes that an earlier dispatcher could not report."""
        for path in sorted(self.folder.glob("job-*.json")):
            try:
                report = CompleteRequest.model_validate_json(path.read_bytes())
                yield Finished(report.ticket, sealed(Ended, report.outcome), report.job_digest)
            except (OSError, ValidationError) as error:
                log.error(
                    "outcome %s: expected a report of this version, got %s; left where it is", path, error
                )

    def put(self, report: Finished) -> bool:
        """Write a report; return whether it is on disk."""
        return self._write(self.folder, report) is not None

    def remove(self, ticket: Ticket) -> None:
        """Delete a report that was accepted."""
        try:
            (self.folder / _name(ticket)).unlink(missing_ok=True)
        except OSError as error:
            # It is offered again after the next start, and answered as a report that came twice.
            log.warning("outcome of job %d: expected to remove its file, got %s", ticket.job_id, error)

    def set_aside(self, report: Finished) -> Path | None:
        """Move a report to the rejected ones; return its path."""
        path = self._write(self.folder / "refused", report)
        if path is not None:
            self.remove(report.ticket)
        return path

    def _write(self, folder: Path, report: Finished) -> Path | None:
        path = folder / _name(report.ticket)
        draft = path.with_name(f"{path.name}.{os.getpid()}")
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            # Results are for their owner alone, as the archive is.
            descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
                stream.write(report.to_json())
            draft.replace(path)
        except OSError as error:
            log.error("outcome of job %d: expected room for %s, got %s", report.ticket.job_id, path, error)
            return None
        return path


def _name(ticket: Ticket) -> str:
    return f"job-{ticket.job_id}-attempt-{ticket.attempt}.json"
