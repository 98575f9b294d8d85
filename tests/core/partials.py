"""The one way in which partials are tested: against differences, column by column."""

import numpy as np

#: Offsets and weights of central differences of second and of fourth order.
_STENCILS = {2: ((1, 0.5), (-1, -0.5)), 4: ((1, 2 / 3), (-1, -2 / 3), (2, -1 / 12), (-2, 1 / 12))}


def central_differences(function, x, step, order=2):
    """Return d function / d x, one column per entry of x."""
    columns = []
    for i in range(len(x)):
        total = 0.0
        for offset, weight in _STENCILS[order]:
            moved = np.array(x, dtype=float)
            moved[i] += offset * step
            total = total + weight * function(moved)
        columns.append(total / step)
    return np.stack(columns, axis=-1)


def assert_partials(actual, function, x, *, step, rtol, atol, order=2):
    """Fail unless every column of the partials is the difference quotient to rtol of its largest entry."""
    expected = central_differences(function, x, step, order)
    assert np.shape(actual) == expected.shape
    for i in range(len(x)):
        largest = np.max(np.abs(expected[..., i]))
        worst, bound = np.max(np.abs(actual[..., i] - expected[..., i])), atol + rtol * largest
        assert worst <= bound, f"column {i}: off by {worst:.2e}, allowed {bound:.2e}, largest {largest:.2e}"
