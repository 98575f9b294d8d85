"""Workers: they register with every claim and heartbeat, and must compute what the coordinator would."""

import platform
from typing import Any

from sqlalchemy import bindparam, select, update
from sqlalchemy.orm import Session

from service.db.dialect import insert_new, plain
from service.db.tables import JobRow, WorkerRow
from service.schemas.job import WorkerPage
from service.store.errors import WorkerRefusedError
from workers.messages import WorkerInfo
from workers.provenance import code_version

#: Columns that a view takes over as they are.
SHOWN = (*WorkerInfo.model_fields, "created_at", "seen_at")


_AGAIN = update(plain(WorkerRow)).where(plain(WorkerRow).c.name == bindparam("known"))


def register(session: Session, info: WorkerInfo, now: float) -> None:
    """Store what a worker says about itself, or refuse it."""
    _require_same(info)
    row = info.model_dump() | {"seen_at": now}
    if not insert_new(session, WorkerRow, row | {"created_at": now}):
        session.connection().execute(_AGAIN, row | {"known": info.name})


def _require_same(info: WorkerInfo) -> None:
    """Other code or another Python would give other numbers under the same rng_seed."""
    ours = (code_version(), _minor(platform.python_version()))
    theirs = (info.code_version, _minor(info.python_version))
    if theirs != ours:
        raise WorkerRefusedError(
            f"worker {info.name}: expected coastarc {ours[0]} on Python {ours[1]}, got {theirs[0]} on Python "
            f"{theirs[1]}; install the coordinator's version where it runs, and start it again"
        )


def _minor(python_version: str) -> str:
    return ".".join(python_version.split(".")[:2])


def list_workers(session: Session, now: float, alive_s: float, limit: int = 200) -> WorkerPage:
    """Return the workers, those seen last first, with the jobs that each holds."""
    rows = session.scalars(select(WorkerRow).order_by(WorkerRow.seen_at.desc(), WorkerRow.name).limit(limit))
    workers = {row.name: row for row in rows}
    query = (
        select(JobRow.worker, JobRow.id.label("job_id"), JobRow.attempt, JobRow.lease_until)
        .where(JobRow.state == "running", JobRow.worker.in_(list(workers)))
        .order_by(JobRow.id)
    )
    held: dict[str, list[dict[str, Any]]] = {name: [] for name in workers}
    for job in session.execute(query).mappings():
        fields = dict(job)
        held[fields.pop("worker")].append(fields)
    items = [
        {column: getattr(row, column) for column in SHOWN}
        | {"is_alive": abs(row.seen_at - now) < alive_s, "held": held[row.name]}
        for row in workers.values()
    ]
    return WorkerPage.model_validate({"items": items})
