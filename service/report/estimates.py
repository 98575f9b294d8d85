"""Numbers of a summary as a report shows them: in percent and in seconds, with their intervals."""

from math import inf

from core.analysis.metrics import Estimate, Ratio, Spread

SECONDS_PER_HOUR = 3600.0


def percent(ratio: Ratio) -> Estimate | None:
    """Return a ratio in percent, None without any guess."""
    return None if ratio.value != ratio.value else Estimate(*(100.0 * value for value in ratio))


def seconds_per_solution(hours: float, n_solves: int, ratio: Ratio) -> Estimate | None:
    """Return core-seconds per solution; the interval is that of the ratio, and open while it is zero."""
    if not n_solves:
        return None
    seconds = SECONDS_PER_HOUR * hours / n_solves
    return Estimate(
        *(seconds / share if share > 0.0 else inf for share in (ratio.value, ratio.high, ratio.low))
    )


def in_seconds(hours: Estimate) -> Estimate:
    """Return core-hours as core-seconds."""
    return Estimate(*(SECONDS_PER_HOUR * value for value in hours))


def mean_of(spread: Spread) -> Estimate | None:
    """Return a mean with its interval, which is not a number for a single value."""
    return Estimate(spread.mean, spread.mean_low, spread.mean_high) if spread.n else None


def number(value: float) -> float | None:
    """Return a number, or None for what is none."""
    return None if value != value else value


def duration_label(days: float | None) -> str:
    """Return the outages' duration as words: nothing without outages."""
    if days is None:
        return "mixed"
    return f"{days:.1f} d" if days else ""


def strategy_key(strategy: str) -> tuple[int, int]:
    """Return (k, k') of a strategy, whatever its mapping; k' of one without seeds is -1."""
    strategy, _, _ = strategy.partition(" ")
    k, _, seed_k = strategy.removeprefix("S(").removesuffix(")").partition("|")
    return (int(k), int(seed_k) if seed_k else -1) if k.isdecimal() else (10_000, -1)
