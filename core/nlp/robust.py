"""P_k from a reference: realizations that close against it, and those that require it to change.

The objective and the reference's defects do not depend on the realizations' variables.  A realization that
closes with the reference fixed therefore costs nothing and does not affect the optimum: its multipliers
vanish.  Only the others, usually few, are solved and optimized together with the reference.
docs/method.md, section 7.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from core.nlp.descent import ThrustVectors, close, is_solved, reach, starts, tighten
from core.nlp.feasibility import close_finely, is_feasible
from core.nlp.outcome import Limits
from core.problem import Problem
from core.transcription import FINE_TOLERANCE, Guess, OutageProfile, Transcription, checked_vector, transcribe

Array = NDArray[np.float64]

#: From a problem and a depth of its outages between 0 and 1 [-] to the thrust that remains during them.
Deepen = Callable[[Problem, float], tuple[OutageProfile, ...]]

#: Iterations in which a realization and the reference must close together, and a step of the depth.
JOINT_ITERATIONS, STEP_ITERATIONS = 60, 40
#: First step of the depth, its growth after success and shrinkage after failure, and the least step.
FIRST_STEP, GROW, SHRINK, LEAST_STEP = 0.5, 2.0, 0.3, 0.01

# What a solution may lose by being closed better, as a share of the wet mass [-]: a gram of the flagship's.
_LOSS = 1e-3 / 15000.0


@dataclass(slots=True, eq=False)
class Robust:
    """The state of a solve: the reference, the realizations, and which of them act on the reference.

    Only its methods change it.
    """

    transcription: Transcription
    limits: Limits
    deepen: Deepen | None
    #: x of the reference and of each realization.
    reference: Array
    realizations: list[Array]
    #: States that start the nodes of the reference and of each realization; None: propagate.
    path: Array | None
    states: list[Array | None]
    #: Whether the reference is closed on its own.
    is_started: bool = False
    #: Realizations, by number from 0, that close only if the reference moves.
    acting: list[int] = field(default_factory=list)
    #: Those that close against the reference as it stands.
    closed: set[int] = field(default_factory=set)

    @classmethod
    def of(
        cls, transcription: Transcription, guess: Array | Guess, limits: Limits, deepen: Deepen | None
    ) -> Self:
        """Return P_k at a guess, which is projected into the bounds first."""
        lower, upper = transcription.bounds
        x = np.clip(checked_vector(transcription.layout, guess), lower, upper)
        # They do not change the path, but every check would integrate them, and their errors grow at the
        # matchpoint.
        idle = transcription.idle_coasts
        x[idle] = lower[idle]
        ends = [trajectory.stop for trajectory in transcription.layout.trajectories]
        reference, *realizations = np.split(x, ends[:-1])
        states = guess.states if isinstance(guess, Guess) else None
        path, *others = states or (None,) * len(ends)
        return cls(transcription, limits, deepen, reference, realizations, path, others)

    @property
    def x(self) -> Array:
        """The whole decision vector."""
        return self.vector(list(range(len(self.realizations))))

    @property
    def final_mass(self) -> float:
        """Final mass of the reference [kg]."""
        return float(self.reference[self.transcription.layout.reference.final_mass])

    def together(self, members: list[int], n_legs: int | None = None) -> Transcription:
        """Return the problem of the reference and some of the realizations."""
        problem = self.transcription.problem
        outages = tuple(problem.outages[i] for i in members)
        part = problem.model_copy(update={"outages": outages})
        whole = self.transcription
        return transcribe(part, n_legs or whole.n_legs, whole.tolerance, start=whole.start)

    def start_from(self, reference: Array, path: Array | None) -> None:
        """Take a reference that is closed on its own; realizations are then closed against it."""
        self.reference, self.path, self.is_started = reference, path, True

    def fall_back(self, reference: Array) -> None:
        """Take the reference with the least violation where none closes."""
        self.reference, self.path = reference, None

    def join(self, member: int) -> bool:
        """Let a realization act on the reference: close it together with those that do."""
        together = sorted([*self.acting, member])
        if not self.close_together(together):
            return False
        self.acting = together
        self.closed -= set(together)
        return True

    def close_alone(self, member: int) -> bool:
        """Try to close a realization against the reference as it stands."""
        part = self.together([member])
        form = ThrustVectors(part, is_reference_fixed=True)
        fine = ThrustVectors(part.at_tolerance(FINE_TOLERANCE), is_reference_fixed=True)
        self.closed.discard(member)
        for z in starts(form, form.start(self.guess([member]))):
            state = reach(form, z, self.limits)
            if is_solved(state):
                # The reference is propagated again: its nodes may come from the coarser integration
                # tolerance.
                nodes = (None, part.nodes_of(state.z, 1))
                state = tighten(fine, fine.start(Guess(form.decision(state.z), nodes)), self.limits)
                x = np.concatenate([self.reference, fine.decision(state.z)[len(self.reference) :]])
                if is_feasible(part, x, first=1):
                    self.take([member], part, x, state.z)
                    self.closed.add(member)
                    return True
            if self.limits.is_over:
                break
        return False

    def close_together(self, members: list[int]) -> bool:
        """Try to close realizations and reference by moving all of them, as little as possible."""
        form = ThrustVectors(self.together(members))
        z = form.start(self.guess(members))
        state = close(form, z, self.limits, JOINT_ITERATIONS)
        if is_solved(state):
            self.take(members, form.transcription, form.decision(state.z), state.z)
            return True
        if self.deepen is None:
            return False
        deepest = self._continue_depth(members, self.deepen, z)
        if deepest is not None:
            self.take(members, form.transcription, form.decision(deepest), deepest)
        return deepest is not None

    def improve(self, part: Transcription, x: Array, z: Array) -> bool:
        """Take a solution of the acting realizations' problem, unless it is open or another leaves more mass.

        The finer integrator decides what is closed: optima of sensitive paths can be lost to the coarser one.
        """
        closed = close_finely(part, x)
        if not is_feasible(part, closed):
            closed = self._tighten(part, x, z)
        is_better = (
            closed[part.layout.reference.final_mass] > self.final_mass - _LOSS * part.world.units.mu_kg
        )
        if not is_feasible(part, closed) or (not is_better and is_feasible(part, self.vector(self.acting))):
            return False
        self.take(self.acting, part, closed, z)
        return True

    def finish(self) -> None:
        """Close what is closed by the finer integrator: first what acts on the reference, then the others."""
        self.reference, *parts = self._split(
            self.acting, close_finely(self.together(self.acting), self.vector(self.acting))
        )
        self.path = None
        for member, part in zip(self.acting, parts, strict=True):
            self.realizations[member] = part
        for member in sorted(self.closed):
            fine = self.together([member]).at_tolerance(FINE_TOLERANCE)
            form = ThrustVectors(fine, is_reference_fixed=True)
            state = tighten(form, form.start(self.guess([member])), self.limits)
            self.take([member], fine, form.decision(state.z), state.z)

    def take(self, members: list[int], transcription: Transcription, x: Array, z: Array) -> None:
        """Take the reference and some realizations from a solution of theirs, x and lifted z.

        The nodes are kept: propagated again, they would run away from where the solution is.
        """
        self.reference, *parts = self._split(members, x)
        self.path = transcription.nodes_of(z, 0)
        for trajectory, member in enumerate(members, start=1):
            self.realizations[member] = parts[trajectory - 1]
            self.states[member] = transcription.nodes_of(z, trajectory)

    def vector(self, members: list[int]) -> Array:
        """Return x of the reference and some realizations."""
        return np.concatenate([self.reference, *(self.realizations[i] for i in members)])

    def guess(self, members: list[int]) -> Array | Guess:
        """Return the reference and some realizations as a guess for their problem."""
        x = self.vector(members)
        states = (self.path, *(self.states[i] for i in members))
        return x if all(state is None for state in states) else Guess(x, states)

    def _tighten(self, part: Transcription, x: Array, z: Array) -> Array:
        """Return a solution closed leg by leg with the finer integration tolerance."""
        fine = part.at_tolerance(FINE_TOLERANCE)
        form = ThrustVectors(fine)
        nodes = tuple(part.nodes_of(z, i) for i in range(1 + len(self.acting)))
        state = tighten(form, form.start(Guess(x, nodes)), self.limits)
        return close_finely(part, form.decision(state.z))

    def _split(self, members: list[int], x: Array) -> list[Array]:
        """Return x of the reference and of each of some realizations."""
        ends = np.cumsum([len(self.reference)] + [len(self.realizations[i]) for i in members])
        return np.split(x, ends[:-1])

    def _continue_depth(self, members: list[int], deepen: Deepen, z: Array) -> Array | None:
        """Return a closed vector at full depth, by continuation from outages with some thrust left."""
        problem = self.together(members).problem
        full = deepen(problem, 1.0)
        depth, step = 0.0, FIRST_STEP
        while depth < 1.0 and step >= LEAST_STEP and not self.limits.is_over:
            trial = min(1.0, depth + step)
            # Acting realizations are closed at full depth already.
            profiles = tuple(
                deep if member in self.acting else shallow
                for member, deep, shallow in zip(members, full, deepen(problem, trial), strict=True)
            )
            whole = self.transcription
            flown = transcribe(problem, whole.n_legs, whole.tolerance, profiles, whole.start)
            state = close(ThrustVectors(flown), z.copy(), self.limits, STEP_ITERATIONS)
            if is_solved(state):
                z, depth, step = state.z, trial, step * GROW
            else:
                step *= SHRINK
        return z if depth >= 1.0 else None
