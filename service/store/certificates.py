"""Certificates of solutions: stored, found again, and shown."""

from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import not_, or_, select
from sqlalchemy.orm import Session

from service.db.engine import Database
from service.db.tables import CertificateRow, ProblemRow, SolutionRow
from service.store.errors import UnknownRow
from service.store.filter import Filter
from service.store.page import Begin, Order, ids_of_page
from workers.certificate import CertificateContent, CertificateDocument

#: The basis of a certificate that was taken in from another installation, until it is found again here.
ELSEWHERE = ""


class Subject(NamedTuple):
    """A solution that is to be certified."""

    id: str
    definition: dict[str, Any]
    x: NDArray[np.float64]
    #: What it was verified at when it was stored.
    level: str


class Certificates:
    """The certificates of an archive; every call is one transaction."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, document: CertificateDocument, basis: str) -> bool:
        """Store a certificate, or that the same one was found again; return whether it is new."""
        return self._database.write(lambda session: _add(session, document, basis))

    def latest(self, solution_id: str) -> CertificateDocument | None:
        """Return the certificate of a solution that was found last, or None where it has none."""
        with self._database.read() as session:
            return _latest(session, solution_id)

    def ids(self, wanted: Filter) -> list[str]:
        """Return the solutions that a filter leaves to be certified, the most final mass first."""
        with self._database.read() as session:
            return ids_of_page(session, wanted, Order(), Begin(), None)[0]

    def subject(self, solution_id: str) -> Subject:
        """Return what is certified about a solution."""
        with self._database.read() as session:
            return _subject(session, solution_id)

    def sound_on(self, basis: str) -> set[str]:
        """Return the solutions found sound, and no worse than archived, on a basis."""
        is_no_worse = or_(CertificateRow.level == "strict", not_(SolutionRow.strict))
        found = (
            select(CertificateRow.solution_id)
            .join(SolutionRow, SolutionRow.id == CertificateRow.solution_id)
            .where(CertificateRow.basis == basis, CertificateRow.is_sound, is_no_worse)
        )
        with self._database.read() as session:
            return set(session.scalars(found))


def _subject(session: Session, solution_id: str) -> Subject:
    row = _solution(session, solution_id)
    level = "strict" if row.strict else "paper" if row.paper else "none"
    return Subject(row.id, session.get_one(ProblemRow, row.problem_hash).definition, row.x, level)


def _add(session: Session, document: CertificateDocument, basis: str) -> bool:
    content = document.content
    known = session.get(CertificateRow, (content.solution_id, document.hash))
    if known is not None:
        known.basis, known.checked_at = basis, document.checked_at.timestamp()
        return False
    row = CertificateRow(
        solution_id=content.solution_id,
        hash=document.hash,
        basis=basis,
        level=content.level,
        is_sound=content.is_sound,
        content=content.model_dump(mode="json"),
        made_on=document.made_on,
        made_at=document.made_at.timestamp(),
        cpu_seconds=document.cpu_seconds,
        checked_at=document.checked_at.timestamp(),
    )
    session.add(row)
    return True


def latest_row(session: Session, solution_id: str) -> CertificateRow | None:
    """Return the certificate of a solution that was found last."""
    own = select(CertificateRow).where(CertificateRow.solution_id == solution_id)
    return session.scalar(own.order_by(CertificateRow.checked_at.desc(), CertificateRow.hash).limit(1))


def _latest(session: Session, solution_id: str) -> CertificateDocument | None:
    _solution(session, solution_id)
    row = latest_row(session, solution_id)
    if row is None:
        return None
    return CertificateDocument(
        content=CertificateContent.model_validate(row.content),
        hash=row.hash,
        made_at=datetime.fromtimestamp(row.made_at, UTC),
        made_on=row.made_on,
        cpu_seconds=row.cpu_seconds,
        checked_at=datetime.fromtimestamp(row.checked_at, UTC),
        is_from_elsewhere=row.basis == ELSEWHERE,
    )


def _solution(session: Session, solution_id: str) -> SolutionRow:
    row = session.get(SolutionRow, solution_id)
    if row is None:
        raise UnknownRow("solution", solution_id)
    return row
