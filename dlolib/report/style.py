"""How the figures look: one size of type, one meaning for each colour, the same bytes at every run."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from dlolib.report.text import title

WIDTH_MM = 166.0
"""The width of the text on the PDF's page: figures are drawn at the size they are read at."""
MM = 1 / 25.4

# Okabe and Ito's palette, told apart by colour-blind readers too. A colour means one thing throughout;
# goal and path have the paper's own colours (Fig. 10: magenta circles, green line).
OBSERVED = "#1A1A1A"
ROD = "#0072B2"
GOAL = "#C4418F"
PATH = "#009E73"
ELASTIC = "#56B4E9"
PLASTIC = "#D55E00"
PAPER = "#7A7A7A"
FAINT = "#B9C0C7"
OBSTACLE = "#D9DCE0"
OBSTACLE_EDGE = "#8B929A"
SERIES = ("#0072B2", "#D55E00", "#009E73", "#B5478C", "#8C6D1F", "#3FA0D0")

WHITE = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.6}
"""What lies under a word on a curve."""

# Where an SVG's points lie, and numbers there with more digits than can be seen: a hundredth of a point.
PLACES = re.compile(r' (?:d|x|y)="[^"]*"')
LONG = re.compile(r"-?\d+\.\d{3,}")

STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 7.0,
    "axes.titlesize": 7.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 5.0,
    "axes.labelsize": 7.0,
    "axes.labelcolor": "#333333",
    "axes.edgecolor": "#9AA0A6",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.formatter.use_mathtext": True,
    "grid.color": "#ECEEF0",
    "grid.linewidth": 0.6,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 0.0,
    "ytick.minor.size": 0.0,
    "legend.fontsize": 6.5,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "lines.linewidth": 1.2,
    "lines.solid_capstyle": "round",
    "figure.facecolor": "white",
    "mathtext.fontset": "dejavusans",
    # The same bytes at every run: names of clip paths and glyphs hashed with a fixed salt, text as outlines.
    "svg.hashsalt": "dlolib",
    "svg.fonttype": "path",
    "path.simplify": True,
}


def canvas(height_mm: float, width_mm: float = WIDTH_MM) -> Canvas:
    """An empty figure of the given size; its panels arrange themselves."""
    return Canvas(figsize=(width_mm * MM, height_mm * MM), layout="constrained")


def save(figure: Canvas, folder: Path, name: str) -> PurePosixPath:
    """Write a figure as SVG without a date; return its path relative to the report."""
    folder.mkdir(parents=True, exist_ok=True)
    _settle(figure)
    blank = {"Date": None, "Creator": None, "Format": None, "Type": None}
    path = folder / f"{name}.svg"
    figure.savefig(path, format="svg", metadata=blank)
    path.write_text(thinned(path.read_text(encoding="utf-8")), encoding="utf-8")
    return PurePosixPath(folder.name) / f"{name}.svg"


def thinned(svg: str) -> str:
    """An SVG with its places to a hundredth of a point, where Matplotlib writes a millionth."""
    return PLACES.sub(lambda places: LONG.sub(lambda number: f"{float(number[0]):.2f}", places[0]), svg)


def _settle(figure: Canvas) -> None:
    """Arrange the panels and round their places: the solver's last bits differ from run to run."""
    engine = figure.get_layout_engine()
    for _ in range(2):  # the second pass knows what the first did to legends and ticks
        if engine is not None:
            engine.execute(figure)
    figure.set_layout_engine("none")
    for axes in figure.get_axes():
        places = axes.get_position(original=True).bounds
        left, bottom, width, height = (round(value, 5) for value in places)
        axes.set_position((left, bottom, width, height))


def label(name: str) -> str:
    """A folder's name in a figure, where a pair of `$` would make a formula of it."""
    return title(name).replace("$", r"\$")


def legend_above(axes: Axes, columns: int = 4) -> None:
    """One line of a legend over the panel, out of the data's way."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        borderpad=0.2,
        columnspacing=1.4,
    )


def thousandths(axes: Axes, which: str = "both") -> None:
    """Show an axis that is held in metres in millimetres."""
    from matplotlib.ticker import FuncFormatter

    form = FuncFormatter(lambda value, _: f"{1e3 * value:.4g}".replace("-", "\u2212"))
    if which in ("x", "both"):
        axes.xaxis.set_major_formatter(form)
    if which in ("y", "both"):
        axes.yaxis.set_major_formatter(form)
