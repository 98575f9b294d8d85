"""From closed trajectories to the local optimum: descent and IPOPT take turns."""

from core.nlp.descent import State
from core.nlp.limits import Limits
from core.nlp.outcome import ExitStatus
from core.nlp.phases import close, is_solved, save_propellant
from core.nlp.polish import Polished, polish
from core.nlp.robust import JOINT_ITERATIONS, Robust
from core.nlp.thrust_vectors import ThrustVectors
from core.transcription import Guess

#: Legs of the form in which propellant is saved: shorter ones bend less.
OPTIMUM_LEGS = 20
#: How often the descent and IPOPT take turns until the optimum is found.
ROUNDS = 3
#: Mass that a round must gain for another to follow [kg].
LEAST_GAIN = 0.1


def optimize(robust: Robust, is_near: bool) -> ExitStatus:
    """Save propellant with the realizations that act on the reference, then converge to the optimum.

    Parameters
    ----------
    robust : Robust
        Its reference and acting realizations are closed; they are replaced by better ones.
    is_near : bool
        Whether they are taken to be optimal, or nearly so: then there is no descent.

    Returns
    -------
    ExitStatus
        OPTIMAL, ACCEPTABLE short of that, STALLED if nothing was gained, IMPACT, or which limit came.
    """
    limits, acting = robust.limits, robust.acting
    part = robust.together(acting, max(OPTIMUM_LEGS, robust.transcription.n_legs))
    form = ThrustVectors(part)
    is_settled = is_near
    for _ in range(1 if is_near else ROUNDS):
        before = robust.final_mass
        if not is_near:
            state = State(form, form.start(robust.guess(acting)), 1.0)
            save_propellant(state, limits)
            if is_solved(state):
                is_settled |= robust.improve(part, form.decision(state.z), state.z)
            if not part.is_clear(robust.vector(acting)):
                return ExitStatus.IMPACT
        polished = polish(part, robust.guess(acting), limits)
        if polished.is_optimal:
            if robust.improve(part, polished.x, polished.z):
                return ExitStatus.OPTIMAL
            # The optimum lies inside a body, or is too sensitive to be flown.
            break
        if limits.is_over:
            return failure(limits)
        is_settled |= _close_again(robust, form, polished)
        if robust.final_mass < before + LEAST_GAIN:
            break
    return ExitStatus.ACCEPTABLE if is_settled else ExitStatus.STALLED


def _close_again(robust: Robust, form: ThrustVectors, polished: Polished) -> bool:
    """Take where IPOPT stopped short of the optimum, if that can be closed and is better; return whether."""
    nodes = tuple(form.transcription.nodes_of(polished.z, i) for i in range(1 + len(robust.acting)))
    state = close(form, form.start(Guess(polished.x, nodes)), robust.limits, JOINT_ITERATIONS)
    return is_solved(state) and robust.improve(form.transcription, form.decision(state.z), state.z)


def failure(limits: Limits) -> ExitStatus:
    """Return why defects stay open, or why the optimum was not reached."""
    if limits.is_stopped:
        return ExitStatus.STOPPED
    if limits.is_late:
        return ExitStatus.TIMEOUT
    return ExitStatus.ITERATION_LIMIT if limits.is_over else ExitStatus.LOCALLY_INFEASIBLE
