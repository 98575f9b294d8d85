"""How easily things are found in what is installed: sizes of files, importers, forms of one noun, circles.

A *noun* is a table of the database.  A class (a row, a pydantic model, a dataclass, a named tuple, a typed
dictionary) is a *form* of it if it lists four or more of its columns itself, so that whoever adds one has to
look there.  So a class that copies part of a row counts whatever its name; one that inherits the columns, or
holds the row in a field, does not.  Each class counts once: for the noun that its name ends or begins with,
else for the one with most of its columns, those in at most two tables first, since others say little.
The generated types of the page are no forms.
"""

import ast
import json
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median, quantiles
from typing import Any

import grimp

#: What the wheel holds.
ROOTS = ("core", "workers", "service")
#: Packages whose number of files is a goal.
WATCHED = ("service/store", "core/nlp", "core/search", "workers")
SMALL, LARGE = 80, 600
#: A column that more tables have says little about which noun a class shows.
MOST_TABLES_OF_A_COLUMN = 2
LEAST_COLUMNS = 4

Graph = Mapping[str, set[str]]


@dataclass
class Class:
    """A class as it is written: where, and its own fields."""

    place: str
    name: str
    fields: set[str]
    table: str | None


@dataclass
class Tree:
    """The files of the packages and what is in them."""

    n_lines: dict[str, int] = field(default_factory=dict)
    function_lines: list[int] = field(default_factory=list)
    classes: list[Class] = field(default_factory=list)


def read_tree(folder: Path, roots: Iterable[str] = ROOTS) -> Tree:
    """Return what is in the Python files of the packages below a folder."""
    tree = Tree()
    for path in sorted(file for root in roots for file in (folder / root).rglob("*.py")):
        text, place = path.read_text(encoding="utf-8"), path.relative_to(folder).as_posix()
        tree.n_lines[place] = len(text.splitlines())
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                tree.function_lines.append((node.end_lineno or node.lineno) - node.lineno + 1)
            elif isinstance(node, ast.ClassDef):
                tree.classes.append(_class(node, place))
    return tree


def _class(node: ast.ClassDef, place: str) -> Class:
    declared = {
        s.target.id for s in node.body if isinstance(s, ast.AnnAssign) and isinstance(s.target, ast.Name)
    }
    names = (
        s.value.value
        for s in node.body
        if isinstance(s, ast.Assign)
        and isinstance(s.value, ast.Constant)
        and any(isinstance(t, ast.Name) and t.id == "__tablename__" for t in s.targets)
    )
    table = next(names, None)
    return Class(place, node.name, declared, str(table) if table else None)


def forms(classes: list[Class]) -> dict[str, list[str]]:
    """Return for each table the classes that are a form of its noun."""
    columns = {c.table: c.fields for c in classes if c.table}
    n_tables = Counter(column for of_table in columns.values() for column in of_table)
    telling = {column for column, n in n_tables.items() if n <= MOST_TABLES_OF_A_COLUMN}
    found: dict[str, list[str]] = {table: [] for table in columns}
    for each in classes:
        listed = {noun: each.fields & of_table for noun, of_table in columns.items()}
        nouns = [noun for noun in listed if len(listed[noun]) >= LEAST_COLUMNS]
        noun = each.table or _named_after(each.name, nouns)
        noun = noun or max(nouns, key=lambda n: (len(listed[n] & telling), len(listed[n])), default=None)
        if noun:
            found[noun].append(f"{each.place}:{each.name}")
    return found


def _named_after(name: str, nouns: Iterable[str]) -> str | None:
    words = [word.lower() for word in re.findall(r"[A-Z][a-z0-9]*", name)]
    return next((word for word in (words[-1:] + words[:1]) if word in nouns), None)


def import_graph(roots: Iterable[str] = ROOTS) -> Graph:
    """Return for each module of the packages those that it imports when it runs, not for types alone."""
    first, *others = roots
    graph = grimp.build_graph(first, *others, cache_dir=None, exclude_type_checking_imports=True)
    return {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}


def packages(graph: Graph) -> Graph:
    """Return the graph of what lies directly in the roots: `service.store`, `workers.client`."""
    merged: dict[str, set[str]] = defaultdict(set)
    for module, imported in graph.items():
        merged[_second_level(module)] |= {_second_level(other) for other in imported} - {
            _second_level(module)
        }
    return merged


def _second_level(module: str) -> str:
    return ".".join(module.split(".")[:2])


def circles(graph: Graph) -> list[list[str]]:
    """Return the sets of two or more nodes of which each reaches all others."""
    reached = {node: _reached(node, graph) for node in graph}
    together = {frozenset(n for n in reached[node] if node in reached[n]) for node in graph}
    return sorted(sorted(nodes) for nodes in together if len(nodes) > 1)


def _reached(start: str, graph: Graph) -> set[str]:
    reached, ahead = set[str](), [start]
    while ahead:
        new = graph.get(ahead.pop(), set()) - reached
        reached |= new
        ahead.extend(new)
    return reached


def n_with_one_importer(graph: Graph) -> int:
    """Return how many modules exactly one other imports."""
    importers = Counter(module for imported in graph.values() for module in imported)
    return sum(n == 1 for n in importers.values())


def measure(
    folder: Path, roots: tuple[str, ...] = ROOTS, watched: tuple[str, ...] = WATCHED
) -> dict[str, Any]:
    """Return all figures of the packages below a folder, from which they have to be importable."""
    tree, graph = read_tree(folder, roots), import_graph(roots)
    lines = list(tree.n_lines.values())
    of_nouns = {noun: classes for noun, classes in forms(tree.classes).items() if classes}
    return {
        "files": {"all": len(lines)} | {root: _files_in(tree, root) for root in roots},
        "files_of_packages": {package: _files_in(tree, package) for package in watched},
        "lines": {
            "all": sum(lines),
            "median": median(lines),
            "p90": quantiles(lines, n=10, method="inclusive")[-1],
            "share_below_80": round(sum(n < SMALL for n in lines) / len(lines), 3),
            "above_600": [place for place, n in tree.n_lines.items() if n > LARGE],
        },
        "modules_with_one_importer": n_with_one_importer(graph),
        "function_lines": {"median": median(tree.function_lines), "max": max(tree.function_lines)},
        "circles": {"packages": circles(packages(graph)), "modules": circles(graph)},
        "forms": {noun: {"n": len(classes), "classes": classes} for noun, classes in of_nouns.items()},
    }


def _files_in(tree: Tree, package: str) -> int:
    return sum(place.startswith(f"{package}/") for place in tree.n_lines)


def as_table(shape: Mapping[str, Any]) -> str:
    """Return the figures as lines for a reader, without the names of classes."""
    lines, found = shape["lines"], shape["circles"]
    rows = [
        ("files", _pairs(shape["files"])),
        ("files of packages", _pairs(shape["files_of_packages"])),
        ("lines of a file", f"median {lines['median']}, p90 {lines['p90']}, all {lines['all']}"),
        ("below 80, above 600", f"{lines['share_below_80']:.1%}, {len(lines['above_600'])} files"),
        ("with one importer", f"{shape['modules_with_one_importer']} modules"),
        ("lines of a function", _pairs(shape["function_lines"])),
        ("circles of packages", _sizes(found["packages"])),
        ("circles of modules", _sizes(found["modules"])),
        ("forms of a noun", _pairs({noun: each["n"] for noun, each in shape["forms"].items()})),
    ]
    return "".join(f"{name:<20} {text}\n" for name, text in rows)


def _pairs(numbers: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {number}" for name, number in numbers.items())


def _sizes(found: list[list[str]]) -> str:
    return "none" if not found else "; ".join(", ".join(nodes) for nodes in found)


def main() -> None:
    """Write the figures as JSON, and a table to a terminal that looks on."""
    shape = measure(Path(__file__).resolve().parent.parent)
    sys.stdout.write(json.dumps(shape, indent=1) + "\n")
    if sys.stderr.isatty():
        sys.stderr.write(as_table(shape))


if __name__ == "__main__":
    main()
