"""The identity of a solution, which is the same in every archive."""

import hashlib
from typing import Any

import numpy as np


def solution_hash(problem_hash: str, x: Any) -> str:
    """Return the identity of a solution: its problem and every bit of its vector."""
    vector = np.ascontiguousarray(x, dtype="<f8")
    return hashlib.blake2b(bytes.fromhex(problem_hash) + vector.tobytes(), digest_size=16).hexdigest()
