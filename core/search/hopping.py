"""Monotonic basin hopping: one chain of perturb, solve, accept, as ask and tell.

docs/method.md, section 7.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from core.nlp import Outcome
from core.search.guess_laws import GUESS_LAWS, sample_guess
from core.transcription import Transcription

Array = NDArray[np.float64]


def _uniform_hop(size: tuple[int, ...], width: float, rng: np.random.Generator) -> Array:
    return width * (2.0 * rng.random(size) - 1.0)


#: Steps per component, in units of the width of its bounds.
HOP_LAWS: dict[str, Callable[[tuple[int, ...], float, np.random.Generator], Array]] = {
    "uniform": _uniform_hop
}


def hop(x: Array, bounds: tuple[Array, Array], law: str, width: float, rng: np.random.Generator) -> Array:
    """Return a perturbed decision vector inside its bounds.

    Parameters
    ----------
    x : (n,) array
        Where to hop from [days, rad, kg].
    bounds : tuple of two (n,) arrays
        Box of x.
    law : str
        A name of `HOP_LAWS`.
    width : float
        Scale of the law, in units of the width of the bounds [-].
    rng : Generator
        Source of the numbers.
    """
    lower, upper = bounds
    step = (upper - lower) * HOP_LAWS[law](x.shape, width, rng)
    # In-plane angles wrap; clipping them would pile guesses up at +-pi.
    wraps = (upper == np.pi) & (lower == -np.pi)
    moved = x + step
    moved[wraps] = (moved[wraps] + np.pi) % (2.0 * np.pi) - np.pi
    return np.clip(moved, lower, upper)


def is_better(challenger: Outcome, incumbent: Outcome | None) -> bool:
    """Return whether an outcome beats another: feasible first, then violation, then final mass."""
    if incumbent is None:
        return True
    if challenger.is_feasible and incumbent.is_feasible:
        return challenger.objective > incumbent.objective
    return challenger.violation < incumbent.violation


class Chain:
    """The hops that follow from one start.

    Parameters
    ----------
    transcription : Transcription
        The problem.
    guess_law, hop_law : str
        Names of `GUESS_LAWS` and `HOP_LAWS`.
    hop_width : float
        Scale of the hop law [-].
    max_failures : int
        Hops in a row that may fail before the chain starts afresh [-].

    Raises
    ------
    ValueError
        When a law is unknown or a number out of range.
    """

    def __init__(
        self,
        transcription: Transcription,
        guess_law: str = "uniform",
        hop_law: str = "uniform",
        hop_width: float = 0.1,
        max_failures: int = 5,
    ) -> None:
        if guess_law not in GUESS_LAWS:
            raise ValueError(f"guess law: expected one of {', '.join(GUESS_LAWS)}, got {guess_law!r}")
        if hop_law not in HOP_LAWS:
            raise ValueError(f"hop law: expected one of {', '.join(HOP_LAWS)}, got {hop_law!r}")
        if not 0.0 < hop_width <= 1.0:
            raise ValueError(f"hop width: expected a number in (0, 1], got {hop_width}")
        if max_failures < 1:
            raise ValueError(f"max_failures: expected at least 1, got {max_failures}")
        self.transcription = transcription
        self.guess_law, self.hop_law = guess_law, hop_law
        self.hop_width, self.max_failures = hop_width, max_failures
        self.incumbent: Outcome | None = None
        self.failures = 0

    def ask(self, rng: np.random.Generator) -> Array:
        """Return the next guess (n_variables,): a fresh draw, or a hop from the incumbent."""
        if self.incumbent is None or not np.isfinite(self.incumbent.violation):
            return sample_guess(self.transcription, rng, self.guess_law)
        return hop(self.incumbent.x, self.transcription.bounds, self.hop_law, self.hop_width, rng)

    def tell(self, outcome: Outcome) -> str:
        """Take the outcome of the last guess and return "accepted", "rejected" or "restarted"."""
        if is_better(outcome, self.incumbent):
            self.incumbent, self.failures = outcome, 0
            return "accepted"
        self.failures += 1
        if self.failures < self.max_failures:
            return "rejected"
        self.incumbent, self.failures = None, 0
        return "restarted"
