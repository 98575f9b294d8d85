"""Mappings M: from a seed, a solution of P_k', to a guess for P_k.

`reference` is the paper's: the seed's reference becomes the reference and, from the segment after the missed
one on, every realization.  `aligned` and `continued` are ours: the realization starts on the seed's path at
the same epochs, so that all its defects vanish but the impulse of the missed segments.
docs/method.md, section 8.
"""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from core.problem import Problem
from core.transcription import (
    Guess,
    Layout,
    OutageProfile,
    ReferencePath,
    TrajectoryLayout,
    Transcription,
    checked_vector,
    control_of,
    layout_of,
    throttle_of,
    transcribe,
)
from core.units import TU_DAYS

Array = NDArray[np.float64]

#: The mappings by name.
MAPPINGS = ("reference", "aligned", "continued")


def map_seed(problem_from: Problem, x: Array, problem_to: Problem, mapping: str = "reference") -> Guess:
    """Return the guess for a problem that a seed gives.

    Parameters
    ----------
    problem_from : Problem
        Problem P_k' of the seed: the same family, fewer outages.
    x : (n_variables,) array
        The seed in the paper layout of P_k' [days, rad, kg].
    problem_to : Problem
        Problem P_k.
    mapping : str
        A name of `MAPPINGS`; "continued" starts where "aligned" does.

    Returns
    -------
    Guess
        In the paper layout of P_k, with states for the shooting nodes where the mapping is aligned.

    Raises
    ------
    ValueError
        When the mapping is unknown, the problems are not a family with k' < k, or x is no vector of P_k'.
    """
    if mapping not in MAPPINGS:
        raise ValueError(f"mapping: expected one of {', '.join(MAPPINGS)}, got {mapping!r}")
    _check_family(problem_from, problem_to)
    layout = layout_of(problem_from)
    seed, target = checked_vector(layout, x), transcribe(problem_to)
    if mapping == "reference":
        return Guess(onto_realizations(target, seed[: layout.reference.stop]))
    return _aligned(target, problem_from, seed)


def _check_family(problem_from: Problem, problem_to: Problem) -> None:
    if problem_from.family != problem_to.family:
        raise ValueError(
            "seed: expected a problem that differs in its outages alone, got another reference problem"
        )
    if problem_from.k >= problem_to.k:
        raise ValueError(f"seed: expected fewer than {problem_to.k} outages, got {problem_from.k}")


def onto_realizations(transcription: Transcription, reference: Array) -> Array:
    """Return x of a reference (3N + 4,) and, as realizations, its controls after the missed segments."""
    layout, box = transcription.layout, transcription.bounds
    x = np.empty(layout.n_variables)
    first = layout.reference
    x[first.offset : first.stop] = reference
    controls = reference[first.controls].reshape(-1, 3)
    for trajectory in layout.trajectories[1:]:
        assert trajectory.outage is not None
        left = controls[trajectory.outage.segment :]
        share = len(left) / first.n_segments
        x[trajectory.shooting_time] = share * reference[first.shooting_time]
        x[trajectory.initial_coast] = box[0][trajectory.initial_coast]
        x[trajectory.final_coast] = reference[first.final_coast]
        x[trajectory.controls] = _resampled(left, trajectory.n_segments).ravel()
        x[trajectory.final_mass] = reference[first.final_mass]
    return x


def _resampled(controls: Array, n: int) -> Array:
    """Return controls (n, 3) with the time averages of the thrust vectors of other, equally long ones."""
    if len(controls) == n:
        return controls
    edges, wanted = np.arange(len(controls) + 1) / len(controls), np.arange(n + 1) / n
    integral = np.vstack([np.zeros(3), np.cumsum(throttle_of(controls), axis=0)]) / len(controls)
    sums = np.stack([np.interp(wanted, edges, integral[:, i]) for i in range(3)], axis=1)
    return control_of(np.diff(sums, axis=0) * n)


def missed_segments(segment_time: float, duration_days: float, segment: int, n_segments: int) -> int:
    """Return how many segments of a seed an outage takes away, leaving at least one [-]."""
    over = math.ceil(duration_days / TU_DAYS / segment_time - 1e-9)
    return min(max(over, 1), n_segments - segment)


def outage_profiles(
    problem_to: Problem, problem_from: Problem, x: Array, depth: float
) -> tuple[OutageProfile, ...]:
    """Return what is still flown of the missed segments at a depth of the outages between 0 and 1.

    Parameters
    ----------
    problem_to, problem_from : Problem
        P_k and P_k' of the seed.
    x : (n_variables,) array
        The seed [days, rad, kg].
    depth : float
        At 0 the thrust of the seed holds on, and its reference solves P_k if no outage outlasts a segment; at
        1 there is none [-].

    References
    ----------
    docs/method.md, section 8: outage-depth continuation.
    """
    first = layout_of(problem_from).reference
    controls = x[first.controls].reshape(-1, 3)
    h = float(x[first.shooting_time]) / TU_DAYS / first.n_segments
    profiles: list[OutageProfile] = []
    for outage in problem_to.outages:
        known = outage in problem_from.outages
        missed = 1 if known else missed_segments(h, outage.duration_days, outage.segment, first.n_segments)
        share = 0.0 if known else 1.0 - depth
        held = controls[outage.segment - 1 : outage.segment - 1 + missed]
        profiles.append(tuple((h, (share * float(u[0]), float(u[1]), float(u[2]))) for u in held))
    return tuple(profiles)


def _aligned(target: Transcription, problem_from: Problem, seed: Array) -> Guess:
    """Lay every new realization on the seed's path at the same epochs; known ones are kept as they are."""
    layout_from = layout_of(problem_from)
    full = transcribe(problem_from, n_legs=problem_from.n_segments)
    path, known = ReferencePath(full, seed), _boundary_states(full, seed)
    first = layout_from.reference
    x = np.empty(target.n_variables)
    x[first.offset : first.stop] = seed[first.offset : first.stop]
    states = [path.boundaries]
    for trajectory in target.layout.trajectories[1:]:
        inside = slice(trajectory.offset, trajectory.stop)
        same = _same_outage(layout_from, trajectory)
        if same is None:
            x[inside], state = _on_path(target, path, trajectory, seed)
        else:
            old = layout_from.trajectories[same]
            x[inside], state = seed[old.offset : old.stop], known[same]
        states.append(state)
    return Guess(x, tuple(states))


def _same_outage(layout: Layout, wanted: TrajectoryLayout) -> int | None:
    for index, trajectory in enumerate(layout.trajectories):
        if trajectory.outage == wanted.outage:
            return index
    return None


def _on_path(
    target: Transcription, path: ReferencePath, trajectory: TrajectoryLayout, seed: Array
) -> tuple[Array, Array]:
    """Return variables and boundary states of a realization that rejoins the seed's path."""
    outage = trajectory.outage
    assert outage is not None
    first, n = target.layout.reference, trajectory.n_segments
    duration, h = outage.duration_days / TU_DAYS, path.segment_time
    missed = missed_segments(h, outage.duration_days, outage.segment, path.n_segments)
    begin = path.boundary_time(outage.segment)
    start = begin + max(missed * h, duration)
    shooting = max(path.boundary_time(path.n_segments + 1) - start, h)
    edges = start + shooting * np.arange(n + 1) / n
    left = path.controls[outage.segment - 1 + missed :]
    # Equal grids keep the angles of unlit segments, which an average would lose.
    controls = (
        left
        if len(left) == n
        else control_of(np.array([path.mean_throttle(a, b) for a, b in itertools.pairwise(edges)]))
    )
    times = np.array([shooting, start - begin - duration, 0.0]) * TU_DAYS
    times[2] = seed[first.final_coast]
    x = np.concatenate([times, controls.ravel(), [seed[first.final_mass]]])
    return x, np.array([path.state(t) for t in edges])


def _boundary_states(full: Transcription, x: Array) -> list[Array]:
    """Return the (N_w + 1, 7) boundary states of all trajectories, NaN where a full lift has no node."""
    z = full.lift(x)
    states = [np.full((trajectory.n_segments + 1, 7), np.nan) for trajectory in full.layout.trajectories]
    for (trajectory, boundary), place in full.lifted.nodes.items():
        states[trajectory][boundary - 1] = z[place : place + 7]
    return states
