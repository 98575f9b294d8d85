"""Generate the types of the API for the page's modules: `python -m tests.page_types`.

They come from the shapes in the application's OpenAPI document: no description or limit changes a type.
"""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

from service.app import create_app
from service.auth.network import Access

ROOT = Path(__file__).parents[1]
TYPES = ROOT / "service" / "dashboard" / "types.d.ts"
GENERATOR = ROOT / "node_modules" / "openapi-typescript" / "bin" / "cli.js"
#: Keys of a schema that its type depends on.
SHAPE = frozenset(
    "$ref additionalProperties allOf anyOf const default enum items maxItems minItems oneOf prefixItems "
    "properties required type".split()
)
#: TypeScript has a `Record` of its own, which the generator uses.
RENAMED = ("export type Record = ", "export type SolutionRecord = ")


def shape_of(schema):
    """Return a schema without what says nothing about its type."""
    if isinstance(schema, list):
        return [shape_of(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    kept = {key: shape_of(value) for key, value in schema.items() if key in SHAPE and key != "properties"}
    if "properties" in schema:
        kept["properties"] = {name: shape_of(value) for name, value in schema["properties"].items()}
    return kept


def document():
    """Return the shapes of all bodies and answers as an OpenAPI document."""
    schemas = create_app(None, access=Access()).openapi()["components"]["schemas"]
    shapes = {name: shape_of(schema) for name, schema in sorted(schemas.items())}
    info = {"title": "coastarc", "version": "1"}
    return json.dumps({"openapi": "3.1.0", "info": info, "paths": {}, "components": {"schemas": shapes}})


def first_line():
    """Return the first line of the types, by which a test knows whether they are current."""
    return (
        f"// Made by `make types`; shapes of the API {hashlib.sha256(document().encode()).hexdigest()[:16]}\n"
    )


def main():
    node = Path(sys.executable).with_name("node")
    command = [node, GENERATOR, "--root-types", "--root-types-no-schema-prefix", "--root-types-keep-casing"]
    made = subprocess.run(command, input=document(), capture_output=True, text=True, check=True).stdout
    TYPES.write_text(first_line() + made.replace(*RENAMED), encoding="utf-8")


if __name__ == "__main__":
    main()
