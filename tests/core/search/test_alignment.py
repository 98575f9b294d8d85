"""Realizations on the paths of a seed's own realizations: what stays open, and what is held of the thrust."""

import numpy as np
import pytest

from core.search import map_seed
from core.search.mapping import Seed, outage_profiles, thrust_profile
from core.transcription import Transcription, layout_of, throttle_of
from tests.core.search.seeds import ONE, robust_solution
from tests.core.transcription.points import problem

SEED = robust_solution()
TU_DAYS = 375190.25852 / 86400.0
OWN = layout_of(ONE).trajectories[1]
SHOOTING, COAST = SEED[OWN.shooting_time], SEED[OWN.initial_coast]
#: What may remain where two arcs meet: the seed's own defect, 0.3 km of 384,400, as stored; and arcs flown at
#: the default tolerance, 3e-10 each, magnified by a lunar passage.
CLOSED = 3e-6


def lifted(asked, mapping, seed=SEED, profiles=()):
    """Return guess, defects and place of the realizations' first legs, with a node at every boundary."""
    target = Transcription(asked, 50, 1e-12, profiles)
    guess = map_seed(ONE, seed, asked, mapping)
    defects = target.evaluate(target.lifted, target.lift(guess), False)[0].reshape(-1, 7)
    return guess.x, defects, [before + 1 for before in target.lifted.matchpoints[:-1]]


def on_the_grid():
    """Return a seed whose realization has the epochs of its reference's segments, and therefore a defect."""
    x = SEED.copy()
    x[OWN.shooting_time], x[OWN.initial_coast] = x[0] * 26 / 50, x[0] / 50 - 1.0
    return x


def test_an_outage_that_fits_into_the_coast_of_its_source_leaves_nothing_open():
    x, defects, _ = lifted(problem(((24, 1.5),)), "aligned")
    assert np.abs(defects).max() < CLOSED
    expected = SEED.copy()
    expected[OWN.initial_coast] -= 0.5
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-11)  # rounding of epochs


def test_a_longer_outage_drops_the_segments_of_its_source_that_it_covers():
    asked = problem(((24, COAST + 1.5),))  # it ends half a day into the first segment
    x, _, _ = lifted(asked, "aligned")
    h = SHOOTING / 26
    assert x[OWN.initial_coast] == pytest.approx(h - 0.5, abs=1e-11)
    assert x[OWN.shooting_time] == pytest.approx(25 * h, abs=1e-11)
    before, after = (throttle_of(v[OWN.controls].reshape(-1, 3)) for v in (SEED, x))
    assert after.mean(axis=0) == pytest.approx(before[1:].mean(axis=0), abs=1e-11)


# The reference thrusts in 6 and coasts in 16; at 30 the source has left it, and before 38 its halves meet.
@pytest.mark.parametrize(("segment", "expected"), [(6, 2), (16, 1), (30, 2), (38, 1)])
def test_a_guess_on_a_realization_is_open_in_its_first_leg_and_where_the_source_is(segment, expected):
    outages = tuple(sorted([(segment, 1.0), (24, 1.5)]))
    number = 1 + outages.index((segment, 1.0))
    x, defects, firsts = lifted(problem(outages), "aligned(1,1)", on_the_grid())
    blocks = np.split(defects, firsts)[number]
    own = layout_of(problem(outages)).trajectories[number]
    # All segments have one length: those of the source begin with 25, and 13 are flown forward.
    assert x[own.shooting_time] == pytest.approx(SEED[0] * (50 - segment) / 50, abs=1e-11)
    assert np.sum(np.abs(blocks).max(axis=1) > CLOSED) == expected


def test_a_path_that_has_left_the_reference_is_met_with_a_jump():
    _, defects, firsts = lifted(problem(((24, 1.0), (30, 1.0))), "aligned(1,1)")
    known, jump = (np.linalg.norm(defects[first]) for first in firsts)
    assert known < CLOSED < 0.01 < jump


@pytest.mark.parametrize(("days", "expected"), [(0.5, 1), (4.0, 3), (1.0, 1)])
def test_what_is_held_is_the_thrust_of_the_reference_until_the_outage_ends(days, expected):
    asked = problem(((8, days),)).outages[0]
    held = thrust_profile(Seed(ONE, SEED), asked, 0, 0.25)
    assert len(held) == expected  # segments of 1.8 d
    assert sum(duration for duration, _ in held) * TU_DAYS == pytest.approx(days, abs=1e-12)
    for segment, (_, control) in enumerate(held, start=8):
        old = SEED[3 * segment : 3 * segment + 3]
        assert control == pytest.approx([0.25 * old[0], *old[1:]], abs=1e-15)


def test_at_depth_zero_a_longer_outage_leaves_the_first_leg_closed():
    x = SEED.copy()
    x[OWN.control(1)] = 1.0
    asked = problem(((24, COAST + 1.5),))
    for depth, is_closed in ((0.0, True), (1.0, False)):
        profiles = outage_profiles(asked, ONE, x, depth)
        # The coast of the source, then what is covered of its first segment.
        assert [duration * TU_DAYS for duration, _ in profiles[0]] == pytest.approx(
            [COAST + 1.0, 0.5], abs=1e-11
        )
        _, defects, (first,) = lifted(asked, "continued", x, profiles)
        assert (np.abs(defects[first]).max() < CLOSED) == is_closed
