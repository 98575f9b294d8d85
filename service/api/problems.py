"""Problems that campaigns are about."""

from fastapi import APIRouter

from service.api.context import Hash, StoreHere
from service.api.schemas import ProblemPage, ProblemView

router = APIRouter(tags=["problems"])


@router.get("/problems")
def list_problems(store: StoreHere) -> ProblemPage:
    """Return the problems, those with few outages first."""
    return store.problems()


@router.get("/problems/{problem_hash}")
def get_problem(problem_hash: Hash, store: StoreHere) -> ProblemView:
    """Return a problem with every field written out."""
    return store.problem(problem_hash)
