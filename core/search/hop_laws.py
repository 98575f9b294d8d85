"""The distributions that hops are drawn from, one component alike to the next.

A step r is in units of the width of its component's bounds.  Every law is symmetric about zero and has one
scale, its width: r = width * (a step of width 1).  docs/method.md, section 7, eqs. S10 to S13.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Least and greatest shape of a law.  Below the least, steps would overflow: (2^53)^(1/0.1) is still finite.
SHAPES = (0.1, 10.0)
#: Where the tails are cut, in widths of the bounds.  Any other component has long reached its bound, and an
#: in-plane angle still keeps 1e-9 rad of its place after so many turns.
LONGEST_STEP = 1e6


@dataclass(frozen=True, slots=True)
class HopLaw:
    """A symmetric law of steps, with the parameters it has where none are given."""

    #: Draws (n,) steps of width 1, from a generator, n and the shape.
    draw: Callable[[np.random.Generator, int, float], Array]
    #: Width of the law [-].
    width: float
    #: Exponent of the tail [-]; None for a law that has none.
    shape: float | None = None


def _uniform(rng: np.random.Generator, n: int, shape: float) -> Array:
    return 2.0 * rng.random(n) - 1.0


def _gaussian(rng: np.random.Generator, n: int, shape: float) -> Array:
    return rng.standard_normal(n)


def _cauchy(rng: np.random.Generator, n: int, shape: float) -> Array:
    steps: Array = np.tan(np.pi * (rng.random(n) - 0.5))
    return steps


def _pareto(rng: np.random.Generator, n: int, shape: float) -> Array:
    signs = np.where(rng.random(n) < 0.5, -1.0, 1.0)
    # The generator may return 0 but never 1, and 0 has no inverse.
    steps: Array = signs * (1.0 - rng.random(n)) ** (-1.0 / shape)
    return steps


#: The laws by name, with widths from docs/method.md, section 7; the Pareto law's are EMTG's preset.
HOP_LAWS: dict[str, HopLaw] = {
    "uniform": HopLaw(_uniform, 0.1),
    "gaussian": HopLaw(_gaussian, 0.05),
    "cauchy": HopLaw(_cauchy, 1e-3),
    "pareto": HopLaw(_pareto, 2.52e-6, 1.0 / 1.4),
}


def draw_steps(
    law: str, n: int, rng: np.random.Generator, width: float | None = None, shape: float | None = None
) -> Array:
    """Return independent steps of a law, in units of the width of the bounds.

    Parameters
    ----------
    law : str
        A name of `HOP_LAWS`.
    n : int
        How many [-].
    rng : Generator
        Source of the numbers.
    width : float, optional
        Scale of the law [-]; its own where none is given.
    shape : float, optional
        Exponent of the tail [-]; its own where none is given, and without effect if it has none.

    Returns
    -------
    (n,) array
        Steps, finite and at most `LONGEST_STEP` [-].

    References
    ----------
    docs/method.md, eqs. S10 to S13.
    """
    chosen = HOP_LAWS[law]
    exponent = (chosen.shape if shape is None else shape) or np.inf
    steps = (chosen.width if width is None else width) * chosen.draw(rng, n, exponent)
    return np.clip(steps, -LONGEST_STEP, LONGEST_STEP)
