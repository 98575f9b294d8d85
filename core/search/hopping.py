"""Monotonic basin hopping: one chain of perturb, solve, accept, as ask and tell.

docs/method.md, section 7.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.nlp import Outcome
from core.search.mapping import onto_realizations
from core.search.settings import GUESS_LAWS, HOP_LAWS, HopAddress, HopSettings
from core.transcription import Transcription, control_of, fly_arc, target_state

Array = NDArray[np.float64]

#: Deviation of the thrust angles from those of the velocity [rad].
CONE_RAD = 0.3


def sample_guess(transcription: Transcription, rng: np.random.Generator, law: str = "uniform") -> Array:
    """Return a guess drawn from a law.

    Parameters
    ----------
    transcription : Transcription
        The problem; guesses lie in its `sampling_box`.
    rng : Generator
        Source of the numbers.
    law : str
        A name of `GUESS_LAWS`.

    Returns
    -------
    (n_variables,) array
        Guess in the paper layout [days, rad, kg].

    Raises
    ------
    ValueError
        When there is no such law.
    """
    if law not in GUESS_LAWS:
        raise ValueError(f"guess law: expected one of {', '.join(GUESS_LAWS)}, got {law!r}")
    draw = _uniform_guess if law == "uniform" else _thrust_coast_thrust
    return draw(transcription, rng)


def _uniform_guess(transcription: Transcription, rng: np.random.Generator) -> Array:
    """Draw uniformly from the box: the paper's law."""
    lower, upper = transcription.sampling_box
    return lower + (upper - lower) * rng.random(len(lower))


def _thrust_coast_thrust(transcription: Transcription, rng: np.random.Generator) -> Array:
    """Draw burns along the velocity at both ends with a coast between, each half propagated from its own end.

    The times are uniform over their bounds and the final mass follows from the burns.  Realizations use the
    reference's controls, as in the paper's default mapping.
    """
    x = _uniform_guess(transcription, rng)
    lower, upper = transcription.sampling_box
    layout = transcription.layout.reference
    throttles = _two_burns(layout.n_segments, layout.matchpoint, rng)
    swing = CONE_RAD * rng.standard_normal((layout.n_segments, 2))
    model, tu_days = transcription.setting.model, transcription.world.units.tu_days
    spent = model.max_thrust / model.exhaust_velocity * x[layout.shooting_time] / tu_days * throttles.mean()
    mass = (transcription.setting.departure[6] - spent) * transcription.scale[layout.final_mass]
    x[layout.final_mass] = np.clip(mass, lower[layout.final_mass], upper[layout.final_mass])
    _steer(transcription, x, throttles, swing)
    inside = slice(layout.offset, layout.stop)
    x[inside] = np.clip(x[inside], lower[inside], upper[inside])
    return onto_realizations(transcription, x[inside])


def _two_burns(n_segments: int, matchpoint: int, rng: np.random.Generator) -> Array:
    first, second = rng.random(2)
    levels = 0.5 + 0.5 * rng.random(2)
    throttles = np.zeros(n_segments)
    throttles[: round(first * (matchpoint - 1))] = levels[0]
    throttles[n_segments - round(second * (n_segments - matchpoint + 1)) :] = levels[1]
    return throttles


def _steer(transcription: Transcription, x: Array, throttles: Array, swing: Array) -> None:
    """Write the controls of the reference, propagating both halves to obtain the velocity."""
    layout = transcription.layout.reference
    shooting, initial, final = x[layout.offset : layout.offset + 3] / transcription.world.units.tu_days
    h = shooting / layout.n_segments
    arrival = initial + shooting + final
    mass = x[layout.final_mass] / transcription.scale[layout.final_mass]
    forward = fly_arc(transcription, transcription.setting.departure, 0.0, initial)
    backward = fly_arc(transcription, target_state(transcription, arrival, mass), arrival, initial + shooting)
    ahead = [(p, p - 1, p) for p in range(1, layout.matchpoint)]
    behind = [(p, p, p - 1) for p in range(layout.n_segments, layout.matchpoint - 1, -1)]
    for state, path in ((forward, ahead), (backward, behind)):
        for p, start, end in path:
            control = control_of(np.nan_to_num(state[3:6])[None, :])[0]
            control[0] = throttles[p - 1]
            control[1:] += swing[p - 1]
            control[1] = (control[1] + np.pi) % (2.0 * np.pi) - np.pi
            x[layout.control(p) : layout.control(p) + 3] = control
            state = fly_arc(transcription, state, initial + start * h, initial + end * h, control)


#: The laws by name.


Indices = NDArray[np.intp]

#: Truncation of the tails, in widths of the bounds.  Any other component is at its bound long before, and an
#: in-plane angle is still accurate to 1e-9 rad after so many turns.
LONGEST_STEP = 1e6


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


#: Steps (n,) of width 1 of each of `HOP_LAWS`, from a generator, n and the shape.
_DRAWN: dict[str, Callable[[np.random.Generator, int, float], Array]] = {
    "uniform": _uniform,
    "gaussian": _gaussian,
    "cauchy": _cauchy,
    "pareto": _pareto,
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
    steps = (chosen.width if width is None else width) * _DRAWN[law](rng, n, exponent)
    return np.clip(steps, -LONGEST_STEP, LONGEST_STEP)


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
    # In-plane angles wrap; clipping would accumulate guesses at +-pi.
    wraps = (upper == np.pi) & (lower == -np.pi)
    moved[wraps] = (moved[wraps] + np.pi) % (2.0 * np.pi) - np.pi
    return np.clip(moved, lower, upper)


def hop_times(
    x: Array, bounds: tuple[Array, Array], times: Indices, probability: float, rng: np.random.Generator
) -> Array:
    """Return a decision vector in which each time is redrawn from its bounds with a given probability.

    Parameters
    ----------
    x : (n,) array
        Where to hop from [days, rad, kg].
    bounds : tuple of two (n,) arrays
        Box of x.
    times : (n_times,) array
        Indices of the times in x.
    probability : float
        Probability that each time is redrawn [-].
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
    """The best outcome since the last draw: a chain hops from it, and the next has to improve on it."""

    #: (n_variables,) decision vector [days, rad, kg].
    x: Array
    #: Final mass [kg].
    objective: float
    #: Largest defect over its strict tolerance [-].
    violation: float

    @property
    def is_feasible(self) -> bool:
        """Whether every defect of the outcome is within the strict tolerance."""
        return self.violation <= 1.0


@dataclass(frozen=True, slots=True, eq=False)
class ChainState:
    """The state of a chain between two hops: all that the next depends on besides its generator."""

    incumbent: Incumbent | None = None
    #: Consecutive failed hops [-].
    failures: int = 0
    #: Scale of the next hop [-]; None for that of the start.
    width: float | None = None


def is_better(challenger: Outcome, incumbent: Outcome | Incumbent | None) -> bool:
    """Return whether an outcome is better than another: feasible first, then violation, then final mass."""
    return incumbent is None or _rank(challenger) > _rank(incumbent)


def _rank(outcome: Outcome | Incumbent) -> tuple[bool, float]:
    """Return the sort key of outcomes; NaN comes last of its kind."""
    worth = outcome.objective if outcome.is_feasible else -outcome.violation
    return bool(outcome.is_feasible), -np.inf if np.isnan(worth) else worth


def _time_indices(transcription: Transcription) -> Indices:
    trajectories = transcription.layout.trajectories
    return np.array([(t.shooting_time, t.initial_coast, t.final_coast) for t in trajectories]).ravel()


class Chain:
    """The hops from one start.

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
        """Its state; a chain that resumes from it makes the same hops."""
        best = self.incumbent
        kept = None if best is None else Incumbent(best.x, best.objective, best.violation)
        return ChainState(kept, self.failures, self.width)

    @property
    def is_hopping(self) -> bool:
        """Whether there is an outcome to hop from, one that could at least be propagated."""
        return self.incumbent is not None and bool(np.isfinite(self.incumbent.violation))

    def ask(self, rng: np.random.Generator) -> Array:
        """Return the next guess (n_variables,): a new draw, or a hop from the incumbent."""
        settings, box = self.settings, self.transcription.sampling_box
        if self.incumbent is None or not self.is_hopping:
            return sample_guess(self.transcription, rng, settings.guess_law)
        moved = hop(self.incumbent.x, box, settings.hop_law, self.width, rng, settings.shape)
        return hop_times(moved, box, self._times, settings.time_hop_probability, rng)

    def tell(self, outcome: Outcome) -> str:
        """Take the outcome of the last guess and return "accepted", "rejected" or "restarted"."""
        has_won = is_better(outcome, self.incumbent)
        if self.settings.adaptive and self.is_hopping:
            self.width = self.settings.next_width(self.width, has_won)
        if has_won:
            self.incumbent, self.failures = outcome, 0
            return "accepted"
        self.failures += 1
        if self.failures < self.settings.max_failures:
            return "rejected"
        self.incumbent, self.failures, self.width = None, 0, self.settings.width
        return "restarted"
