"""Errors that users can fix, and validation errors as text: `<field>: expected <what>, got <value>`.

A fault is a dict with `type`, `loc`, `msg`, `input` and `ctx`, as pydantic gives it.  A model is a class with
`model_fields`; which fields it knows and which part of a place is no field but a tag is read there.
"""

from collections.abc import Iterable, Mapping
from typing import Any, get_args


class UserError(Exception):
    """An error that the user can fix: its text is one line for them, shown without a traceback."""


#: What was expected, by type of fault; names in braces are those of its context.
EXPECTED = {
    "missing": "a value",
    "finite_number": "a finite number",
    "greater_than": "a number greater than {gt}",
    "greater_than_equal": "a number of at least {ge}",
    "less_than": "a number less than {lt}",
    "less_than_equal": "a number of at most {le}",
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "an integer",
    "int_parsing": "an integer",
    "int_from_float": "an integer",
    "string_type": "a text",
    "string_pattern_mismatch": "a text of the form {pattern}",
    "path_type": "a path",
    "literal_error": "{expected}",
    "union_tag_invalid": "a table of kind {expected_tags}",
    "union_tag_not_found": "a table with a kind",
    "too_long": "at most {max_length} items",
    "too_short": "at least {min_length} item",
    "tuple_type": "a list",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "dict_type": "a table",
}
#: Longest value or name that is shown in full.
SHOWN = 80
#: Most errors listed; of more the first ones suffice.
MOST_FAULTS = 50


def fault_lines(thing: str, faults: Iterable[Mapping[str, Any]], model: Any = None) -> list[str]:
    """Return one line per validation error of a model's data, without those implied by a deeper one."""
    listed = list(faults)
    places = [tuple(fault["loc"]) for fault in listed]
    # All prefixes of locations, once: a single request can have tens of thousands of errors.
    outer = {place[:end] for place in places for end in range(len(place))}
    lines: list[str] = []
    for fault, place in zip(listed, places, strict=True):
        if len(lines) >= MOST_FAULTS:
            lines.append(f"{thing}: expected fewer faults, got {len(listed)}; mend the first {MOST_FAULTS}")
            break
        if not (fault["type"] == "too_short" and place in outer):
            lines.extend(_lines(thing, fault, model))
    return lines


def _lines(thing: str, fault: Mapping[str, Any], model: Any) -> list[str]:
    path, known = _resolve(fault["loc"], model)
    place = ".".join([thing, *path])
    message = _message(fault, known)
    # A message about nested data may include locations in it.
    inner = message.splitlines()
    if path and all(line.startswith((f"{path[-1]}.", f"{path[-1]}:")) for line in inner):
        return [f"{place.removesuffix(path[-1])}{line}" for line in inner]
    return [f"{place}: {message}"]


def _resolve(loc: Iterable[Any], model: Any) -> tuple[list[str], list[str]]:
    """Return a location without the tags of unions, and the fields of the model of its last part."""
    path: list[str] = []
    models, known = [model], _fields(model)
    for part in loc:
        tagged = [one for one in models if len(models) > 1 and part in _tags(one)]
        if tagged:
            models = tagged
            continue
        path.append(printable(str(part)))
        if isinstance(part, int):
            continue
        known = _fields(models[0]) if models else {}
        field = known.get(part)
        models = _models(field.annotation) if field else []
    return path, [*known]


def _fields(model: Any) -> dict[str, Any]:
    fields = getattr(model, "model_fields", {})
    return {field.alias or name: field for name, field in fields.items()}


def _tags(model: Any) -> tuple[Any, ...]:
    kind = model.model_fields.get("kind")
    return get_args(kind.annotation) if kind else ()


def _models(annotation: Any) -> list[Any]:
    """Return the models inside an annotation."""
    if hasattr(annotation, "model_fields"):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]


def _message(fault: Mapping[str, Any], known: list[str]) -> str:
    kind, context = fault["type"], fault.get("ctx", {})
    if kind == "extra_forbidden":
        return f"expected one of {', '.join(known)}, got unknown key {_preview(fault['loc'][-1])}"
    if kind in EXPECTED:
        limits = {name: _plain(value) for name, value in context.items()}
        return f"expected {EXPECTED[kind].format(**limits)}, got {_got(fault, context)}"
    message = str(fault["msg"]).removeprefix("Value error, ").replace("Input should be ", "expected ")
    return message if "got " in message else f"{message}, got {_preview(fault['input'])}"


def _got(fault: Mapping[str, Any], context: Mapping[str, Any]) -> str:
    if fault["type"] in ("missing", "union_tag_not_found"):
        return "none"
    if "actual_length" in context:
        return str(context["actual_length"])
    return _preview(context["tag"]) if "tag" in context else _preview(fault["input"])


def _plain(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _preview(value: Any) -> str:
    if isinstance(value, Mapping) or hasattr(type(value), "model_fields"):
        return "a table"
    try:
        text = repr(value)
    except ValueError:
        return "an integer of thousands of digits"
    return printable(text)


def printable(text: str) -> str:
    """Return a text truncated, and escaped where UTF-8 cannot encode it."""
    shown = text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
    return shown.encode("utf-8", "backslashreplace").decode()
