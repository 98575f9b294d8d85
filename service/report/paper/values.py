"""Values that the paper reports for its strategies.

Each number is marked as printed in Table 8, read from a figure, or computed.  The paper prints
neither the guesses nor, for conditional strategies, the solutions; the counts here are those that reproduce
every printed digit or every value read.  Delta-v includes the paper's spiral, 3.252 km/s.
"""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, NamedTuple

from core.analysis.campaign_statistics import CHARGE_HOURS
from core.analysis.cumulative_cost import Link, cumulative_hours, cumulative_ratio, full_hours
from core.analysis.metrics import Estimate, Ratio, feasibility_ratio
from core.problem import Problem, load_problem

#: P printed, F read from a figure, C computed: here, implied by the others.
Mark = Literal["P", "F", "C"]
#: What the head of a column says of each mark.
PRINTED, READ = "paper, printed", "paper, read from a figure"
DERIVED = "paper, computed from its numbers"
SOURCES = MappingProxyType({"P": PRINTED, "F": READ, "C": DERIVED})
#: The preset that the paper's numbers belong to.
FLAGSHIP = "ppe-drm3"
#: Outage durations of the paper's cases [days].
DURATIONS_DAYS = (0.5, 1.0, 1.5)
#: Delta-v of the paper's spiral [km/s]: 15,000 kg to 13,271 kg.
SPIRAL_DELTA_V_KM_S = 3.252
#: Precision of reading figures: relative for ratios and hours, in km/s for delta-v.
READING_SHARE = 0.005
READING_KM_S = 0.003


def is_flagship(problem: Problem) -> bool:
    """Return whether a problem is the one that the paper solves, whatever its outages."""
    return problem.family == load_problem(FLAGSHIP).family


class Published(NamedTuple):
    """A number of the paper, its source, and its error bound."""

    value: float
    mark: Mark
    #: Half a unit of the last digit, for figures with the precision of reading; in the unit of the value.
    error: float


@dataclass(frozen=True, slots=True)
class PaperValue:
    """One strategy at one outage duration in the paper, all its cases together."""

    strategy: str
    k: int
    seed_k: int | None
    #: 0 for S(0), which has no outage.
    duration_days: float
    #: Implied by ratio and hours.
    n_guesses: int
    n_solutions: int
    n_solutions_mark: Mark
    #: [-].
    ratio: Published
    hours_per_solution: Published
    mean_delta_v_total_km_s: Published
    #: The paper's sum along the seed chain, where its figure was read.
    cumulative_hours: Published | None

    @property
    def ratio_interval(self) -> Ratio:
        """The ratio of the counts with its Wilson interval."""
        return feasibility_ratio(self.n_solutions, self.n_guesses)

    @property
    def mean_delta_v_km_s(self) -> float:
        """Of the transfer alone."""
        return self.mean_delta_v_total_km_s.value - SPIRAL_DELTA_V_KM_S

    @property
    def cumulative_ratio(self) -> Ratio:
        """Product along the seed chain, from the counts."""
        return cumulative_ratio(self.links())

    @property
    def summed_hours(self) -> Estimate:
        """Sum of the hours per solution along the seed chain, from the counts."""
        return cumulative_hours(self.links())

    @property
    def full_hours(self) -> Estimate:
        """What a solution costs with its seeds, each used once, from the counts."""
        return full_hours(self.links())

    def links(self) -> list[Link]:
        """Return the seed chain in the paper's currency; seeds come from the searches without seeds."""
        seeds = paper_value(f"S({self.seed_k})", self.duration_days) if self.seed_k is not None else None
        n_seeds = self.n_guesses if seeds else 0
        hours = CHARGE_HOURS * (1 + self.k) * self.n_guesses
        link = Link(self.strategy, self.n_guesses, self.n_solutions, n_seeds, hours)
        return [*seeds.links(), link] if seeds else [link]


def paper_value(strategy: str, duration_days: float) -> PaperValue | None:
    """Return what the paper reports of a strategy, or None where it reports nothing.

    Parameters
    ----------
    strategy : str
        As in "S(1)" and "S(1|0)"; of "S(0)" there is one value, whatever the duration.
    duration_days : float
        Duration of the outages [days].
    """
    return _VALUES.get((strategy, 0.0 if strategy == "S(0)" else duration_days))


def paper_values() -> tuple[PaperValue, ...]:
    """Return all that the paper reports, in the order of its tables and figures."""
    return tuple(_VALUES.values())


#: Table 8: k; per duration guesses (implied), solutions, ratio [%] and hours per solution as printed; the
#: mean total delta-v [km/s] read from Figs 10-13.
_TABLE_8 = (
    (0, 2400, (233,), ("9.71",), ("5.15",), (4.060,)),
    (
        1,
        12000,
        (1053, 998, 956),
        ("8.78", "8.32", "7.97"),
        ("11.40", "12.02", "12.55"),
        (4.189, 4.152, 4.147),
    ),
    (2, 4800, (161, 128, 114), ("3.35", "2.67", "2.38"), ("44.72", "56.25", "63.16"), (4.172, 4.150, 4.132)),
    (3, 3600, (8, 3, 4), ("0.22", "0.08", "0.11"), ("900", "2400", "1800"), (4.229, 4.245, 4.335)),
)
#: k, k'; per duration seeds, each used once (implied), solutions (implied), ratio [%] and hours per solution
#: read from Figs 14 and 15, mean total delta-v [km/s], and the cumulative hours read from Fig. 17.
_FIGURES = (
    (1, 0, 233, (156, 80, 89), ("66.9", "34.2", "38.3"), ("1.50", "2.93", "2.62"), (4.040, 4.024, 4.073), ()),
    (2, 0, 233, (14, 11, 8), ("5.99", "4.72", "3.43"), ("25.0", "31.9", "43.8"), (4.082, 4.065, 3.992), ()),
    (2, 1, 1053, (50, 36, 32), ("4.76", "3.43", "3.04"), ("31.7", "44.1", "49.3"), (4.184, 4.079, 4.085), ()),
    (
        *(3, 0, 233, (3, 3, 4), ("1.28", "1.28", "1.72"), ("156", "156", "117"), (3.972, 3.974, 4.093)),
        ("161", "161", "122"),
    ),
    (
        *(3, 1, 1053, (10, 15, 16), ("0.953", "1.42", "1.52"), ("211", "141", "132"), (4.024, 4.051, 4.163)),
        ("222", "153", "144"),
    ),
    (
        *(3, 2, 114, (1, 2, 2), ("0.878", "1.75", "1.75"), ("229", "114", "114"), (4.170, 4.111, 4.306)),
        ("273", "171", "177"),
    ),
)


def _from_print(digits: str, unit: float = 1.0) -> Published:
    return Published(float(digits) * unit, "P", _half_digit(digits) * unit)


def _from_figure(digits: str, unit: float = 1.0) -> Published:
    error = READING_SHARE * float(digits) + _half_digit(digits)
    return Published(float(digits) * unit, "F", error * unit)


def _half_digit(digits: str) -> float:
    return 0.5 * float(10.0 ** -len(digits.partition(".")[2]))


def _delta_v(value: float) -> Published:
    return Published(value, "F", READING_KM_S)


def _non_conditional() -> list[PaperValue]:
    return [
        PaperValue(
            strategy=f"S({k})",
            k=k,
            seed_k=None,
            duration_days=DURATIONS_DAYS[i] if k else 0.0,
            n_guesses=n_guesses,
            n_solutions=found,
            n_solutions_mark="P",
            ratio=_from_print(ratios[i], 0.01),
            hours_per_solution=_from_print(hours[i]),
            mean_delta_v_total_km_s=_delta_v(means[i]),
            cumulative_hours=None,
        )
        for k, n_guesses, counts, ratios, hours, means in _TABLE_8
        for i, found in enumerate(counts)
    ]


def _conditional() -> list[PaperValue]:
    return [
        PaperValue(
            strategy=f"S({k}|{seed_k})",
            k=k,
            seed_k=seed_k,
            duration_days=DURATIONS_DAYS[i],
            n_guesses=n_guesses,
            n_solutions=found,
            n_solutions_mark="C",
            ratio=_from_figure(ratios[i], 0.01),
            hours_per_solution=_from_figure(hours[i]),
            mean_delta_v_total_km_s=_delta_v(means[i]),
            cumulative_hours=_from_figure(sums[i]) if sums else None,
        )
        for k, seed_k, n_guesses, counts, ratios, hours, means, sums in _FIGURES
        for i, found in enumerate(counts)
    ]


_VALUES = MappingProxyType(
    {(one.strategy, one.duration_days): one for one in (*_non_conditional(), *_conditional())}
)
