"""Routes of problems and specifications: check, read back, templates."""

import json
from collections.abc import Iterable
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

from fastapi import APIRouter, Response

from core.orbits.reach import remarks_on
from core.problem import problem_from
from service.api.context import Hash, HeavyHere, Id, StoreHere
from service.dashboard.structure import structure_of
from service.schemas.problem import (
    FaultView,
    PlannedSearch,
    ProblemFamily,
    ProblemPage,
    ProblemStructure,
    ProblemView,
    SpecCheck,
    SpecPlan,
    SpecTemplates,
    SpecText,
    SpecToCheck,
)
from service.spec import Spec, problem_without_files
from service.spec.spec_check import check_text, planned, require_flyable
from service.spec.spec_text import spec_text
from service.store.store import Store

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
    view, is_new = await heavy.run(_add, store, fields)
    response.status_code = 201 if is_new else 200
    response.headers["location"] = f"/api/v1/problems/{view.hash}"
    return view


def _add(store: Store, fields: dict[str, Any]) -> tuple[ProblemView, bool]:
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


specs_router = APIRouter(tags=["campaigns"])

#: In the order in which they are offered.
TEMPLATES = ("quick", "paper-small", "paper")


@specs_router.post("/specs/check")
async def check_spec(wanted: SpecToCheck, heavy: HeavyHere) -> SpecCheck:
    """Say what is wrong with a specification, line by line, or what it would run; nothing is stored."""
    return await heavy.run(_check, wanted.text)


def _check(text: str) -> SpecCheck:
    checked = check_text(text)
    return SpecCheck(
        faults=[FaultView.model_validate(fault) for fault in checked.faults],
        fields=checked.fields,
        plan=None if checked.spec is None else _plan(checked.spec),
        remarks=[] if checked.spec is None else remarks_on(checked.spec.problem),
    )


@specs_router.get("/specs/templates")
def list_templates() -> SpecTemplates:
    """Return specifications to begin with."""
    return _templates()


@specs_router.get("/campaigns/{campaign_id}/spec")
def get_spec(campaign_id: Id, store: StoreHere) -> SpecText:
    """Return the specification of a campaign as TOML, to be changed and submitted as another one."""
    fields = store.spec_fields(campaign_id)
    return SpecText(name=fields["campaign"]["name"], toml=spec_text(fields))


@cache
def _templates() -> SpecTemplates:
    folder = files("service.spec") / "templates"
    texts = {name: (folder / f"{name}.toml").read_text(encoding="utf-8") for name in TEMPLATES}
    return SpecTemplates(items=[SpecText(name=name, toml=toml) for name, toml in texts.items()])


def _plan(spec: Spec) -> SpecPlan:
    searches = planned(spec)
    n_guesses = _sum(search.n_guesses_most for search in searches)
    return SpecPlan(
        name=spec.campaign.name,
        rng_seed=spec.campaign.rng_seed,
        n_segments=spec.problem.n_segments,
        searches=[PlannedSearch.model_validate(search) for search in searches],
        n_cases=sum(search.n_cases for search in searches),
        n_guesses_most=None if n_guesses is None else round(n_guesses),
        core_hours_most=_sum(search.core_hours_most for search in searches),
    )


def _sum(bounds: Iterable[float | None]) -> float | None:
    known = list(bounds)
    return None if None in known else sum(bound for bound in known if bound is not None)
