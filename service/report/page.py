"""The page: sections of tables and figures in one self-contained HTML file."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup
from matplotlib.figure import Figure

from service.report.style import for_page
from service.report.tables import Table

FOOT = (
    "Made by coastarc from the archive alone: no trajectory was propagated or solved again. Intervals of "
    "ratios are Wilson's, 95 %."
)


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A figure with its title and caption."""

    #: File name of the SVG and the PNG, without their endings.
    name: str
    title: str
    caption: str
    figure: Figure


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """The content under one heading."""

    name: str
    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True, slots=True)
class Fact:
    """One number at the top of the page."""

    name: str
    value: str


@dataclass(frozen=True, slots=True)
class Head:
    """The top of the page: title, facts and notices."""

    id: int
    name: str
    facts: tuple[Fact, ...]
    notices: tuple[str, ...]
    #: Where published values come from, for the foot of the page.
    source: str = ""


def page(head: Head, sections: Sequence[Section], svgs: dict[str, str]) -> str:
    """Return the page; `svgs` holds the SVG of each picture by its name."""
    shown = [
        {
            "name": section.name,
            "title": section.title,
            "paragraphs": section.paragraphs,
            "tables": section.tables,
            "figures": [
                {
                    "name": picture.name,
                    "title": picture.title,
                    "caption": picture.caption,
                    # matplotlib escapes the text inside.
                    "svg": Markup(for_page(svgs[picture.name], picture.name)),
                }
                for picture in section.pictures
            ],
        }
        for section in sections
    ]
    css = Markup((files("service.report") / "templates" / "report.css").read_text(encoding="utf-8"))
    text: str = _template().render(head=head, sections=shown, css=css, foot=f"{FOOT} {head.source}".rstrip())
    return text


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("service.report"),
        autoescape=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    return environment.get_template("report.html.j2")
