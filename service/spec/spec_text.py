"""The specification of a campaign as the text that a user would have written."""

from collections.abc import Mapping
from typing import Any

from core.problem import presets, problem_from
from service.spec.toml_text import toml_text


def spec_text(fields: Mapping[str, Any]) -> str:
    """Return a stored specification as TOML; a problem that is near a preset is written by what differs."""
    return toml_text({**fields, "problem": _short_problem(fields["problem"])})


def _short_problem(fields: dict[str, Any]) -> dict[str, Any]:
    written = [fields, *(_beside(name, fields) for name in presets())]
    wanted = problem_from(fields).hash
    same = [one for one in written if problem_from(one).hash == wanted]
    return min(same, key=lambda one: len(toml_text({"problem": one})))


def _beside(name: str, fields: dict[str, Any]) -> dict[str, Any]:
    base = problem_from({"preset": name}).model_dump(mode="json")
    return {"preset": name, **_changed(base, fields)}


def _changed(base: Mapping[str, Any], fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields that differ from those of a preset, which are laid over it when they are read."""
    changed = {}
    for name, value in fields.items():
        old = base.get(name)
        if value == old:
            continue
        is_inside = isinstance(value, dict) and isinstance(old, dict) and value.get("kind") == old.get("kind")
        changed[name] = _changed(old, value) if is_inside and old is not None else value
    return changed
