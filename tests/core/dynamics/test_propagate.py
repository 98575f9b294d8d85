"""The integrator against closed forms, against SciPy with SPICE, and where it must give up."""

import numpy as np
import pytest
import spiceypy
from scipy.integrate import solve_ivp

from core.dynamics import NOT_FINITE, TOO_MANY_STEPS, force_model
from core.dynamics.force import field_table
from core.ephemeris import body_table, furnish
from core.transcription import TOLERANCE
from tests.core.dynamics.arcs import ORIGIN_ET, PRESET, fly, fly_with_partials, preset_model
from tests.core.partials import assert_partials

LU, TU, MU = 384400.0, 375190.25852, 15000.0
DAY = 86400.0 / TU
SCALE = np.array([LU] * 3 + [LU / TU] * 3 + [MU])
START_KM = np.array(
    [*PRESET.departure.position_km, *PRESET.departure.velocity_km_s, PRESET.departure.mass_kg]
)
START = START_KM / SCALE
CIRCLE = np.array([1.0, 0, 0, 0, 1.0, 0, 1.0])
#: 2.1 N in a general direction [MU LU/TU^2] and its mass flow; 3 N are 0.0732402, the flow 2.825797e-3.
THRUST = 0.7 * 0.0732402 * np.array([0.48, -0.64, 0.6])
MASS_RATE = 0.7 * 2.825797e-3


def pulling(gm):
    """Return the preset's model with other gravitational parameters."""
    model = preset_model()
    return model._replace(gm=gm, field=field_table(gm, model.bodies))


def earth_alone(gm=1.0):
    return pulling(np.array([gm, 0.0, 0.0, 0.0]))


def circular(t):
    return np.array([np.cos(t), np.sin(t), 0.0, -np.sin(t), np.cos(t), 0.0])


def kepler(t, eccentricity):
    """Return the state t after perihelion on an ellipse of semi-major axis 1 around GM 1."""
    anomaly = t
    for _ in range(60):
        anomaly -= (anomaly - eccentricity * np.sin(anomaly) - t) / (1.0 - eccentricity * np.cos(anomaly))
    minor, rate = np.sqrt(1.0 - eccentricity**2), 1.0 / (1.0 - eccentricity * np.cos(anomaly))
    c, s = np.cos(anomaly), np.sin(anomaly)
    return np.array([c - eccentricity, minor * s, 0.0, -s * rate, minor * c * rate, 0.0])


def test_one_step_has_the_local_error_of_order_eight():
    sizes = np.array([0.6, 0.42, 0.3])
    ends = [fly(earth_alone(), 0.0, h, CIRCLE, tolerance=1e-3) for h in sizes]
    assert [status for status, _ in ends] == [1, 1, 1]
    errors = [np.linalg.norm(y[:6] - circular(h)) for h, (_, y) in zip(sizes, ends, strict=True)]
    slopes = np.diff(np.log(errors)) / np.diff(np.log(sizes))
    # h^9; the next term, h^10, adds up to one at steps this long. Order 7 would give 8.
    assert np.all((slopes > 8.6) & (slopes < 10.2)), slopes


def test_the_error_falls_with_the_eighth_power_of_the_number_of_steps():
    span, errors, steps = 40.0, [], []
    for tolerance in (1e-5, 1e-7, 1e-9, 1e-11):
        taken, y = fly(earth_alone(), 0.0, span, CIRCLE, tolerance=tolerance)
        errors.append(np.linalg.norm(y[:6] - circular(span)))
        steps.append(taken)
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert -9.0 < slope < -7.5, slope  # a circle keeps its step, so that steps and order show cleanly


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("eccentricity", [0.0, 0.5, 0.9])
def test_an_ellipse_is_flown_as_kepler_says(eccentricity, direction):
    span = direction * 9.0
    start = np.append(kepler(0.0, eccentricity), 1.0)
    _, y = fly(earth_alone(), 0.0, span, start, tolerance=1e-13)
    # 1e-13 a step, magnified along the track by the 1.4 revolutions and the passages of perigee, 1/(1-e)^2.
    np.testing.assert_allclose(
        y[:6], kepler(span, eccentricity), rtol=0, atol=3e-12 / (1 - eccentricity) ** 2
    )


def test_without_gravity_the_velocity_is_that_of_the_rocket_equation():
    model = pulling(np.zeros(4))
    y = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.8])
    span, rate = 30.0, 0.01
    _, end = fly(model, 0.0, span, y, THRUST, rate)
    burnt = np.log(0.8 / (0.8 - rate * span))
    assert end[3:6] - y[3:6] == pytest.approx(THRUST / rate * burnt, abs=1e-12)  # tolerance 1e-13
    moved = THRUST / rate * (span - (0.8 - rate * span) / rate * burnt)
    assert end[:3] - y[:3] == pytest.approx(y[3:6] * span + moved, abs=1e-11)  # 30 times as long
    assert end[6] == pytest.approx(0.5, abs=1e-15)


def rates(t, y, thrust_n):
    """Newton's law in km, s, kg, the bodies asked of SPICE."""
    total = -398600.43550702266 * y[:3] / np.linalg.norm(y[:3]) ** 3
    for body, gm in (("MOON", 4902.8001184575496), ("SUN", 132712440041.27942), ("5", 126712764.1)):
        place, _ = spiceypy.spkpos(body, ORIGIN_ET + t, "J2000", "NONE", "EARTH")
        away = place - y[:3]
        total += gm * (away / np.linalg.norm(away) ** 3 - place / np.linalg.norm(place) ** 3)
    size = np.linalg.norm(thrust_n)
    return np.concatenate([y[3:6], total + 1e-3 * thrust_n / y[6], [-size / (2708.0 * 9.806)]])


@pytest.fixture(scope="module")
def thirty_days_by_spice():
    furnish()
    thrust = 0.7 * 3.0 * np.array([0.48, -0.64, 0.6])
    options = {"method": "DOP853", "args": (thrust,), "rtol": 1e-13, "atol": 1e-9}
    return solve_ivp(rates, (0.0, 30 * 86400.0), START_KM, **options).y[:, -1]


@pytest.mark.parametrize(
    ("tolerance", "metres"),
    # What the product promises; a step's bound of 1e-12 LU is 0.4 mm, a hundred of them carried for 30 days.
    [(1e-12, 1.0), (TOLERANCE, 20.0)],
)
def test_thirty_days_of_thrust_agree_with_scipy_and_spice(thirty_days_by_spice, tolerance, metres):
    expected = thirty_days_by_spice
    # Newtons into MU LU/TU^2 by the units of this file.
    thrust = 0.7 * 3.0e-3 * np.array([0.48, -0.64, 0.6]) * TU**2 / (MU * LU)
    rate = 0.7 * 3.0 / (2708.0 * 9.806) * TU / MU
    status, y = fly(preset_model(), 0.0, 30 * DAY, START, thrust, rate, tolerance)
    assert status > 0
    assert np.linalg.norm(y[:3] * LU - expected[:3]) < metres * 1e-3
    # At 1 km/s of speed a metre is passed in a millisecond, in which gravity changes it by 1e-6 of itself.
    assert np.linalg.norm(y[3:6] * LU / TU - expected[3:6]) < metres * 1e-5
    assert y[6] * MU == pytest.approx(expected[6], abs=1e-8)  # both are exact up to rounding


def test_flying_back_returns_to_the_start():
    there = fly(preset_model(), 0.0, 20 * DAY, START, THRUST, MASS_RATE)[1]
    back = fly(preset_model(), 20 * DAY, 0.0, there, THRUST, MASS_RATE)[1]
    # Some fifty steps there and back at tolerance 1e-13, magnified along the track by two revolutions.
    np.testing.assert_allclose(back, START, rtol=0, atol=2 * 50 * 1e-13 * 6 * np.pi)


def test_an_arc_without_duration_changes_nothing():
    status, y = fly(preset_model(), 3.0, 3.0, START, THRUST, MASS_RATE)
    assert status == 0 and np.array_equal(y, START)


def test_the_state_is_the_same_with_and_without_partials():
    # The step control looks at the state alone, so only the order of summation can differ.
    alone = fly(preset_model(), 0.0, 10 * DAY, START, THRUST, MASS_RATE, 1e-9)[1]
    d_thrust, d_rate = np.eye(3), np.zeros(3)
    end, _, _ = fly_with_partials(
        preset_model(), 0.0, 10 * DAY, START, THRUST, MASS_RATE, d_thrust, d_rate, 1e-9
    )
    np.testing.assert_allclose(end, alone[:6], rtol=0, atol=1e-13)


#: How thrust and mass flow hang on three made-up controls: linear, so that only the integrator is tested.
D_THRUST = np.array([[0.04, 0.01, -0.02], [0.0, 0.05, 0.03], [-0.03, 0.02, 0.04]])
D_RATE = np.array([0.003, -0.001, 0.002])


@pytest.mark.parametrize("span_days", [8.0, -4.0])
def test_partials_by_state_mass_and_control_are_central_differences(span_days):
    controls = np.array([0.5, -0.3, 0.8])
    x = np.concatenate([START, controls])

    def end(x):
        thrust, rate = x[7:] @ D_THRUST, x[7:] @ D_RATE
        return fly(preset_model(), 2.0, 2.0 + span_days * DAY, x[:7], thrust, rate)[1][:6]

    _, found, _ = fly_with_partials(
        preset_model(), 2.0, 2.0 + span_days * DAY, START, controls @ D_THRUST, controls @ D_RATE,
        D_THRUST, D_RATE,
    )  # fmt: skip
    # h^2 times third derivatives of up to 1e3 of the column; the integrator's 1e-13 / h = 1e-8 less.
    assert_partials(found, end, x, step=1e-5, rtol=1e-6, atol=1e-8)


def test_accelerations_at_both_ends_are_the_rates_of_the_velocity():
    _, _, ends = fly_with_partials(preset_model(), 0.0, 5 * DAY, START, THRUST, MASS_RATE, D_THRUST, D_RATE)
    y = fly(preset_model(), 0.0, 5 * DAY, START, THRUST, MASS_RATE)[1]
    h = 1e-4
    for at, state, found in ((0.0, START, ends[0]), (5 * DAY, y, ends[1])):
        around = [fly(preset_model(), at, at + d, state, THRUST, MASS_RATE)[1][3:6] for d in (-h, h)]
        # h^2 of the third derivative of the velocity, of the order of 1e2; rounding eps / h = 2e-12.
        assert found == pytest.approx((around[1] - around[0]) / (2 * h), abs=1e-6)


@pytest.mark.parametrize("stop_days", [-6.0, 45.0])
def test_an_arc_beyond_the_table_is_a_status(stop_days):
    narrow = force_model(PRESET, body_table(ORIGIN_ET, -5.0, 40.0))
    assert fly(narrow, 0.0, stop_days * DAY, START)[0] == NOT_FINITE


@pytest.mark.parametrize(
    ("y", "status"),
    [
        ([0.0, 0, 0, 0, 1.0, 0, 1.0], {NOT_FINITE}),  # at the Earth's centre
        ([0.3, 0, 0, 0, 0, 0, 1.0], {NOT_FINITE, TOO_MANY_STEPS}),  # falling into it
        ([np.nan, 0, 0, 0, 0, 0, 1.0], {NOT_FINITE}),
    ],
)
def test_a_passage_through_a_body_is_a_status_and_no_exception(y, status):
    assert fly(preset_model(), 0.0, 10.0, np.array(y))[0] in status


def test_running_out_of_mass_is_a_status():
    assert fly(preset_model(), 0.0, 10.0, np.array([*CIRCLE[:6], 0.005]), THRUST, 1e-3)[0] < 0
