"""What a set of measured solves comes to: shares with intervals, costs, distributions, failures."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from core.analysis.metrics import feasibility_ratio
from workers.bench_measurement import Measurement

#: What a distribution is told by.
QUANTILES = {"min": 0.0, "q1": 0.25, "median": 0.5, "q3": 0.75, "max": 1.0}


def share(n_successes: int, n: int) -> dict[str, float | int | None]:
    """Return a share with its 95 % Wilson interval; its value is null for n = 0."""
    value, low, high = feasibility_ratio(n_successes, n)
    return {"n": n_successes, "of": n, "value": value if n else None, "low": low, "high": high}


def spread(values: Iterable[float | None]) -> dict[str, float] | None:
    """Return least, quartiles and greatest of the values that are known; null if none is."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    return dict(zip(QUANTILES, np.quantile(known, list(QUANTILES.values())).tolist(), strict=True))


def costs(found: Sequence[Measurement]) -> dict[str, float | None]:
    """Return CPU times [s]; those per solution charge the failures too, and are null without solutions."""
    spent = sum(one.cpu_seconds for one in found)
    n_strict, n_optimal = (sum(flags) for flags in ([m.strict for m in found], [m.is_optimal for m in found]))
    return {
        "cpu_seconds": spent,
        "verify_seconds": sum(one.verify_seconds for one in found),
        "cpu_seconds_per_strict": spent / n_strict if n_strict else None,
        "cpu_seconds_per_optimal": spent / n_optimal if n_optimal else None,
    }


def failures(found: Sequence[Measurement]) -> dict[str, int]:
    """Return how often each failure came, the most frequent first."""
    return dict(Counter(one.failure for one in found if not one.strict).most_common())


def summary(found: Sequence[Measurement]) -> dict[str, Any]:
    """Return all that `bench solve` says about its guesses, as plain data."""
    solved, failed = [m for m in found if m.strict], [m for m in found if not m.strict]
    propellant = spread(one.propellant_kg for one in solved)
    return {
        "paper": share(sum(one.paper for one in found), len(found)),
        "strict": share(len(solved), len(found)),
        "optimal": share(sum(one.is_optimal for one in found), len(found)),
        "costs": costs(found),
        "best_propellant_kg": propellant["min"] if propellant else None,
        "median_propellant_kg": propellant["median"] if propellant else None,
        "stationarity": spread(one.stationarity for one in solved),
        "successes": _distributions(solved),
        "failures": _distributions(failed),
        "failed_by": failures(found),
        "ended_by": dict(Counter(one.status for one in found).most_common()),
        "faults": sorted({one.fault for one in found if one.fault}),
    }


def _distributions(found: Sequence[Measurement]) -> dict[str, Any]:
    return {
        "cpu_seconds": spread(one.cpu_seconds for one in found),
        "iterations": spread(one.n_iterations for one in found),
        "propellant_kg": spread(one.propellant_kg for one in found),
    }
