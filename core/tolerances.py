"""When a trajectory counts as closed: two levels of bounds on the defects, docs/method.md section 9."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Bounds on the norms of a trajectory's position, velocity and mass defects."""

    position_km: float
    velocity_km_s: float
    mass_kg: float

    def __str__(self) -> str:
        """Return its bounds as people read them."""
        return f"{self.position_km:g} km, {1e3 * self.velocity_km_s:g} m/s, {self.mass_kg:g} kg"


#: The paper's level; 0.1 km/s is 12-29 % of a whole transfer, so it is weak.
PAPER = Tolerance(1.0, 0.1, 1.0)
#: Ours.
STRICT = Tolerance(0.1, 1e-4, 0.01)


def violation(defects: "NDArray[np.float64]", tolerance: Tolerance = STRICT) -> float:
    """Return the largest norm of a defect over its bound: at most 1 where all hold, infinite if not finite.

    Parameters
    ----------
    defects : (1 + k, 7) array
        Defects [km, km/s, kg].
    tolerance : Tolerance
        Bounds.
    """
    # Imported here: to read a problem needs no arrays.
    import numpy as np

    position = np.linalg.norm(defects[:, :3], axis=1) / tolerance.position_km
    velocity = np.linalg.norm(defects[:, 3:6], axis=1) / tolerance.velocity_km_s
    mass = np.abs(defects[:, 6]) / tolerance.mass_kg
    worst = float(np.max([position, velocity, mass]))
    return worst if np.isfinite(worst) else float("inf")
