"""Specifications: checked while somebody types, read back, and a few to begin with."""

from collections.abc import Iterable
from functools import cache
from importlib.resources import files

from fastapi import APIRouter

from service.api.context import HeavyHere, Id, StoreHere
from service.schemas.problem import (
    FaultView,
    PlannedSearch,
    SpecCheck,
    SpecPlan,
    SpecTemplates,
    SpecText,
    SpecToCheck,
)
from service.spec import Spec
from service.spec.spec_check import check_text, planned
from service.spec.spec_text import spec_text

router = APIRouter(tags=["campaigns"])

#: In the order in which they are offered.
TEMPLATES = ("quick", "paper-small", "paper")


@router.post("/specs/check")
async def check_spec(wanted: SpecToCheck, heavy: HeavyHere) -> SpecCheck:
    """Say what is wrong with a specification, line by line, or what it would run; nothing is stored."""
    return await heavy.run(_checked, wanted.text)


def _checked(text: str) -> SpecCheck:
    checked = check_text(text)
    return SpecCheck(
        faults=[FaultView.model_validate(fault) for fault in checked.faults],
        fields=checked.fields,
        plan=None if checked.spec is None else _plan(checked.spec),
    )


@router.get("/specs/templates")
def list_templates() -> SpecTemplates:
    """Return specifications to begin with."""
    return _templates()


@router.get("/campaigns/{campaign_id}/spec")
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
