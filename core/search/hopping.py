"""Monotonic basin hopping: one chain of perturb, solve, accept, as ask and tell.

docs/method.md, section 7.

The distributions that hops are drawn from, one component alike to the next.

A step r is in units of the width of its component's bounds.  Every law is symmetric about zero and has one
scale, its width: r = width * (a step of width 1).  docs/method.md, section 7, eqs. S10 to S13.

Where a hop stands in a campaign, and the random numbers that follow from that alone.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.nlp import Outcome
from core.search.guess_laws import GUESS_LAWS, sample_guess
from core.transcription import Transcription

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


Indices = NDArray[np.intp]

#: How fast an adaptive width learns, and the share of successes at which it stands still [-]; eq. S14.
LEARNING_RATE, SUCCESS_SHARE = 0.3, 0.05
#: Least and greatest reach of an adaptive law [-]; eq. S15.
REACHES = (1e-4, 0.5)


@dataclass(frozen=True, slots=True)
class HopSettings:
    """How a chain draws its starts and its hops; a number out of range raises ValueError.

    The names are those of a campaign's specification.
    """

    #: A name of `GUESS_LAWS`.
    guess_law: str = "uniform"
    #: A name of `HOP_LAWS`.
    hop_law: str = "uniform"
    #: Scale of the hop law [-], in widths of the bounds; None for the law's own.
    hop_width: float | None = None
    #: Exponent of the law's tail [-]; None for the law's own, and for a law without one.
    hop_shape: float | None = None
    #: Whether the width follows the chain's own successes.
    adaptive: bool = False
    #: Chance of each time to be drawn afresh in a hop [-].
    time_hop_probability: float = 0.0
    #: Hops in a row that may fail before the chain starts afresh [-].
    max_failures: int = 5

    def __post_init__(self) -> None:
        """Refuse what no chain can do."""
        for name, laws in (("guess_law", GUESS_LAWS), ("hop_law", HOP_LAWS)):
            if getattr(self, name) not in laws:
                raise ValueError(f"{name}: expected one of {', '.join(laws)}, got {getattr(self, name)!r}")
        if self.hop_width is not None and not 0.0 < self.hop_width <= 1.0:
            raise ValueError(f"hop_width: expected a number in (0, 1], got {self.hop_width}")
        if self.hop_shape is not None:
            self._check_shape(self.hop_shape)
        if not 0.0 <= self.time_hop_probability <= 1.0:
            raise ValueError(
                f"time_hop_probability: expected a number in [0, 1], got {self.time_hop_probability}"
            )
        if self.max_failures < 1:
            raise ValueError(f"max_failures: expected at least 1, got {self.max_failures}")
        low, high = self.width_range
        if self.adaptive and not low <= self.width <= high:
            raise ValueError(
                f"hop_width: expected a number in [{low:.2g}, {high:.2g}] for an adaptive "
                f"{self.hop_law} law, got {self.width:.3g}"
            )

    def _check_shape(self, shape: float) -> None:
        if HOP_LAWS[self.hop_law].shape is None:
            raise ValueError(f"hop_shape: expected none for a {self.hop_law} law, got {shape}")
        if not SHAPES[0] <= shape <= SHAPES[1]:
            raise ValueError(f"hop_shape: expected a number in [{SHAPES[0]:g}, {SHAPES[1]:g}], got {shape}")

    @property
    def width(self) -> float:
        """Scale of the hop law at the start of a chain [-]."""
        return HOP_LAWS[self.hop_law].width if self.hop_width is None else self.hop_width

    @property
    def shape(self) -> float | None:
        """Exponent of the hop law's tail [-], if it has one."""
        return HOP_LAWS[self.hop_law].shape if self.hop_shape is None else self.hop_shape

    @property
    def width_range(self) -> tuple[float, float]:
        """Least and greatest width of an adaptive law [-], eq. S15."""
        # A minimum says little of a heavy tail; the step that 99 in 100 components keep within says more.
        reach = 1.0 if self.shape is None else 100.0 ** (1.0 / self.shape)
        return REACHES[0] / reach, REACHES[1] / reach


def hop(
    x: Array,
    bounds: tuple[Array, Array],
    law: str,
    width: float,
    rng: np.random.Generator,
    shape: float | None = None,
) -> Array:
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
    shape : float, optional
        Exponent of the law's tail [-]; the law's own where none is given.

    References
    ----------
    docs/method.md, eq. S3.
    """
    lower, upper = bounds
    moved = x + (upper - lower) * draw_steps(law, len(x), rng, width, shape)
    # In-plane angles wrap; clipping them would pile guesses up at +-pi.
    wraps = (upper == np.pi) & (lower == -np.pi)
    moved[wraps] = (moved[wraps] + np.pi) % (2.0 * np.pi) - np.pi
    return np.clip(moved, lower, upper)


def hop_times(
    x: Array, bounds: tuple[Array, Array], times: Indices, probability: float, rng: np.random.Generator
) -> Array:
    """Return a decision vector in which each time has been drawn afresh from its bounds, or kept.

    Parameters
    ----------
    x : (n,) array
        Where to hop from [days, rad, kg].
    bounds : tuple of two (n,) arrays
        Box of x.
    times : (n_times,) array
        Indices of the times in x.
    probability : float
        Chance of each time to be drawn afresh [-].
    rng : Generator
        Source of the numbers.

    References
    ----------
    docs/method.md, eq. S16.
    """
    lower, upper = bounds
    drawn = times[rng.random(len(times)) < probability]
    moved = x.copy()
    moved[drawn] = lower[drawn] + (upper - lower)[drawn] * rng.random(len(drawn))
    return moved


@dataclass(frozen=True, slots=True, eq=False)
class Incumbent:
    """What a chain hops from, and what a challenger has to beat."""

    #: (n_variables,) decision vector [days, rad, kg].
    x: Array
    #: Final mass [kg].
    objective: float
    #: Largest defect over its strict tolerance [-].
    violation: float

    @property
    def is_feasible(self) -> bool:
        """Whether every defect is within the strict tolerance, as of the outcome that it was."""
        return self.violation <= 1.0


@dataclass(frozen=True, slots=True, eq=False)
class ChainState:
    """Where a chain stands between two hops: all that the next depends on besides its generator."""

    incumbent: Incumbent | None = None
    #: Hops in a row that have failed [-].
    failures: int = 0
    #: Scale of the next hop [-]; None for that of the start.
    width: float | None = None


def is_better(challenger: Outcome, incumbent: Outcome | Incumbent | None) -> bool:
    """Return whether an outcome beats another: feasible first, then violation, then final mass."""
    return incumbent is None or _rank(challenger) > _rank(incumbent)


def _rank(outcome: Outcome | Incumbent) -> tuple[bool, float]:
    """Return what outcomes are ordered by; what is not a number comes last of its kind."""
    worth = outcome.objective if outcome.is_feasible else -outcome.violation
    return bool(outcome.is_feasible), -np.inf if np.isnan(worth) else worth


def _time_indices(transcription: Transcription) -> Indices:
    trajectories = transcription.layout.trajectories
    return np.array([(t.shooting_time, t.initial_coast, t.final_coast) for t in trajectories]).ravel()


class Chain:
    """The hops that follow from one start.

    Parameters
    ----------
    transcription : Transcription
        The problem.
    settings : HopSettings
        Its laws.
    state : ChainState
        Where it goes on; at its start if left out.
    """

    def __init__(
        self,
        transcription: Transcription,
        settings: HopSettings | None = None,
        state: ChainState | None = None,
    ) -> None:
        self.transcription = transcription
        self.settings = settings or HopSettings()
        begin = state or ChainState()
        self.incumbent: Outcome | Incumbent | None = begin.incumbent
        self.failures = begin.failures
        #: Scale of the next hop [-].
        self.width = self.settings.width if begin.width is None else begin.width
        self._times = _time_indices(transcription)

    @property
    def state(self) -> ChainState:
        """Where it stands; a chain that goes on there makes the same hops."""
        best = self.incumbent
        kept = None if best is None else Incumbent(best.x, best.objective, best.violation)
        return ChainState(kept, self.failures, self.width)

    @property
    def is_hopping(self) -> bool:
        """Whether there is something to hop from: an outcome that could at least be flown."""
        return self.incumbent is not None and bool(np.isfinite(self.incumbent.violation))

    def ask(self, rng: np.random.Generator) -> Array:
        """Return the next guess (n_variables,): a fresh draw, or a hop from the incumbent."""
        settings, box = self.settings, self.transcription.sampling_box
        if self.incumbent is None or not self.is_hopping:
            return sample_guess(self.transcription, rng, settings.guess_law)
        moved = hop(self.incumbent.x, box, settings.hop_law, self.width, rng, settings.shape)
        return hop_times(moved, box, self._times, settings.time_hop_probability, rng)

    def tell(self, outcome: Outcome) -> str:
        """Take the outcome of the last guess and return "accepted", "rejected" or "restarted"."""
        has_won = is_better(outcome, self.incumbent)
        if self.settings.adaptive and self.is_hopping:
            self._adapt(has_won)
        if has_won:
            self.incumbent, self.failures = outcome, 0
            return "accepted"
        self.failures += 1
        if self.failures < self.settings.max_failures:
            return "rejected"
        self.incumbent, self.failures, self.width = None, 0, self.settings.width
        return "restarted"

    def _adapt(self, has_won: bool) -> None:
        """Widen after a success, narrow after a failure, docs/method.md eq. S14."""
        low, high = self.settings.width_range
        wider = self.width * np.exp(LEARNING_RATE * (has_won - SUCCESS_SHARE))
        self.width = float(min(max(wider, low), high))


class HopAddress(NamedTuple):
    """The place of one hop: integers only, no worker, attempt or time."""

    #: 0 for a hop job, 1 for a map job.
    kind: int
    #: Number of the search in its campaign, and of the case in its search.
    search: int
    case: int
    #: Number of the chain; for a map job the seed's solution hash read as an integer.
    chain: int
    #: Number of the hop in its chain.
    hop: int


def hop_rng(rng_seed: int, address: HopAddress) -> np.random.Generator:
    """Return the generator of one hop: the same wherever and however often it runs.

    Parameters
    ----------
    rng_seed : int
        The random-number seed of the campaign [-].
    address : HopAddress
        The hop.
    """
    return np.random.default_rng(np.random.SeedSequence(rng_seed, spawn_key=tuple(address)))
