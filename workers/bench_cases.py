"""The cases of `bench chain`: which outages, and from which seeds."""

import re
from dataclasses import dataclass

from core.problem import Problem


@dataclass(frozen=True, slots=True, order=True)
class Case:
    """S(k|k') at given outages, as `S(3|0)@12-24-40`."""

    #: Number k' of outages of its seeds.
    k_from: int
    #: Segments at whose start the k outages begin.
    segments: tuple[int, ...]

    @property
    def k(self) -> int:
        """Number of outages."""
        return len(self.segments)

    @property
    def group(self) -> str:
        """The strategy."""
        return f"S({self.k}|{self.k_from})"

    @property
    def name(self) -> str:
        """Strategy and outages."""
        return f"{self.group}@{'-'.join(map(str, self.segments))}"

    def problem(self, reference: Problem, duration_days: float) -> Problem:
        """Return P_k; all outages last equally long."""
        return reference.with_outages([(segment, duration_days) for segment in self.segments])

    def is_fed_by(self, other: "Case") -> bool:
        """Return whether solutions of the other case are seeds of this one."""
        return other.k == self.k_from and set(other.segments) < set(self.segments)


def _cases(k_from: int, *outages: tuple[int, ...]) -> tuple[Case, ...]:
    return tuple(Case(k_from, segments) for segments in outages)


# The outages of the paper's tables of P_1, and of P_2 and P_3.
_P1 = tuple((segment,) for segment in (4, 8, 12, 16, 20, 24, 26, 32, 40, 48))
_P2 = ((4, 48), (12, 40), (20, 32), (4, 12), (8, 16), (12, 20))
_P3 = ((4, 24, 48), (4, 26, 48), (12, 24, 40), (12, 26, 40), (4, 8, 12), (4, 12, 20))
_P3_FROM_2 = _cases(2, *_P3)

#: Groups of cases by name; `s3from2` brings along the cases of P_2 that feed it.
GROUPS: dict[str, tuple[Case, ...]] = {
    "s1": _cases(0, *_P1),
    "s2": _cases(0, *_P2),
    "s3": _cases(0, *_P3),
    "s3from2": tuple(c for c in _cases(0, *_P2) if any(t.is_fed_by(c) for t in _P3_FROM_2)) + _P3_FROM_2,
    "s12": _cases(0, tuple(range(4, 49, 4))),
    "s49": _cases(0, tuple(range(1, 50))),
}

#: What runs unless something else is asked for.
DEFAULT_GROUPS = ("s1", "s2", "s3", "s3from2", "s12")


def parsed_cases(text: str) -> list[Case]:
    """Return the cases of a list like `S(1|0)@24,S(3|0)@12-24-40`."""
    return [_parsed(part.strip()) for part in text.split(",")]


def grouped_cases(text: str) -> list[Case]:
    """Return the cases of named groups, as `s1,s12`."""
    found: list[Case] = []
    for name in (part.strip() for part in text.split(",")):
        if name not in GROUPS:
            raise ValueError(f"group: expected one of {', '.join(GROUPS)}, got {name!r}")
        found += GROUPS[name]
    return found


def in_order(cases: list[Case]) -> list[Case]:
    """Return each case once, those that feed others first, or refuse a case that nothing feeds."""
    kept = sorted(dict.fromkeys(cases), key=lambda case: case.k_from)
    for case in kept:
        if case.k_from and not any(case.is_fed_by(other) for other in kept):
            wanted = f"a case with {case.k_from} of its outages in the same run"
            raise ValueError(f"case {case.name}: expected {wanted}, which gives its seeds, got none")
    return kept


def _parsed(text: str) -> Case:
    match = re.fullmatch(r"S\((\d+)\|(\d+)\)@(\d+(?:-\d+)*)", text)
    if match is None:
        raise ValueError(f"case: expected one like S(3|0)@12-24-40, got {text!r}")
    k, k_from = int(match[1]), int(match[2])
    segments = tuple(sorted(int(segment) for segment in match[3].split("-")))
    if len(set(segments)) != k or len(segments) != k:
        raise ValueError(f"case {text}: expected {k} different segments, got {len(segments)}: {match[3]}")
    if k_from >= k:
        raise ValueError(f"case {text}: expected seeds with fewer than {k} outages, got {k_from}")
    return Case(k_from, segments)
