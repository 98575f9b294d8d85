"""The lifted problem as IPOPT sees it, and one run of IPOPT on it."""

from dataclasses import dataclass, field

import cyipopt
import numpy as np
from numpy.typing import NDArray

from core.nlp.limits import Limits
from core.transcription import Transcription
from core.units import MU_KG

Array = NDArray[np.float64]

#: Largest canonical defect of a point that may be kept as feasible: 4 mm, 1e-8 km/s.
CLOSED = 1e-8

#: Once the defects are closed, a run ends after so many iterations without this gain in mass (1 g) [-, MU].
#: Later gains were below 0.3 kg in 2,000 iterations; useful ones came within 200.
PATIENCE, GAIN = 300, 1e-3 / MU_KG

#: Measured on ppe-drm3, docs/decisions/0001-solver-settings.md.
OPTIONS: dict[str, str | float | int] = {
    "print_level": 0,
    "sb": "yes",
    "hessian_approximation": "limited-memory",
    "mu_strategy": "adaptive",
    "mu_init": 1e-4,
    "bound_push": 1e-6,
    "bound_frac": 1e-6,
    "tol": 1e-7,
    "constr_viol_tol": CLOSED,
    "nlp_scaling_method": "none",
}


@dataclass(slots=True, eq=False)
class Run:
    """What one run of IPOPT left behind."""

    #: IPOPT's own return code.
    code: int
    #: (n,) last iterate, and the best one with closed defects if there was any.
    z: Array
    closed: Array | None
    #: Whether it ended because closed points no longer got better.
    is_settled: bool = False


@dataclass(slots=True, eq=False)
class _Callbacks:
    """Objective and constraints with the last values kept, since IPOPT asks for each of them separately."""

    transcription: Transcription
    #: Weight of the final mass in the objective: small, so that the defects close first.
    weight: float
    limits: Limits
    stop_when_closed: bool
    closed: Array | None = None
    _best_at: int = 0
    _at: bytes = b""
    _defects: Array = field(default_factory=lambda: np.empty(0))
    _partials_at: bytes = b""
    _point: Array = field(default_factory=lambda: np.empty(0))
    _values: Array = field(default_factory=lambda: np.empty(0))

    @property
    def _mass(self) -> int:
        return self.transcription.layout.reference.final_mass

    def objective(self, z: Array) -> float:
        return float(-self.weight * z[self._mass])

    def gradient(self, z: Array) -> Array:
        gradient = np.zeros(len(z))
        gradient[self._mass] = -self.weight
        return gradient

    def constraints(self, z: Array) -> Array:
        key = z.tobytes()
        if key != self._at:
            self._defects, _ = self.transcription.evaluate(self.transcription.lifted, z, with_partials=False)
            self._at = key
            self.limits.evaluations += 1
        return self._defects

    def jacobianstructure(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return self.transcription.lifted.rows, self.transcription.lifted.columns

    def jacobian(self, z: Array) -> Array:
        key = z.tobytes()
        if key != self._partials_at:
            self._defects, self._values = self.transcription.evaluate(
                self.transcription.lifted, z, with_partials=True
            )
            self._at = self._partials_at = key
            self._point = z.copy()
            self.limits.evaluations += 1
        return self._values

    def intermediate(
        self,
        alg_mod: int,
        iter_count: int,
        obj_value: float,
        inf_pr: float,
        inf_du: float,
        mu: float,
        d_norm: float,
        regularization_size: float,
        alpha_du: float,
        alpha_pr: float,
        ls_trials: int,
    ) -> bool:
        if iter_count > 0:
            self.limits.iterations += 1
        # The dual infeasibility of an iterate needs its partials, so the last ones are those of this iterate.
        if alg_mod == 0 and inf_pr <= CLOSED:
            self._keep(self._point)
            if self.stop_when_closed:
                return False
        return not (self.limits.is_over or self.is_settled)

    @property
    def is_settled(self) -> bool:
        return self.closed is not None and self.limits.iterations - self._best_at >= PATIENCE

    def _keep(self, z: Array) -> None:
        gain = np.inf if self.closed is None else z[self._mass] - self.closed[self._mass]
        if gain > 0.0:
            self.closed = z
        if gain > GAIN:
            self._best_at = self.limits.iterations


def run_ipopt(
    transcription: Transcription, z: Array, weight: float, limits: Limits, stop_when_closed: bool = False
) -> Run:
    """Run IPOPT from a lifted vector.

    Parameters
    ----------
    transcription : Transcription
        Its lifted form is solved.
    z : (n,) array
        Canonical lifted start; must be finite.
    weight : float
        Factor of the final mass in the objective [-].
    limits : Limits
        Work left; counted here.
    stop_when_closed : bool
        Whether to end at the first iterate whose defects are closed.

    Returns
    -------
    Run
        Never raises for a failed solve; the code says how it ended.
    """
    lower, upper = _lifted_bounds(transcription, len(z))
    n_rows = 7 * len(transcription.lifted.plan.block_plus)
    callbacks = _Callbacks(transcription, weight, limits, stop_when_closed)
    zeros = np.zeros(n_rows)
    problem = cyipopt.Problem(
        n=len(z), m=n_rows, problem_obj=callbacks, lb=lower, ub=upper, cl=zeros, cu=zeros
    )
    for name, value in OPTIONS.items():
        problem.add_option(name, value)
    problem.add_option("max_iter", max(1, limits.iteration_budget - limits.iterations))
    last, info = problem.solve(np.clip(z, lower, upper))
    return Run(int(info["status"]), np.asarray(last), callbacks.closed, callbacks.is_settled)


def _lifted_bounds(transcription: Transcription, n: int) -> tuple[Array, Array]:
    lower, upper = np.full(n, -1e19), np.full(n, 1e19)
    box = transcription.bounds
    for bound, side in zip((lower, upper), box, strict=True):
        bound[: transcription.n_variables] = side / transcription.scale
    return lower, upper
