"""The tables against SPICE itself, which reads the kernel without our polynomials."""

import numpy as np
import pytest
import spiceypy

from core.constants import SECONDS_PER_DAY
from core.ephemeris import EpochError, body_table, furnish, positions, span_days, state_at, states
from core.epochs import seconds_past_j2000
from core.units import LU_KM, TU_DAYS, VU_KM_S
from core.world import USUAL

ORIGIN = seconds_past_j2000("2026-04-26T14:47:58")
START, STOP = -5.0, 200.0
#: The last bit of Jupiter's 2000 LU, in each of eight terms that are fitted, then summed in two ways.
ROUNDING = 2 * 2 * 8 * 2.3e-13


@pytest.fixture(scope="module")
def table():
    return body_table(ORIGIN, START, STOP)


def spice_state(days):
    furnish()
    et = ORIGIN + days * SECONDS_PER_DAY
    return np.array([spiceypy.spkezr(body, et, "J2000", "NONE", "EARTH")[0] for body in USUAL["EARTH"]])


def epochs():
    inside = np.random.default_rng(20260426).uniform(START, STOP, 400)
    edges = np.arange(START, STOP + 1.0)
    return np.concatenate([inside, edges, edges[1:] - 1e-7, edges[:-1] + 1e-7])


def test_positions_agree_with_spice_over_the_whole_span(table):
    # The task allows 1 m and 1 km; the polynomials reach 0.2 mm for the Moon and rounding for the others.
    for days in epochs():
        error = state_at(table, days)[0].reshape(3, 3) * LU_KM - spice_state(days)[:, :3]
        moon, sun, jupiter = np.linalg.norm(error, axis=1)
        assert moon < 1e-6 and sun < 1e-4 and jupiter < 1e-4, days


def test_velocities_agree_with_spice_over_the_whole_span(table):
    # Position errors times T_7' = 49 over half a record, 43200 s: 1e-6 km for the Moon, rounding else.
    for days in epochs():
        error = state_at(table, days)[1].reshape(3, 3) * VU_KM_S - spice_state(days)[:, 3:]
        moon, sun, jupiter = np.linalg.norm(error, axis=1)
        assert moon < 1.2e-9 and sun < 1e-8 and jupiter < 1e-8, days


def bridged_state(days):
    """Return states as SPICE has them at an epoch that seconds past J2000 cannot tell exactly."""
    et = ORIGIN + days * SECONDS_PER_DAY
    rest = days * SECONDS_PER_DAY - (et - ORIGIN)
    state = spice_state(days)
    acceleration = (spice_state(days + 1e-3) - spice_state(days - 1e-3))[:, 3:] / (2e-3 * SECONDS_PER_DAY)
    return state + rest * np.hstack([state[:, 3:], acceleration])


def test_a_fine_table_has_the_moon_to_rounding():
    fine = body_table(ORIGIN, START, STOP, is_fine=True)
    for days in epochs():
        value, rate = state_at(fine, days)[:2]
        expected = bridged_state(days)[0]
        # The last bit of t is 5e-9 s at 1 km/s. That of 1 LU is 1e-10 km, times T_7' = 49 over half a record,
        # 21600 s, in eight terms.
        assert np.linalg.norm(value[:3] * LU_KM - expected[:3]) < 1e-8, days
        assert np.linalg.norm(rate[:3] * VU_KM_S - expected[3:]) < 1e-11, days


def test_derivatives_are_those_of_the_interpolated_positions(table):
    h = 1e-4
    for t in np.random.default_rng(7).uniform(0.0, 40.0, 30):
        around = np.array([state_at(table, (t + step) * TU_DAYS)[:2] for step in (-h, h)])
        difference = (around[1] - around[0]) / (2 * h)
        exact = state_at(table, t * TU_DAYS)[1:]
        # Rounding eps * 2000 LU / h = 4e-9, more inside the second derivative of the same 2000 LU: 49 times.
        np.testing.assert_allclose(difference[:, :6], exact[:, :6], atol=1e-7)
        np.testing.assert_allclose(difference[:, 6:], exact[:, 6:], atol=1e-6)


def test_second_derivative_of_the_moon_is_its_acceleration_in_spice(table):
    h = 60.0 / SECONDS_PER_DAY
    for days in np.random.default_rng(8).uniform(START + 1, STOP - 1, 30):
        expected = (spice_state(days + h)[0, 3:] - spice_state(days - h)[0, 3:]) / 120.0
        # Fit: 1e-6 km * T_7'' = 784 / (43200 s)^2 = 4e-13; difference: h^2/6 * 2e-17 = 1e-14 km/s^2.
        actual = state_at(table, days)[2, :3] * LU_KM / (TU_DAYS * SECONDS_PER_DAY) ** 2
        np.testing.assert_allclose(actual, expected, atol=1e-12)


def test_positions_are_the_values_of_states(table):
    value, all_three = np.empty(9), np.empty((3, 9))
    for t in np.random.default_rng(9).uniform(table.start, 40.0, 50):
        positions(table, t, value)
        states(table, t, all_three)
        np.testing.assert_allclose(value, all_three[0], rtol=0, atol=ROUNDING)  # summed in two orders


def test_neighbouring_records_meet(table):
    coefficients = table.coefficients
    ends = coefficients.sum(axis=1)[:-1]
    starts = np.einsum("rkc,k->rc", coefficients, (-1.0) ** np.arange(coefficients.shape[1]))[1:]
    np.testing.assert_allclose(ends, starts, rtol=0, atol=ROUNDING)  # both interpolate one SPICE position


def test_an_epoch_outside_the_table_is_an_error_that_names_both(table):
    assert span_days(table) == pytest.approx((START, STOP), abs=1e-12)
    with pytest.raises(EpochError, match=r"-5\.0+\.\.200\.0+ days past the origin, got 200\.5"):
        state_at(table, 200.5)
    out = np.zeros(9)
    positions(table, table.start - 1e-9, out)
    assert np.isnan(out).all()


def test_a_span_outside_the_kernel_is_an_error_that_names_both():
    with pytest.raises(EpochError, match=r"1549-12-31.*2650-01-25.*got 2649-12.*\.\.2650-03"):
        body_table(seconds_past_j2000("2650-01-01T00:00:00"), -5.0, 60.0)
    with pytest.raises(EpochError, match="start < stop"):
        body_table(ORIGIN, 1.0, float("nan"))
