"""The certificate of a benchmark's solution: the one place that says what is in it and what must agree."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.analysis.verify import Verification, verify
from core.problem import Problem, calendar_epoch
from core.tolerances import STRICT, violation
from workers.provenance import provenance

#: A flight on another machine rounds otherwise; a certificate's masses come from the vector and do not.
MASS_KG = 1e-9


def certified(problem: Problem, x: NDArray[np.float64], solution: str) -> dict[str, Any]:
    """Fly a solution by the independent verifier and return what it finds, as plain data."""
    return _content(problem, solution, verify(problem, x))


def _content(problem: Problem, solution: str, found: Verification) -> dict[str, Any]:
    here = provenance()
    return {
        "problem": problem.hash,
        "solution": solution,
        "strict": bool(found.strict),
        "failure": found.failure,
        "violation": violation(found.defects, STRICT),
        "integrator": found.integrator,
        "tolerance": found.tolerance,
        "defects_km_km_s_kg": found.defects.tolist(),
        "target_error_km_km_s": found.target_error.tolist(),
        "arrival_epochs_tdb": [calendar_epoch(float(et)) for et in found.arrival_et],
        "final_mass_kg": found.final_mass_kg.tolist(),
        "kernels": dict(found.kernels),
        "code": here.code_version,
        "packages": here.package_versions,
    }


def differences(stated: dict[str, Any], found: dict[str, Any]) -> list[str]:
    """Return in what a certificate contradicts another flight of the same solution."""
    faults = [
        f"{name}: {stated.get(name)} stated, {found[name]} found"
        for name in ("problem", "solution", "strict", "failure", "arrival_epochs_tdb")
        if stated.get(name) != found[name]
    ]
    masses, flown = (np.array(one.get("final_mass_kg", ()), dtype=float) for one in (stated, found))
    if masses.shape != flown.shape or not np.allclose(masses, flown, rtol=0.0, atol=MASS_KG):
        faults.append(f"final_mass_kg: {masses.tolist()} stated, {flown.tolist()} found")
    return faults
