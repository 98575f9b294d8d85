"""P_k as a user-defined problem of pygmo, so that other optimizers can be tried on it.

pygmo calls methods of certain names, so it is not imported here: `pygmo.problem(
PygmoProblem(problem))` is all, with pygmo installed by the extra `pygmo`.  Fitness is -m_f of the reference,
to be minimized, then the defects as equality constraints.  Units are canonical throughout, in which
variables, objective and partials are near 1, as needed by optimizers without scaling of their own;
`to_pygmo` and `from_pygmo` convert decision vectors.
"""

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from core.problem import Problem
from core.transcription import checked_vector, transcribe

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Default tolerance of the integrator: a hundredth of what the solver itself begins with.
TOLERANCE = 3e-12


class PygmoProblem:
    """P_k with fitness, gradient, sparsity and bounds, to be handed to `pygmo.problem`.

    Parameters
    ----------
    problem : Problem
        The problem P_k.
    tolerance : float
        Of the integrator, relative and absolute in canonical units [-].

    Raises
    ------
    ValueError
        When the tolerance cannot be met.
    """

    def __init__(self, problem: Problem, tolerance: float = TOLERANCE) -> None:
        self.problem = problem
        self.transcription = transcribe(problem, n_legs=1, tolerance=tolerance)
        self._structure = self.transcription.plain
        self._mass = self.transcription.layout.reference.final_mass
        # pygmo wants the entries row by row, each row from left to right.
        self._order = np.lexsort((self._structure.columns, self._structure.rows))

    def fitness(self, z: Array) -> Array:
        """Return the objective and the constraints.

        Parameters
        ----------
        z : (n_variables,) array
            Decision vector in the paper layout, canonical [TU, rad, MU].

        Returns
        -------
        (1 + n_defects,) array
            -m_f of the reference [MU], then the defects [LU, VU, MU], NaN where it cannot be flown.
        """
        z = np.asarray(z, dtype=np.float64)
        defects, _ = self.transcription.evaluate(self._structure, z, with_partials=False)
        return np.concatenate([[-z[self._mass]], defects])

    def gradient(self, z: Array) -> Array:
        """Return the partials of the fitness that can differ from zero.

        Parameters
        ----------
        z : (n_variables,) array
            Decision vector in the paper layout, canonical [TU, rad, MU].

        Returns
        -------
        (n_nonzeros,) array
            In the order of `gradient_sparsity`, canonical [-].

        References
        ----------
        docs/method.md, eqs. 9-20.
        """
        z = np.asarray(z, dtype=np.float64)
        _, values = self.transcription.evaluate(self._structure, z, with_partials=True)
        return np.concatenate([[-1.0], values[self._order]])

    def gradient_sparsity(self) -> Indices:
        """Return (n_nonzeros, 2) rows of the fitness and columns of z where partials can differ from 0."""
        rows, columns = self._structure.rows[self._order], self._structure.columns[self._order]
        return np.vstack([[0, self._mass], np.stack([1 + rows, columns], axis=1)])

    def get_bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds, (n_variables,) each, canonical [TU, rad, MU]."""
        lower, upper = self.transcription.bounds
        return self.to_pygmo(lower), self.to_pygmo(upper)

    def get_nobj(self) -> int:
        """Return the number of objectives."""
        return 1

    def get_nec(self) -> int:
        """Return the number of equality constraints: seven defects per trajectory."""
        return self.transcription.n_defects

    def get_nic(self) -> int:
        """Return the number of inequality constraints: none."""
        return 0

    def get_name(self) -> str:
        """Return which P_k this is."""
        return f"coastarc P_{self.problem.k}"

    def get_extra_info(self) -> str:
        """Return the parameters that identify this problem."""
        outages = [f"{outage.segment} ({outage.duration_days:g} d)" for outage in self.problem.outages]
        return (
            f"\tProblem hash: {self.problem.hash}"
            f"\n\tSegments: {self.problem.n_segments}"
            f"\n\tOutages at segments: {', '.join(outages) or 'none'}"
            f"\n\tIntegrator tolerance: {self.transcription.tolerance:g}"
        )

    @property
    def constraint_tolerance(self) -> Array:
        """Tolerances (n_defects,) for `pygmo.problem.c_tol` that make a feasible z strict [LU, VU, MU]."""
        # Strict bounds the norm of three components, pygmo each of them alone.
        strict = self.transcription.world.strict
        position, velocity = strict.position_km / np.sqrt(3.0), strict.velocity_km_s / np.sqrt(3.0)
        each = np.array([position] * 3 + [velocity] * 3 + [strict.mass_kg]) / self.transcription.state_scale
        return np.tile(each, 1 + self.problem.k)

    def to_pygmo(self, x: Array) -> Array:
        """Return a decision vector in pygmo's canonical units.

        Parameters
        ----------
        x : (n_variables,) array
            In the paper layout [days, rad, kg].

        Returns
        -------
        (n_variables,) array
            The same, canonical [TU, rad, MU].

        Raises
        ------
        ValueError
            When x has another shape or is not finite.
        """
        return checked_vector(self.transcription.layout, x) / self.transcription.scale

    def from_pygmo(self, z: Array) -> Array:
        """Return the decision vector of a point of pygmo, ready for `core.verify`.

        Parameters
        ----------
        z : (n_variables,) array
            In the paper layout, canonical [TU, rad, MU].

        Returns
        -------
        (n_variables,) array
            The same [days, rad, kg].

        Raises
        ------
        ValueError
            When z has another shape or is not finite.
        """
        return checked_vector(self.transcription.layout, z) * self.transcription.scale

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Return itself: it never changes, and pygmo copies problems often."""
        return self

    def __reduce__(self) -> tuple[type[Self], tuple[Problem, float]]:
        """Pickle the constructor's arguments; tables and plans are rebuilt on unpickling."""
        return type(self), (self.problem, self.transcription.tolerance)
