"""The phases of the descent, each on the preset: guesses close, propellant is saved, points are kept."""

import numpy as np
import pytest

from core.nlp import Limits, no_stop
from core.nlp.descent import (
    ATTEMPTS,
    CLOSED,
    State,
    ThrustVectors,
    is_solved,
    reach,
    save_propellant,
    starts,
    tighten,
)
from core.search import sample_guess
from core.transcription import transcribe
from tests.core.known import solution
from tests.core.transcription.points import PRESET, problem


def limits(iterations=3000, stop=no_stop):
    return Limits(60.0, iterations, stop)


@pytest.fixture(scope="module")
def form():
    return ThrustVectors(transcribe(PRESET))


def drawn(form, rng_seed):
    return form.start(sample_guess(form.transcription, np.random.default_rng(rng_seed), "uniform"))


def attempts(form, rng_seed):
    """Return whether each start of a guess closed, up to the first one that did."""
    closed = []
    for start in starts(form, drawn(form, rng_seed)):
        closed.append(is_solved(reach(form, start, limits())))
        if closed[-1]:
            break
    return closed


def test_most_guesses_close_and_those_that_do_not_close_at_once_close_with_more_time(form):
    # Chaotic far away, so which ones do depends on how a processor rounds: of the first ten, four closed at
    # once and all in the end. They are tried until both ways were seen.
    found = []
    for rng_seed in range(1, 31):
        found.append(attempts(form, rng_seed))
        closed = {len(tried) > 1 for tried in found if tried[-1]}
        if len(found) >= 4 and closed == {False, True}:
            break
    assert closed == {False, True}
    assert 2 * sum(tried[-1] for tried in found) > len(found)


def test_a_closed_point_has_small_defects_and_throttles_within_the_limit(form):
    state = next(
        state
        for rng_seed in range(1, 21)
        for state in [reach(form, drawn(form, rng_seed), limits())]
        if is_solved(state)
    )
    assert np.linalg.norm(form.defects(state.z)) < CLOSED
    x = form.decision(state.z)
    lower, upper = form.transcription.bounds
    assert np.all((x >= lower) & (x <= upper)) and form.throttles(state.z).max() <= 1.0


def test_there_are_so_many_starts_each_with_more_time(form):
    times = [z[0] for z in starts(form, drawn(form, 2))]
    assert len(times) == ATTEMPTS and np.all(np.diff(times) > 0.0)


def test_propellant_is_saved_while_defects_stay_closed():
    form = ThrustVectors(transcribe(PRESET, 20))
    state = State(form, form.start(solution()), 1.0)
    mass = form.transcription.layout.reference.final_mass
    before, spent = state.z[mass], limits()
    save_propellant(state, spent)
    assert is_solved(state) and state.z[mass] >= before + 1.0 / 15000.0  # a kilogram of the 20 in reach
    assert 0 < spent.iterations < spent.evaluations


def test_tightening_closes_a_point_and_moves_it_by_no_more_than_it_was_off(form):
    z = form.start(solution())
    z[form.transcription.n_variables :] += 1e-7 * np.random.default_rng(1).standard_normal(
        len(z) - form.transcription.n_variables
    )
    before = np.linalg.norm(form.defects(z))
    state = tighten(form, z.copy(), limits())
    assert state.error < 1e-3 * before
    throttles = np.abs(form.throttles(state.z) - form.throttles(z))
    assert throttles.max() < 1e-4 and np.abs(state.z - z)[form.times].max() < 1e-4
    assert form.throttles(state.z).max() <= 1.0 + 1e-6  # the bound of x is put back by `decision`


def test_while_realizations_are_closed_nothing_of_the_reference_moves():
    form = ThrustVectors(transcribe(problem(((24, 1.0),))), is_reference_fixed=True)
    own = form.transcription.layout.trajectories[1]
    x = np.concatenate([solution(), np.random.default_rng(2).random(own.stop - own.offset)])
    x[own.offset : own.offset + 3] = 20.0, 1.0, 10.0
    z = form.start(x)
    state = reach(form, z.copy(), limits(60))
    moved = np.flatnonzero(state.z != z)
    nodes = [p for (index, _), p in form.transcription.lifted.nodes.items() if index == 0]
    fixed = set(range(own.offset)).union(*(range(p, p + 7) for p in nodes))
    assert len(moved) > 0 and not fixed & set(moved.tolist())


def test_a_phase_ends_when_it_is_stopped_or_out_of_iterations(form):
    z = drawn(form, 2)
    few = limits(5)
    reach(form, z.copy(), few)
    assert few.iterations == 5
    stopped = limits(stop=lambda: True)
    reach(form, z.copy(), stopped)
    assert stopped.iterations == 0 and stopped.is_stopped
