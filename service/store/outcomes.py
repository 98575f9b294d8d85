"""How a solve is counted: each once, by the verifier's word where there is one."""

from typing import Any

from sqlalchemy import case

from service.db.tables import SolveRow

#: Feasible at the strict tolerance, at the paper's alone, or not, and then why not.
OUTCOMES = ("strict", "paper", "infeasible", "timeout", "numerical")


def outcome_number() -> Any:
    """Return the place of a solve's outcome in `OUTCOMES` as an SQL expression."""
    return case(
        (SolveRow.strict, 0),
        (SolveRow.paper, 1),
        (SolveRow.ending == "timeout", 3),
        (SolveRow.ending == "numerical", 4),
        else_=2,
    )
