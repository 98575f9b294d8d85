"""The certificate of a benchmark's solution as a file, and what in it another machine has to find as well."""

import math
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from core.errors import fault_lines
from core.problem import content_hash
from service.benchmark.benchmark_set import BenchmarkError, read_text
from workers.certify import CertificateContent, CertificateFile

#: A flight on another machine rounds otherwise; the masses of the vector do not.
MASS_KG = 1e-9
#: Fields of the content that every machine finds.
SAME = ("problem_hash", "solution_id", "k", "level", "is_sound", "failure")


def read_certificate(path: Path) -> CertificateContent:
    """Return the content of a certificate that has the hash it names."""
    try:
        found = CertificateFile.model_validate_json(read_text(path))
    except ValidationError as error:
        (first, *_) = fault_lines(str(path), error.errors(include_url=False), CertificateFile)
        raise BenchmarkError(first) from error
    if content_hash(found.content.model_dump(mode="json")) != found.hash:
        raise BenchmarkError(f"{path}: expected the hash of its content, got {found.hash}")
    return found.content


def differences(stated: CertificateContent, found: CertificateContent) -> list[str]:
    """Return in what a certificate contradicts another flight of the same solution."""
    pairs = [(name, getattr(stated, name), getattr(found, name)) for name in SAME]
    pairs.append(("arrival_epoch", _arrivals(stated), _arrivals(found)))
    faults = [f"{name}: {ours} stated, {theirs} found" for name, ours, theirs in pairs if ours != theirs]
    ours, theirs = _masses(stated), _masses(found)
    if len(ours) != len(theirs) or not np.allclose(ours, theirs, rtol=0.0, atol=MASS_KG):
        faults.append(f"stated_arrival: {ours} stated, {theirs} found")
    return faults


def largest_miss_km(content: CertificateContent) -> float:
    """Return the largest miss at arrival [km], infinite where a trajectory was not flown so far."""
    misses = [flown.through.arrival_miss[0] for flown in content.trajectories]
    return max(math.inf if miss is None else miss for miss in misses)


def _arrivals(content: CertificateContent) -> list[str]:
    return [flown.arrival_epoch for flown in content.trajectories]


def _masses(content: CertificateContent) -> list[float]:
    return [flown.mass.stated_arrival for flown in content.trajectories]
