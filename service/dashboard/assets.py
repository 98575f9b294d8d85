"""Pages and static files: templates by name, and files named by content and compressed once.

The folder `static` is served under /static/<digest>/, so that modules import each other by relative path;
plotly.js comes from the installed `plotly` package as /static/plotly-<digest>.min.js.  The name of a page is
that of its template below `templates/views` and of its module below `static/views`.
"""

import gzip
import hashlib
import posixpath
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, select_autoescape

from service.dashboard import assets

_IMPORT = re.compile(r'^import\b[^;]*?from "(\.[^"]+)"', re.MULTILINE)
MEDIA_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}


@dataclass(frozen=True, slots=True)
class Asset:
    """A file in both encodings."""

    media_type: str
    plain: bytes
    zipped: bytes


def static_digest() -> str:
    """Return the name of the folder: a hash of all of its files."""
    return _own_files()[0]


def plotly_name() -> str:
    """Return the file name under which plotly.js is served."""
    return f"plotly-{_digest(_plotly_source().read_bytes())}.min.js"


def find(path: str) -> Asset | None:
    """Return the asset at a path below /static/, or None."""
    folder, _, name = path.partition("/")
    if not name:
        return plotly() if folder == plotly_name() else None
    digest, own = _own_files()
    return own.get(name) if folder == digest else None


@cache
def modules_of(name: str) -> tuple[str, ...]:
    """Return the modules that a module imports, those that they import, and so on.

    A browser that is told of all of them at once need not find them one behind the other.
    """
    own, found, pending = _own_files()[1], set[str](), [name]
    while pending:
        here = pending.pop()
        for path in _IMPORT.findall(own[here].plain.decode()):
            module = posixpath.normpath(posixpath.join(posixpath.dirname(here), path))
            if module not in found:
                found.add(module)
                pending.append(module)
    return tuple(sorted(found))


@cache
def plotly() -> Asset:
    """Return plotly.js; compressing it takes a fifth of a second, so callers warm this up."""
    return _asset("plotly.js", _plotly_source().read_bytes())


def _plotly_source() -> Traversable:
    return files("plotly") / "package_data" / "plotly.min.js"


@cache
def _own_files() -> tuple[str, dict[str, Asset]]:
    contents = dict(_contents(files("service.dashboard") / "static", ""))
    parts = (name.encode() + b"\0" + content for name, content in sorted(contents.items()))
    digest = _digest(b"\0".join(parts))
    return digest, {name: _asset(name, content) for name, content in contents.items()}


def _contents(folder: Traversable, prefix: str) -> Iterator[tuple[str, bytes]]:
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _contents(entry, f"{prefix}{entry.name}/")
        else:
            yield prefix + entry.name, entry.read_bytes()


def _asset(name: str, content: bytes) -> Asset:
    suffix = name[name.rindex(".") :]
    # Without a time stamp the same content gives the same bytes.
    return Asset(MEDIA_TYPES[suffix], content, gzip.compress(content, compresslevel=6, mtime=0))


def _digest(content: bytes) -> str:
    return hashlib.blake2b(content, digest_size=8).hexdigest()


_templates = Environment(
    loader=PackageLoader("service.dashboard"),
    autoescape=select_autoescape(),
    trim_blocks=True,
    lstrip_blocks=True,
)


def page(template: str, **values: object) -> str:
    """Return a page; the names of its static files change with their content."""
    return _templates.get_template(template).render(
        static=f"/static/{assets.static_digest()}", plotly=f"/static/{assets.plotly_name()}", **values
    )


class View(NamedTuple):
    """A page with an address of its own."""

    path: str
    name: str
    title: str
    #: The place in the navigation that it belongs to.
    section: str
    #: Whether it draws with plotly.js, which it then asks for at once.
    has_plots: bool = True


VIEWS = (
    View("/", "campaigns", "Campaigns", "campaigns", has_plots=False),
    View("/campaigns/new", "submit", "New campaign", "campaigns", has_plots=False),
    View("/campaigns/{campaign_id}", "campaign", "Campaign", "campaigns"),
    View("/campaigns/{campaign_id}/searches/{search}", "search", "Search", "campaigns"),
    View("/archive", "archive", "Archive", "archive"),
    View("/compare", "compare", "Comparison", "archive"),
    View("/solutions/{solution_id}", "solution", "Solution", "archive"),
    View("/problems/{problem_hash}", "problem", "Problem", "archive"),
    View("/workers", "workers", "Workers and jobs", "workers", has_plots=False),
)
#: What the navigation shows, in order.
SECTIONS = (
    ("campaigns", "/", "Campaigns"),
    ("archive", "/archive", "Archive"),
    ("workers", "/workers", "Workers"),
)
