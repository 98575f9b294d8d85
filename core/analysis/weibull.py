"""Weibull laws of times, and the two that describe outages: between safe modes, and until recovery.

All times are in days.
"""

from dataclasses import dataclass
from math import isfinite

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Weibull:
    """The law F(t) = 1 - exp(-(t/scale)^shape) of a time t > 0; docs/method.md, section 13 (R1)."""

    #: Time that a share 1/e exceeds [days].
    scale_days: float
    #: Below 1 the rate falls with time, at 1 it is constant: the exponential law [-].
    shape: float

    def __post_init__(self) -> None:
        """Refuse parameters that make no law."""
        for name, value in (("scale_days", self.scale_days), ("shape", self.shape)):
            if not (isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: expected a positive finite number, got {value}")

    def hazard(self, days: ArrayLike) -> Array:
        """Return (t/scale)^shape [-], the cumulative hazard at times [days]; 0 before time 0."""
        return np.asarray((np.maximum(days, 0.0) / self.scale_days) ** self.shape)

    def cdf(self, days: ArrayLike) -> Array:
        """Return the probability [-] that a time is at most so long [days]."""
        return np.asarray(-np.expm1(-self.hazard(days)))

    def survival(self, days: ArrayLike) -> Array:
        """Return the probability [-] that a time is longer [days]."""
        return np.asarray(np.exp(-self.hazard(days)))

    def density(self, days: ArrayLike) -> Array:
        """Return the density [1/days] at positive times [days]."""
        hazard = self.hazard(days)
        return np.asarray(self.shape * hazard / np.asarray(days, dtype=float) * np.exp(-hazard))

    def quantile(self, probability: ArrayLike) -> Array:
        """Return the time [days] that is not exceeded with a probability in [0, 1)."""
        asked = np.asarray(probability, dtype=float)
        if not np.all((asked >= 0.0) & (asked < 1.0)):
            raise ValueError(f"probability: expected 0 <= p < 1, got {asked}")
        return np.asarray(self.scale_days * (-np.log1p(-asked)) ** (1.0 / self.shape))

    def mean(self) -> float:
        """Return the mean [days]."""
        return float(self.scale_days * scipy.special.gamma(1.0 + 1.0 / self.shape))

    def median(self) -> float:
        """Return the median [days]."""
        return float(self.quantile(0.5))

    def sample(self, rng: np.random.Generator, size: int | tuple[int, ...] = ()) -> Array:
        """Return independent times [days] of the given shape, a single one by default."""
        return np.asarray(self.scale_days * rng.weibull(self.shape, size))


#: Time between safe modes, and duration of the outage that one causes.  The values are those of public code
#: (GitHub paul-witsberger/neat-mt) that cites Imken et al., IEEE Aerospace 2018, doi
#: 10.1109/AERO.2018.8396383; the source itself was not available.  0.62394 years are 227.89 d.
SAFE_MODES = Weibull(scale_days=227.89, shape=0.86737)
RECOVERIES = Weibull(scale_days=2.459, shape=1.144)
