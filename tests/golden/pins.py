"""Each pin as a function that works out what it is now; `python -m tests.golden.pins` stores all of them.

A pin is stored anew in the commit that changes it, and the commit says why.  Numbers that pass through exp,
log or a flight are rounded to nine digits: what they rest on is ten orders of magnitude finer, and the
functions of the C library differ between processors in the last place.
"""

import hashlib
import json
import re
import shutil
import tempfile
from enum import Enum
from pathlib import Path

import numpy as np
import typer
from sqlalchemy import create_engine, literal, select
from starlette.testclient import TestClient

from core.analysis.safe_modes import RECOVERIES, SAFE_MODES
from core.problem import load_problem, problem_from
from core.search import GUESS_LAWS, HOP_LAWS, HopAddress, draw_steps, hop, hop_rng, hop_times, sample_guess
from core.transcription import transcribe
from service.app import create_app
from service.auth.network import Access
from service.cli import app_of
from service.db.dialect import mixed
from service.db.upgrade import upgrade
from service.schemas.solution import Filter
from service.spec import load_spec, spec_from
from service.store.store import Store
from service.validation import solution_hash
from tests.acceptance import known
from tests.service.campaigns import finish, spec_fields, submitted

HERE = Path(__file__).parent
ARCHIVES = sorted((HERE.parent / "service" / "data").glob("archive-*.sqlite"))
EXAMPLES = HERE.parents[1] / "examples"
#: Prose, and what is generated.
SKIPPED = {"content", "application/json", "schema", "responses"}
SHORT = {"anyOf": "|", "parameters": "?"}
PROSE = {"description", "summary", "title", "example", "examples", "operationId", "tags"}


def openapi():
    """Return every field of every route with its type and bounds; names of schemas are not part of it."""
    document = create_app(None, access=Access()).openapi()
    schemas = document["components"]["schemas"]
    found = {}
    for path, verbs in document["paths"].items():
        for verb, route in verbs.items():
            found[f"{verb.upper()} {path}"] = sorted(_fields(route, schemas, "", ()))
    return found


def _fields(node, schemas, place, within):
    """Yield a line for each place: all that is said of it, then the places inside of it."""
    said = []
    for key, one in node.items() if isinstance(node, dict) else ():
        if key in PROSE:
            continue
        if key == "$ref":
            name = one.rpartition("/")[2]
            if name in within:
                said.append("one of those around it")
            else:
                yield from _fields(schemas[name], schemas, place, (*within, name))
        elif key == "properties":
            for field, schema in one.items():
                yield from _fields(schema, schemas, f"{place}.{field}", within)
        elif key in ("required", "enum") and isinstance(one, list):
            said.append(f"{key} {sorted(map(str, one))}")
        elif key == "default":
            said.append(f"default {json.dumps(one, sort_keys=True)}")
        elif isinstance(one, list):
            for number, part in enumerate(one):
                name = part.get("name", number) if isinstance(part, dict) else part
                yield from _fields(part, schemas, f"{place}{SHORT.get(key, key)}[{name}]", within)
        elif isinstance(one, dict):
            inside = "" if key in SKIPPED else f"/{SHORT.get(key, key)}"
            if key == "application/problem+json":
                yield f"{place}: a problem"
            else:
                yield from _fields(one, schemas, place + inside, within)
        else:
            said.append(f"{key} {json.dumps(one)}")
    if said:
        yield f"{place}: {', '.join(sorted(said))}"


def commands():
    """Return every command with its arguments and options, their types and what they are if left out."""
    return dict(_commands(typer.main.get_command(app_of()), ()))


def _commands(command, path):
    inside = getattr(command, "commands", {})
    for name, one in inside.items():
        yield from _commands(one, (*path, name))
    if command.params or not inside:
        name = " ".join(path) or "coastarc"
        yield f"{name} (hidden)" if command.hidden else name, [_option(one) for one in command.params]


def _option(one):
    """Return one line: names, type, what it is if left out, and what else its kind is."""
    is_of_machine = callable(one.default) or isinstance(one.default, Path) or one.name == "workers"
    default = "this machine's" if is_of_machine else one.default
    traits = [name for name in ("required", "multiple", "hidden") if getattr(one, name, False)]
    names = " ".join([one.param_type_name, *one.opts, *one.secondary_opts])
    return f"{names}: {_type(one)} = {default}; {one.envvar}; {' '.join([str(one.nargs), *traits])}"


def _type(one):
    annotation = one.type_descriptor.annotation
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return f"one of {', '.join(choice.value for choice in annotation)}"
    kind = getattr(annotation, "__name__", annotation)
    return kind if one.min is None and one.max is None else f"{kind} in [{one.min}, {one.max}]"


def archives():
    """Return what is read of an archive that each version left behind, once it is upgraded."""
    return {path.stem: _archive(path) for path in ARCHIVES}


def _archive(path):
    with tempfile.TemporaryDirectory() as folder:
        place = Path(shutil.copy(path, Path(folder) / "coastarc.db"))
        upgrade(place)
        with Store(Path(folder), read_only=True) as store:
            campaigns = [store.campaign(item.id) for item in store.campaigns()]
            return {
                "campaigns": [_plain(view) for view in campaigns],
                "jobs": _digest(_plain(store.jobs(None, None, None, 1000))),
                "solutions": {
                    one.id: _digest(_plain(store.record(one.id))) for one in store.all_records(Filter(), None)
                },
            }


def _plain(model):
    return _without_clock(model.model_dump(mode="json"))


def _without_clock(content):
    if isinstance(content, dict):
        # Seconds until now, and fields younger than version 0.1.
        gone = {"eta_seconds", "elapsed_seconds", "strict_ratio"}
        return {key: _without_clock(one) for key, one in content.items() if key not in gone}
    if isinstance(content, list):
        return [_without_clock(one) for one in content]
    return float(f"{content:.9g}") if isinstance(content, float) else content


def _digest(content):
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def hashes():
    """Return the identity of problems, specifications, solutions and jobs."""
    preset = load_problem("ppe-drm3")
    fields = preset.model_dump(mode="json")
    problems = {
        "ppe-drm3": preset,
        "with an outage": preset.with_outages([(24, 1.0)]),
        "with three outages": preset.with_outages([(8, 1.0), (24, 2.5), (40, 0.25)]),
        "of 100 segments": problem_from(fields | {"n_segments": 100}),
        "with another thrust": problem_from(
            fields | {"spacecraft": fields["spacecraft"] | {"max_thrust_n": 0.5}}
        ),
    }
    specs = {
        **{name: load_spec(EXAMPLES / name) for name in ("quick.toml", "paper.toml", "paper-small.toml")},
        "test": spec_from(spec_fields()),
        "known": spec_from(known.SPEC),
    }
    vector = np.linspace(-1.0, 1.0, 154)
    return {
        "problems": {name: problem.hash for name, problem in problems.items()},
        "families": {name: problem.family for name, problem in problems.items()},
        "specs": {name: spec.hash for name, spec in specs.items()},
        "solutions": {name: solution_hash(problem.hash, vector) for name, problem in problems.items()},
    }


def draws():
    """Return the first ten draws of every random stream."""
    addresses = {
        "hop": HopAddress(0, 1, 2, 3, 4),
        "map": HopAddress(1, 0, 0, int("7f" * 16, 16), 0),
    }
    transcription = transcribe(load_problem("ppe-drm3").with_outages([(24, 1.0)]))
    lower, upper = transcription.sampling_box
    middle = 0.5 * (lower + upper)
    return {
        "bits": {name: hop_rng(7, one).integers(2**63, size=10).tolist() for name, one in addresses.items()},
        "uniform": {name: hop_rng(7, one).random(10).tolist() for name, one in addresses.items()},
        "steps": {law: _rounded(draw_steps(law, 10, hop_rng(7, addresses["hop"]))) for law in HOP_LAWS},
        "hops": {
            law: _rounded(hop(middle, (lower, upper), law, 0.05, hop_rng(7, addresses["hop"])))
            for law in HOP_LAWS
        },
        "times": hop_times(
            middle[:10], (lower[:10], upper[:10]), np.arange(10), 0.5, hop_rng(7, addresses["hop"])
        ).tolist(),
        "outages": {
            name: _rounded(law.sample(hop_rng(7, addresses["hop"]), 10))
            for name, law in (("safe modes", SAFE_MODES), ("recoveries", RECOVERIES))
        },
        "guesses": {
            law: _rounded(sample_guess(transcription, hop_rng(7, addresses["hop"]), law))
            for law in GUESS_LAWS
        },
        "samples": [mixed_number(number) for number in range(10)],
    }


def mixed_number(number):
    """Return the number by which a row is chosen for a sample."""
    with create_engine("sqlite://").connect() as connection:
        return connection.scalar(select(mixed(literal(number))))


def _rounded(values):
    return [float(f"{value:.9g}") for value in values[:10]]


def metrics(text):
    """Return the series of /metrics: names, types and labels."""
    kinds = dict(re.findall(r"^# TYPE (\S+) (\S+)$", text, flags=re.MULTILINE))
    labels = {name: set() for name in kinds}
    for name, inside in re.findall(r"^([a-z_]+)(?:\{(.*)\})? ", text, flags=re.MULTILINE):
        base = name if name in labels else re.sub(r"_(bucket|sum|count)$", "", name)
        labels[base] |= set(re.findall(r'(\w+)="', inside or ""))
    return {name: [kinds[name], *sorted(labels[name])] for name in sorted(kinds)}


def scraped():
    """Return the series of an archive with a finished campaign."""
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder)) as store:
        submitted(store)
        finish(store)
        with TestClient(create_app(store), base_url="http://127.0.0.1:8741") as client:
            return metrics(client.get("/metrics").text)


PINS = {
    "openapi": openapi,
    "commands": commands,
    "archives": archives,
    "hashes": hashes,
    "draws": draws,
    "metrics": scraped,
}


def stored(name):
    """Return a pin as it is stored."""
    return json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))


def main():
    """Store every pin as it is now."""
    for name, pin in PINS.items():
        text = json.dumps(pin(), indent=1, sort_keys=True)
        (HERE / f"{name}.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
