"""Problems: those that campaigns are about, and those that somebody asks seeds for."""

import json
from functools import lru_cache
from typing import Any

from fastapi import APIRouter, Response

from core.problem import problem_from
from service.api.context import Hash, HeavyHere, StoreHere
from service.dashboard.structure import structure_of
from service.schemas.problem import ProblemFamily, ProblemPage, ProblemStructure, ProblemView
from service.spec import problem_without_files
from service.spec.spec_check import require_flyable
from service.store import Store

router = APIRouter(tags=["problems"])

#: What follows from a definition holds for ever, but the code that draws it may change.
KEPT = "private, max-age=3600"


@router.get("/problems")
def list_problems(store: StoreHere) -> ProblemPage:
    """Return the problems, those with few outages first."""
    return store.problems()


@router.post("/problems", status_code=201, responses={200: {"model": ProblemView}})
async def add_problem(
    fields: dict[str, Any],
    store: StoreHere,
    heavy: HeavyHere,
    response: Response,
) -> ProblemView:
    """Check a problem and store it under its hash, for which seeds may then be asked.

    The same one again changes nothing (200).  Fields are those of a specification's `problem`, and `outages`.
    """
    view, is_new = await heavy.run(_added, store, fields)
    response.status_code = 201 if is_new else 200
    response.headers["location"] = f"/api/v1/problems/{view.hash}"
    return view


def _added(store: Store, fields: dict[str, Any]) -> tuple[ProblemView, bool]:
    problem = problem_without_files(fields)
    require_flyable(problem, "problem")
    is_new = store.add_problem(problem)
    return store.problem(problem.hash), is_new


@router.get("/problems/{problem_hash}")
def get_problem(problem_hash: Hash, store: StoreHere) -> ProblemView:
    """Return a problem with every field written out."""
    return store.problem(problem_hash)


@router.get("/problems/{problem_hash}/structure")
def get_structure(problem_hash: Hash, store: StoreHere, response: Response) -> ProblemStructure:
    """Return sizes, trajectories, the Jacobian's entries, and chances of outages: what never changes."""
    answer = _structure(json.dumps(store.problem(problem_hash).definition))
    response.headers["Cache-Control"] = KEPT
    return answer


@router.get("/problems/{problem_hash}/family")
def get_family(problem_hash: Hash, store: StoreHere) -> ProblemFamily:
    """Return the best solutions of a problem, and the problems with one outage more or less."""
    return store.family(problem_hash)


@lru_cache(maxsize=128)
def _structure(definition: str) -> ProblemStructure:
    return structure_of(problem_from(json.loads(definition)))
