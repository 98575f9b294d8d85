"""Problems: those that campaigns are about, and those that somebody asks seeds for."""

from typing import Annotated, Any

from fastapi import APIRouter, Body, Response

from service.api.context import Hash, StoreHere
from service.api.schemas import ProblemPage, ProblemView
from service.resolve import require_flyable
from service.spec import problem_without_files

router = APIRouter(tags=["problems"])

EXAMPLE = {"preset": "ppe-drm3", "outages": [{"segment": 24, "duration_days": 1.0}]}


@router.get("/problems")
def list_problems(store: StoreHere) -> ProblemPage:
    """Return the problems, those with few outages first."""
    return store.problems()


@router.post("/problems", status_code=201, responses={200: {"model": ProblemView}})
def add_problem(
    fields: Annotated[dict[str, Any], Body(examples=[EXAMPLE])], store: StoreHere, response: Response
) -> ProblemView:
    """Check a problem and store it under its hash, for which seeds may then be asked.

    The same one again changes nothing (200).  Fields are those of a specification's `problem`, and `outages`.
    """
    problem = problem_without_files(fields)
    require_flyable(problem, "problem")
    response.status_code = 201 if store.add_problem(problem) else 200
    response.headers["location"] = f"/api/v1/problems/{problem.hash}"
    return store.problem(problem.hash)


@router.get("/problems/{problem_hash}")
def get_problem(problem_hash: Hash, store: StoreHere) -> ProblemView:
    """Return a problem with every field written out."""
    return store.problem(problem_hash)
