"""The distributions that guesses are drawn from."""

import numpy as np
from numpy.typing import NDArray

from core.search.mapping import onto_realizations
from core.search.settings import GUESS_LAWS
from core.transcription import Transcription, control_of, fly_arc, target_state
from core.units import TU_DAYS

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
    draw = _uniform if law == "uniform" else _thrust_coast_thrust
    return draw(transcription, rng)


def _uniform(transcription: Transcription, rng: np.random.Generator) -> Array:
    """Draw uniformly from the box: the paper's law."""
    lower, upper = transcription.sampling_box
    return lower + (upper - lower) * rng.random(len(lower))


def _thrust_coast_thrust(transcription: Transcription, rng: np.random.Generator) -> Array:
    """Draw burns along the velocity at both ends with a coast between, each half propagated from its own end.

    The times are uniform over their bounds and the final mass follows from the burns.  Realizations use the
    reference's controls, as in the paper's default mapping.
    """
    x = _uniform(transcription, rng)
    lower, upper = transcription.sampling_box
    layout = transcription.layout.reference
    throttles = _two_burns(layout.n_segments, layout.matchpoint, rng)
    swing = CONE_RAD * rng.standard_normal((layout.n_segments, 2))
    model = transcription.setting.model
    spent = model.max_thrust / model.exhaust_velocity * x[layout.shooting_time] / TU_DAYS * throttles.mean()
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
    shooting, initial, final = x[layout.offset : layout.offset + 3] / TU_DAYS
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
