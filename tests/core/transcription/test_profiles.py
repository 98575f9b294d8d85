"""Thrust that is held during an outage: the bridge from a reference to a realization."""

import numpy as np
import pytest

from core.transcription import Transcription, fly_arc
from tests.core.partials import assert_partials
from tests.core.transcription.points import TIGHT, UNITS, problem, random_point, transcription

OUTAGES = ((3, 1.0), (6, 2.5))
#: (duration [TU], control): one control until the coast ends; two, the second until then.
PROFILES = (
    ((0.3, (0.6, 1.0, 0.2)),),
    ((0.2, (0.5, -2.0, 0.4)), (0.4, (0.3, 0.7, -0.6))),
)


def with_profiles(profiles=PROFILES, n_legs=4):
    return Transcription(problem(OUTAGES, 8), n_legs, TIGHT, profiles)


def test_without_throttle_a_profile_changes_nothing():
    unlit = tuple(tuple((d, (0.0, *angles)) for d, (_, *angles) in profile) for profile in PROFILES)
    x = random_point(with_profiles(), 1)
    # Another arc on the way: another step, at tolerance 1e-13.
    np.testing.assert_allclose(
        with_profiles(unlit).defects(x), transcription(OUTAGES, 8).defects(x), rtol=0, atol=1e-4
    )


def test_held_thrust_is_burnt_until_the_coast_ends():
    x = random_point(with_profiles(), 2)
    lost = transcription(OUTAGES, 8).defects(x) - with_profiles().defects(x)
    tu, flow = 375190.25852 / 86400.0, 3.0 * 86400.0 / (2708.0 * 9.806)
    first, second = with_profiles().layout.trajectories[1:]
    expected = [
        flow * 0.6 * (1.0 + x[first.initial_coast]),
        flow * (0.5 * 0.2 * tu + 0.3 * (2.5 + x[second.initial_coast] - 0.2 * tu)),
    ]
    assert lost[6::7] == pytest.approx([0.0, *expected], abs=1e-9)  # rounding


def test_a_held_control_is_flown_like_a_segment():
    flown = with_profiles((((0.3, (0.6, 1.0, 0.2)),), ((0.1, (0.0, 0.0, 0.0)),)), n_legs=8)
    x = random_point(flown, 3)
    z = flown.lift(x)
    start, end = flown.lifted.nodes[0, 3], flown.lifted.nodes[1, 2]
    realization = flown.layout.trajectories[1]
    t = z[1] + 2 / 8 * z[0]
    stop = t + 1.0 * 86400.0 / 375190.25852 + z[realization.initial_coast]
    state = fly_arc(flown, z[start : start + 7], t, stop, np.array([0.6, 1.0, 0.2]))
    h, u = z[realization.shooting_time] / 5, realization.control(1)
    state = fly_arc(flown, state, stop, stop + h, z[u : u + 3])
    np.testing.assert_allclose(state, z[end : end + 7], rtol=0, atol=1e-12)  # the same arithmetic


@pytest.mark.parametrize("rng_seed", [1, 2])
def test_every_column_is_a_central_difference_under_held_thrust(rng_seed):
    flown = with_profiles()
    x, units = random_point(flown, rng_seed), np.tile(UNITS, 3)
    found = flown.jacobian(x).toarray() / units[:, None] * flown.scale
    assert_partials(
        found,
        lambda z: flown.defects(z * flown.scale) / units,
        x / flown.scale,
        step=1e-4,
        # As without profiles: joints of the target, magnified, over h.
        atol=4e-6,
        rtol=1e-6,
        order=4,
    )
