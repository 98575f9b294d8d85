"""The curvature of gravity, and its drift with the bodies, against differences."""

import numpy as np

from core.dynamics.force import FIELD_WIDTH, field_at, gravity, gravity_bend, gravity_gradient, gravity_rate
from core.ephemeris import jerks, states
from tests.core.partials import assert_partials, central_differences
from tests.core.transcription.points import transcription

MODEL = transcription((), 8).setting.model
#: 20,000 km from the Moon, where all four bodies count.
EPOCH = 7.3


def field(t):
    out = np.empty(FIELD_WIDTH)
    field_at(MODEL.field.start, MODEL.field.record, MODEL.field.coefficients, t, out)
    return out


PLACE = field(EPOCH)[:3] + np.array([0.03, -0.04, 0.02])


def full(xx, xy, xz, yy, yz, zz):
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def test_gravity_bends_as_its_gradient_differs():
    weights = np.array([0.3, -1.1, 0.7])
    found = full(*gravity_bend(MODEL.gm, field(EPOCH), *PLACE, *weights))
    # h^4 over the fourth power of the distance, 0.05 LU, and eps/h: both below 1e-9 of the curvature.
    assert_partials(
        found,
        lambda place: full(*gravity_gradient(MODEL.gm, field(EPOCH), *place)) @ weights,
        PLACE, step=2e-4, atol=0.0, rtol=1e-8, order=4,
    )  # fmt: skip


def test_gravity_drifts_with_the_bodies():
    rows = np.empty((3, FIELD_WIDTH))
    states(MODEL.field, EPOCH, rows)
    found = np.array(gravity_rate(MODEL.gm, rows[0], rows[1], *PLACE))
    expected = central_differences(
        lambda t: np.array(gravity(MODEL.gm, field(t[0]), *PLACE)), [EPOCH], 2e-4, order=4
    )
    np.testing.assert_allclose(found, expected[:, 0], rtol=1e-8)  # as above


def test_jerks_are_differences_of_accelerations():
    table, found, rows = MODEL.bodies, np.empty(9), np.empty((3, 9))

    def acceleration(t):
        states(table, t[0], rows)
        return rows[2].copy()

    jerks(table, EPOCH, found)
    expected = central_differences(acceleration, [EPOCH], 1e-2, order=4)
    # A polynomial of degree 5 is differenced to h^4 of its fifth derivative; the Sun's rounding is 400 eps.
    np.testing.assert_allclose(found, expected[:, 0], rtol=1e-6, atol=1e-7)


def test_outside_the_table_there_is_no_jerk():
    found = np.empty(9)
    jerks(MODEL.bodies, -1e3, found)
    assert np.isnan(found).all()
