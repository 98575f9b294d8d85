"""A vector from elsewhere beside that of the set for a case."""

from pathlib import Path

from core.tolerances import STRICT, violation
from core.verification.verify import verify
from service.benchmark.benchmark_set import Case
from service.benchmark.check import problem_mass
from service.benchmark.vector_file import read_vector
from service.schemas.answer import Answer
from service.validation import solution_hash


class Judgement(Answer):
    """What an independent flight says of a vector, and how it compares."""

    case: str
    solution: str
    #: Whether it counts: every defect and every bound holds at the strict tolerance.
    is_strict: bool
    #: Why not, where a trajectory could not be flown.
    failure: str
    #: The largest defect over its tolerance.
    violation: float
    propellant_kg: float
    best_known_kg: float
    #: Propellant beyond that of the solution of the set; negative is better.
    excess_kg: float


def judge(case: Case, path: Path) -> Judgement:
    """Fly the vector in a file and compare."""
    problem = case.problem()
    x = read_vector(path, problem)
    solution = solution_hash(problem.hash, x)
    found = verify(problem, x)
    propellant = problem_mass(problem) - float(found.final_mass_kg[0])
    return Judgement(
        case=case.name,
        solution=solution,
        is_strict=found.strict,
        failure=found.failure,
        violation=violation(found.defects, STRICT),
        propellant_kg=propellant,
        best_known_kg=case.propellant_kg,
        excess_kg=propellant - case.propellant_kg,
    )
