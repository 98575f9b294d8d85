"""Checks a specification: errors with field and line, the plan, and its departure and target.

Departure and target are made before a campaign is stored: a worker would find out as well that one of them
cannot be, but only with one dead job after another.
"""

import json
import re
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from pydantic import ValidationError

from core.ephemeris import EpochError, KernelError
from core.ephemeris.daf import SpkError
from core.errors import fault_lines
from core.orbits import SpiralError, departure_state, target_kernel
from core.orbits.clearance import ClearanceError, check_clearance
from core.orbits.nrho import HaloError, ShootingError
from core.plain_data import TextError, read_json, read_toml
from core.problem import Problem, ProblemError, require_departure_mass, require_physical
from service.spec import Spec, SpecError, spec_from
from service.spec.search_spec import SearchSpec, Seeds
from service.spec.spec_text import line_of, syntax_fault

_OF_SEARCH = re.compile(r"search (.+?): (?:problem: )?(?:(\w+)(?:\.\w+)*: )?", re.DOTALL)
_SAME_ID = re.compile(r"expected different ids, got '(.+?)'")
_PLACE = re.compile(r"spec((?:\.[\w-]+)*): ")


#: Processor time for a spiral; one of 400 days from a low orbit takes 20 [s].
MOST_CPU_S = 30.0

#: Why a problem whose fields are all in order cannot be flown.
IMPOSSIBLE = (
    EpochError,
    KernelError,
    SpkError,
    SpiralError,
    HaloError,
    ShootingError,
    ClearanceError,
    ProblemError,
    OSError,
)


class Fault(NamedTuple):
    """An error in a specification."""

    #: Names, and places in lists from 0 on, as in search.1.strategy; empty where it is about the whole.
    path: str
    #: Counted from 1; None where there is no text, or it says nothing about it.
    line: int | None
    message: str


class Checked(NamedTuple):
    """What a text holds: its fields as far as it can be read, and a specification if it can be run."""

    faults: list[Fault]
    fields: dict[str, Any] | None
    spec: Spec | None


def check_text(text: str) -> Checked:
    """Read a specification from TOML, or from JSON if it begins like it."""
    # A file pasted from Windows brings its byte order mark.
    text = text.removeprefix("\ufeff")
    is_json = text.lstrip().startswith("{")
    try:
        fields = read_json(text) if is_json else read_toml(text)
    except json.JSONDecodeError as error:
        return Checked([Fault("", error.lineno, f"expected JSON, got a fault: {error.msg}")], None, None)
    except TextError as error:
        words, line = syntax_fault(error, text)
        return Checked([Fault("", line, words)], None, None)
    except ValueError as error:
        words, line = syntax_fault(error, text)
        form = "JSON" if is_json else "TOML"
        return Checked([Fault("", line, f"expected {form}, got a fault: {words}")], None, None)
    return check_fields(fields, "" if is_json else text)


def check_fields(fields: Any, text: str = "") -> Checked:
    """Check plain data; `text` is what it was read from, if it is known."""
    try:
        spec = spec_from(fields)
        require_flyable(spec.problem)
    except SpecError as error:
        known = fields if isinstance(fields, dict) else {}
        faults = [_fault(message, known, text) for message in _messages(error)]
        return Checked(faults, None, None)
    return Checked([], fields, spec)


def _messages(error: SpecError) -> Iterator[str]:
    cause = error.__cause__
    if isinstance(cause, ValidationError):
        yield from fault_lines("spec", cause.errors(include_url=False), Spec)
    else:
        yield from str(error).splitlines()


def _fault(message: str, fields: dict[str, Any], text: str) -> Fault:
    place = _PLACE.match(message)
    named = place[1].split(".") if place else []
    path: list[str | int] = [int(part) if part.isdecimal() else part for part in named if part]
    words = message[place.end() :] if place else message
    path += _place_in(words, fields, path)
    if path and words.startswith(f"{path[-1]}: "):
        words = words.removeprefix(f"{path[-1]}: ")
    return Fault(".".join(map(str, path)), line_of(text, path), words)


def _place_in(words: str, fields: dict[str, Any], path: Sequence[str | int]) -> list[str | int]:
    """Return the place that the words of a fault name, where it is between searches or fields of one."""
    if path:
        field = re.match(r"(\w+)(?:\.\w+)*: ", words) if path[0] == "search" else None
        return _field_of(field[1]) if field and field[1] not in path else []
    searches = fields.get("search")
    ids = [one.get("id") for one in searches if isinstance(one, dict)] if isinstance(searches, list) else []
    if (found := _OF_SEARCH.match(words)) and found[1] in ids:
        return ["search", ids.index(found[1]), *_field_of(found[2])]
    if (found := _SAME_ID.search(words)) and found[1] in ids:
        return ["search", len(ids) - 1 - ids[::-1].index(found[1]), "id"]
    return []


def _field_of(name: str | None) -> list[str | int]:
    return [name] if name in SearchSpec.model_fields else []


class Planned(NamedTuple):
    """What one search will do, at most."""

    id: str
    strategy: str
    n_cases: int
    #: None where a budget in core seconds or solutions is the only bound.
    n_guesses_most: int | None
    #: Time that all of its solves are allowed [h]; None where their number is open.
    core_hours_most: float | None
    seeds_from: str | None


def planned(spec: Spec) -> list[Planned]:
    """Return what each search will do, in the order of the specification."""
    most = {search.id: _guesses_most(search, {}) for _, search in spec.in_order if search.seed_k is None}
    for _, search in spec.in_order:
        if search.seed_k is not None:
            most[search.id] = _guesses_most(search, most)
    return [_plan(search, most[search.id]) for search in spec.search]


def _plan(search: SearchSpec, n_most: int | None) -> Planned:
    hours = None if n_most is None else n_most * search.cpu_seconds * (1 + search.k) / 3600.0
    if search.core_seconds is not None:
        hours = min(search.core_seconds / 3600.0, hours if hours is not None else float("inf"))
    source = search.seeds.full_name if search.seeds else None
    return Planned(search.id, search.strategy, len(search.outage_sets), n_most, hours, source)


def _guesses_most(search: SearchSpec, most: dict[str, int | None]) -> int | None:
    seeds = search.seeds
    if seeds is None:
        return search.guesses
    known = _most_seeds(seeds, most)
    bounds = [n for n in (known, seeds.limit) if n is not None]
    if not bounds:
        return search.guesses
    mapped = min(bounds) * len(search.mapping) * _cases_per_seed(search, seeds)
    return mapped if search.guesses is None else min(mapped, search.guesses)


def _most_seeds(seeds: Seeds, most: dict[str, int | None]) -> int | None:
    """Return how many seeds there are at most, as far as the specification tells."""
    if seeds.source is None:
        return 1
    return None if seeds.campaign is not None else most.get(seeds.source)


def _cases_per_seed(search: SearchSpec, seeds: Seeds) -> int:
    """Return how many cases a seed is mapped to at most."""
    if seeds.pairing == "round-robin":
        return 1
    if search.k != search.seed_k:
        return len(search.outage_sets)
    # Longer outages are in the same segments as the seed's.
    places = Counter(tuple(segment for segment, _ in case) for case in search.outage_sets)
    return max(places.values())


def require_flyable(problem: Problem, name: str = "spec.problem") -> None:
    """Compute the departure state and the target of a problem, or raise SpecError."""
    try:
        require_physical(problem, name)
    except ProblemError as error:
        raise SpecError(str(error)) from error
    try:
        start = departure_state(problem.departure, problem.spacecraft, _after(MOST_CPU_S))
        require_departure_mass(problem, start.mass_kg)
        target_kernel(problem)
        check_clearance(problem)
    except IMPOSSIBLE as error:
        raise SpecError(f"{name}: {' '.join(str(error).split())}") from error


def _after(cpu_seconds: float) -> Callable[[], bool]:
    """Return whether this thread has used its processor time."""
    end = time.thread_time() + cpu_seconds
    return lambda: time.thread_time() > end
