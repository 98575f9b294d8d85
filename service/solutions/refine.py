"""Mesh refinement of a solution: a campaign for each number of segments, seeded by the one before.

Each is a campaign like any other, with one search and one map job; so its result has a lineage, can be
reproduced, and the same refinement asked for again is the same campaign.

    RefineError(ValueError)   a refinement that cannot be
"""

from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel

from core.errors import UserError
from core.problem import ProblemError, problem_from
from core.search import REFINED, refined_problem
from service.schemas.solution import Filter, RecordInFull
from service.spec import Spec, spec_from
from service.store.store import Store


class RefineError(UserError, ValueError):
    """An impossible refinement."""


class Step(BaseModel):
    """What one number of segments gave."""

    n_segments: int
    campaign_id: int | None
    solution_id: str
    status: str
    strict: bool
    final_mass_kg: float
    propellant_kg: float
    #: Final mass more than that of the step before, and than that of the first solution [kg].
    gain_kg: float
    total_gain_kg: float
    cpu_seconds: float


def check_segments(n_segments: int, wanted: Sequence[int]) -> None:
    """Raise RefineError unless each number of segments is a multiple of the one before."""
    before = n_segments
    for number in wanted:
        if number <= before or number % before:
            raise RefineError(f"--segments: expected a multiple of {before} and more than that, got {number}")
        before = number


def refinement_spec(store: Store, record: RecordInFull, n_segments: int, limits: dict[str, Any]) -> Spec:
    """Return the campaign that refines a solution."""
    definition, _ = store.definition_and_vector(record.id)
    try:
        finer = refined_problem(problem_from(definition), n_segments).model_dump(mode="json")
    except ProblemError as error:
        raise RefineError(f"refine {record.id[:8]}: {error}") from error
    outages = finer.pop("outages")
    search = {
        "id": "refined",
        "strategy": f"S({record.k}|{record.k})",
        "outages": outages,
        "mapping": REFINED,
        "seeds": {
            "solution": record.id,
            "tolerance": "strict" if record.strict else "paper",
        },
    }
    name = f"refine {record.id[:8]} to {n_segments}"
    fields = {"campaign": {"name": name, "rng_seed": 0}, "problem": finer, "search": [search | limits]}
    return spec_from(fields, allow_files=True)


def best_of(store: Store, campaign_id: int) -> RecordInFull | None:
    """Return the solution of a campaign with the most final mass."""
    ids = store.certificates.ids(Filter(campaign=campaign_id))
    return store.record(ids[0]) if ids else None


def first_step(store: Store, record: RecordInFull) -> Step:
    """Return where a refinement begins."""
    definition, _ = store.definition_and_vector(record.id)
    return Step(
        n_segments=definition["n_segments"],
        campaign_id=None,
        solution_id=record.id,
        status=record.status,
        strict=record.strict,
        final_mass_kg=record.objective_kg,
        propellant_kg=record.propellant_kg,
        gain_kg=0.0,
        total_gain_kg=0.0,
        cpu_seconds=record.cpu_seconds,
    )


def next_step(steps: Sequence[Step], record: RecordInFull, campaign_id: int, n_segments: int) -> Step:
    """Return what a further number of segments gave."""
    mass = record.objective_kg
    return Step(
        n_segments=n_segments,
        campaign_id=campaign_id,
        solution_id=record.id,
        status=record.status,
        strict=record.strict,
        final_mass_kg=mass,
        propellant_kg=record.propellant_kg,
        gain_kg=mass - steps[-1].final_mass_kg,
        total_gain_kg=mass - steps[0].final_mass_kg,
        cpu_seconds=record.cpu_seconds,
    )
