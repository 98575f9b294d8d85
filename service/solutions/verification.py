"""Certifies the solutions of an archive, in parallel.

Every certificate is stored as soon as it is made, so an interruption loses nothing but the flights under way.

    VerificationError(ValueError)   a wish for solutions that cannot be met, or a process that was killed
"""

import multiprocessing
import signal
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import islice

import numpy as np
from pydantic import BaseModel

from core.errors import UserError
from core.verification.certificate import lowest_passages
from service.schemas.solution import Filter
from service.store.solutions import Subject
from service.store.store import Store
from workers.certificate import CertificateDocument

#: How trustworthy a level is.
RANKS = {"none": 0, "paper": 1, "strict": 2}
#: Solutions handed to a process before its last one is done.
AHEAD = 2


class VerificationError(UserError, ValueError):
    """Solutions that cannot be verified as requested, or a verification process that was killed."""


@dataclass(frozen=True, slots=True)
class VerificationRequest:
    """What is asked of every certificate."""

    #: Lowest passage of the Earth or the Moon that is not marked [km]; None for the defaults of each.
    min_altitude_km: float | None = None
    #: Whether heyoka flies too.
    with_heyoka: bool = False

    def __post_init__(self) -> None:
        try:
            lowest_passages(self.min_altitude_km)
        except ValueError as error:
            raise VerificationError(str(error)) from error


class Verified(BaseModel):
    """How the verification of one solution ended."""

    solution_id: str
    #: As archived, and as certified; no certificate where the flight could not even begin.
    level_before: str
    level: str
    is_sound: bool
    #: Sound, and no worse than archived.
    is_good: bool
    #: Whether the level differs with the integrator's tolerance; None where it was not flown.
    is_marginal: bool | None = None
    #: Largest of its trajectories [km].
    arrival_miss_km: float | None = None
    #: Lowest of its trajectories [km].
    earth_altitude_km: float | None = None
    moon_altitude_km: float | None = None
    #: How far heyoka's flights are from SciPy's, at most [km]; None where heyoka did not fly.
    third_apart_km: float | None = None
    hash: str | None = None
    #: Whether no certificate with this content was there before.
    is_new: bool = False
    cpu_seconds: float = 0.0
    #: Why it is not good.
    reasons: list[str] = []


class Summary(BaseModel):
    """How the verification of some solutions ended: what `coastarc solutions verify --json` prints."""

    n_wanted: int
    n_verified: int
    n_failed: int
    #: Left out, since they were found sound with the same code, packages and settings.
    n_skipped: int
    is_complete: bool
    items: list[Verified]


def wanted_ids(store: Store, prefixes: Sequence[str], campaign: str | None, *, is_all: bool) -> list[str]:
    """Return the ids of the solutions that a user names, in one of three ways."""
    ways = [bool(prefixes), campaign is not None, is_all]
    if sum(ways) != 1:
        raise VerificationError(
            f"verify: expected ids of solutions, --campaign or --all, got {sum(ways) or 'none'} of these"
        )
    if prefixes:
        return list(dict.fromkeys(store.find_solution(prefix) for prefix in prefixes))
    owner = None if campaign is None else store.find_campaign(campaign)
    return store.certificates.ids(Filter(campaign=owner))


def require_heyoka() -> None:
    """Refuse to fly with heyoka where it is not installed."""
    if find_spec("heyoka") is None:
        raise VerificationError(
            "--with-heyoka: expected the package heyoka, got none; install it, in a clone of the repository, "
            "by `pip install -c constraints.txt -e '.[heyoka]'`"
        )


def fresh_ids(store: Store, ids: Sequence[str], asked: VerificationRequest) -> list[str]:
    """Return those that were not found sound with this code, these packages, and as asked."""
    from workers.certify import basis

    known = store.certificates.sound_on(basis(asked.min_altitude_km, with_heyoka=asked.with_heyoka))
    return [one for one in ids if one not in known]


def verify_solutions(
    store: Store, ids: Sequence[str], asked: VerificationRequest, n_processes: int = 1
) -> Iterator[Verified]:
    """Certify solutions, store each certificate, and yield how each one went as it is done."""
    from workers.certify import basis

    here = basis(asked.min_altitude_km, with_heyoka=asked.with_heyoka)
    subjects = (store.certificates.subject(one) for one in ids)
    for subject, found in _certify_all(subjects, asked, n_processes):
        if isinstance(found, str):
            reasons = [f"cannot be flown: {found}"]
            yield Verified(
                solution_id=subject.id,
                level_before=subject.level,
                level="none",
                is_sound=False,
                is_good=False,
                reasons=reasons,
            )
        else:
            yield _judge(subject, found, store.certificates.add(found, here))


def _judge(subject: Subject, found: CertificateDocument, is_new: bool) -> Verified:
    content = found.content
    reasons = [*content.marks, *([content.failure] if content.failure else [])]
    is_worse = RANKS[content.level] < RANKS[subject.level]
    if content.is_marginal:
        reasons.append(
            "marginal: its level differs between two tolerances of the integrator, 1e-13 and 2.3e-14"
        )
    if is_worse:
        reasons.append(f"expected defects within the {subject.level} tolerance, got {content.level}")
    misses = [trajectory.through.arrival_miss[0] for trajectory in content.trajectories]
    closest = [approach for trajectory in content.trajectories for approach in trajectory.closest]
    lowest = {
        body: min((one.altitude_km for one in closest if one.body == body), default=None)
        for body in ("Earth", "Moon")
    }
    third = content.third.trajectories if content.third else ()
    return Verified(
        solution_id=subject.id,
        level_before=subject.level,
        level=content.level,
        is_sound=content.is_sound,
        is_good=content.is_sound and not is_worse,
        is_marginal=content.is_marginal,
        arrival_miss_km=None if None in misses else max(miss for miss in misses if miss is not None),
        earth_altitude_km=lowest["Earth"],
        moon_altitude_km=lowest["Moon"],
        third_apart_km=max((one.apart[0] for one in third if one.apart[0] is not None), default=None),
        hash=found.hash,
        is_new=is_new,
        cpu_seconds=found.cpu_seconds,
        reasons=reasons,
    )


def _certify_all(
    subjects: Iterable[Subject], asked: VerificationRequest, n_processes: int
) -> Iterator[tuple[Subject, CertificateDocument | str]]:
    if n_processes == 1:
        for subject in subjects:
            yield subject, _certify(subject, asked)
        return
    # SPICE keeps state in global variables, so processes begin anew instead of as copies.
    pool = ProcessPoolExecutor(n_processes, multiprocessing.get_context("spawn"), _leave_signals_to_parent)
    try:
        rest = iter(subjects)
        flying: dict[Future[CertificateDocument | str], Subject] = {}
        while True:
            for subject in islice(rest, AHEAD * n_processes - len(flying)):
                flying[pool.submit(_certify, subject, asked)] = subject
            if not flying:
                return
            for future in wait(flying, return_when=FIRST_COMPLETED).done:
                yield flying.pop(future), _propagate(future)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _propagate(future: Future[CertificateDocument | str]) -> CertificateDocument | str:
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise VerificationError(
            "verification: expected its processes to stay alive, got one that was killed, for lack of memory "
            "perhaps; what was done is kept, and --stale goes on with the rest"
        ) from error


def _leave_signals_to_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _certify(subject: Subject, asked: VerificationRequest) -> CertificateDocument | str:
    """Return the certificate of a solution, or why its problem cannot be flown on this machine."""
    from core.problem import ProblemError, problem_from
    from workers.certify import certificate_of

    try:
        problem = problem_from(subject.definition)
        return certificate_of(
            subject.id, problem, np.array(subject.x), asked.min_altitude_km, with_heyoka=asked.with_heyoka
        )
    except (ProblemError, OSError) as error:
        return str(error)
