"""Style of figures: one set of settings, colours for any colour vision, files without dates.

A figure is drawn once.  Its SVG and PNG are for print, dark on light; in the page the colours of the SVG are
CSS variables (`var(--blue)`), which the style sheet sets for a light and for a dark screen.
"""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

#: Name in the style sheet -> colour in print.
COLOURS = {
    "ink": "#14202f",
    "soft": "#5b6a7d",
    "grid": "#dce3ec",
    "band": "#eef2f7",
    "blue": "#0072c3",
    "green": "#008562",
    "amber": "#9a6700",
    "violet": "#6f42c1",
    "rose": "#b23a83",
    "orange": "#d9480f",
}
INK, SOFT, GRID, BAND = (COLOURS[name] for name in ("ink", "soft", "grid", "band"))
BLUE, GREEN, ORANGE = COLOURS["blue"], COLOURS["green"], COLOURS["orange"]
#: For series without a fixed colour, in this order; published values are always orange.
SERIES = tuple(COLOURS[name] for name in ("blue", "green", "amber", "violet", "rose"))
#: Between a group and its member; plain spaces would collapse in the page.
GAP = "\u00a0" * 3
#: Width of every figure [in]: 10 pt are then about as large as the text of the page.
WIDTH = 6.6
DOTS_PER_INCH = 160
#: The unit of SVG files.
POINTS_PER_INCH = 72

SETTINGS: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": SOFT,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.facecolor": "none",
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "text.color": INK,
    # Names come from users; a dollar sign must not start a formula.
    "text.parse_math": False,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.6,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "figure.dpi": DOTS_PER_INCH,
    "path.simplify": True,
    # Text stays text, small and searchable; ids are deterministic.
    "svg.fonttype": "none",
    "svg.hashsalt": "coastarc",
}


@contextmanager
def figure_style() -> Iterator[None]:
    """Apply the settings to figures drawn and saved inside, and restore matplotlib's own afterwards."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(SETTINGS)
        yield


def new_figure(height: float, n_columns: int = 1, **options: Any) -> tuple[Figure, list[Axes]]:
    """Return a figure of the page's width with a row of axes."""
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.subplots(1, n_columns, squeeze=False, **options)
    return figure, list(axes[0])


def lay_out(figure: Figure) -> None:
    """Run the layout once, rather than for each file."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")


def as_svg(figure: Figure) -> str:
    """Return a figure that is laid out as reproducible SVG text."""
    buffer = io.StringIO()
    figure.set_dpi(POINTS_PER_INCH)
    nothing = {"Date": None, "Creator": None, "Format": None, "Type": None}
    # Directly by the canvas: `Figure.savefig` would draw everything twice.
    canvas: Any = FigureCanvasSVG(figure)
    canvas.print_svg(buffer, metadata=nothing)
    return buffer.getvalue()


def as_png(figure: Figure) -> bytes:
    """Return a figure that is laid out as a reproducible PNG on white."""
    buffer = io.BytesIO()
    figure.set_dpi(DOTS_PER_INCH)
    figure.patch.set_facecolor("white")
    canvas: Any = FigureCanvasAgg(figure)
    canvas.print_png(buffer, metadata={"Software": None})
    figure.patch.set_facecolor("none")
    return buffer.getvalue()


def for_page(svg: str, name: str) -> str:
    """Return an SVG to embed in a page: colours as CSS variables, ids unique to the figure."""
    inner = svg[svg.index("<svg") :]
    # Its rules would apply to the whole page; the style sheet has its own for figures.
    inner = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", inner, count=1, flags=re.DOTALL)
    inner = re.sub(r'\b(id="|href="#|url\(#)(?=[^<>]*>)', rf"\g<1>{name}-", inner)
    # Only inside tags: users' text stays unchanged.
    return re.sub(r"<[^>]*>", lambda tag: _COLOUR.sub(_css_variable, tag[0]), inner)


_NAMES = {value: name for name, value in COLOURS.items()}
_COLOUR = re.compile(r"(?<=: )#[0-9a-f]{6}(?=[;\"])")


def _css_variable(colour: re.Match[str]) -> str:
    return f"var(--{_NAMES[colour[0]]})" if colour[0] in _NAMES else colour[0]
