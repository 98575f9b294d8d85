"""What the descent minimizes beside the defects: a function of the throttles, and of the shooting time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.nlp.thrust_vectors import ThrustVectors

Array = NDArray[np.float64]

#: Unit of the propellant in the cost [MU]: 100 kg, so that costs are of order 1.
_UNIT = 1.0 / 150.0


@dataclass(frozen=True, slots=True)
class Cost:
    """Energy or propellant, and a penalty on throttles beyond a limit; all smooth where segments coast."""

    #: Weight of the mean squared throttle of all controls, halved.
    energy: float = 0.0
    #: Whether the reference's propellant counts, and the throttle below which its kink is rounded.
    has_propellant: bool = False
    rounding: float = 0.1
    #: Weight of the squared excess over the limit, halved, in the mean over the reference's segments.
    penalty: float = 0.0
    #: Share of the throttle's upper bound that is the limit.
    limit: float = 0.97

    def value(self, form: ThrustVectors, z: Array) -> float:
        """Return the cost at z."""
        a, n = form.throttles(z), form.n_segments
        excess = self._excess(form, a)
        total = 0.5 * (self.energy * (a @ a) + self.penalty * (excess @ excess)) / n
        if self.has_propellant:
            total += self._rate(form) * z[form.times[0]] * self._burnt(a[:n]).sum()
        return float(total)

    def slope(self, form: ThrustVectors, z: Array, a: Array) -> tuple[Array, Array, Array]:
        """Return d cost / d throttle, and the curvatures across and along the throttle vectors."""
        n = form.n_segments
        length = np.maximum(a, 1e-12)
        excess = self._excess(form, a)
        slope = (self.energy * a + self.penalty * excess) / n
        # What is too short is convex along the vector alone.
        across = (self.energy + self.penalty * np.maximum(excess, 0.0) / length) / n
        along = (self.energy + self.penalty * (excess != 0.0)) / n
        if self.has_propellant:
            rate, root = self._rate(form) * z[form.times[0]], np.sqrt(a[:n] ** 2 + self.rounding**2)
            slope[:n] += rate * a[:n] / root
            across[:n] += rate / root
            along[:n] += rate * self.rounding**2 / root**3
        return slope, across, along

    def by_shooting_time(self, form: ThrustVectors, a: Array) -> float:
        """Return d cost / d T_s of the reference."""
        return (
            self._rate(form) * float(self._burnt(a[: form.n_segments]).sum()) if self.has_propellant else 0.0
        )

    def _excess(self, form: ThrustVectors, a: Array) -> Array:
        """Return how far throttles exceed the limit, negative where they fall short of the lower bound."""
        least = min(form.least / self.limit, 0.5 * (form.least + form.most))
        return np.asarray(np.maximum(a - self.limit * form.most, 0.0) - np.maximum(least - a, 0.0))

    def _burnt(self, a: Array) -> Array:
        return np.asarray(np.sqrt(a * a + self.rounding**2) - self.rounding)

    def _rate(self, form: ThrustVectors) -> float:
        return form.flow / _UNIT / form.n_segments
