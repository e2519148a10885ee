"""One look for all figures: colours that the colour-blind can tell apart, type, PNG."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable
from functools import wraps
from io import BytesIO
from typing import Any, ParamSpec

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from driver.common.formatting import printable

_P = ParamSpec("_P")

# Okabe and Ito's palette.
MEASURED, BEFORE, AFTER = "#000000", "#d55e00", "#0072b2"
CYCLES = ("#56b4e9", "#009e73", "#cc79a7", "#e69f00", "#7f7f7f")
CATEGORIES = {
    "material": "#0072b2",
    "microstructure": "#009e73",
    "boundary": "#e69f00",
    "instrument": "#cc79a7",
    "numerics": "#7f7f7f",
}
SIGNED = "RdBu_r"  # around zero
GREY = "#6b6b6b"

TONES = {
    "nothing wrong": "settled",
    "named": "settled",
    "one of this set": "between",
    "named, but something is left": "open",
    "unexplained": "open",
    "imaging-limited": "between",
    "numerics": "between",
}
"""How a verdict is coloured: settled, to be settled, or open."""

INDEXED = re.compile("([χγU]|λ[⁺⁻])_([FYZf])")  # symbols with an index, as they stand in texts

WIDTH = 9.6  # in; shown at about 100 pixels per inch, so that 10 pt reads as on the page
DPI = 150
_COLOURS = 256  # of a PNG file

_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.labelsize": 10.0,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "legend.fontsize": 9.0,
    "legend.frameon": False,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.7,
    "figure.facecolor": "white",
}


def styled(draw: Callable[_P, Figure]) -> Callable[_P, Figure]:
    """Give what a function draws the common look."""

    @wraps(draw)
    def drawn(*args: _P.args, **kwargs: _P.kwargs) -> Figure:
        with rc_context(_STYLE):
            return draw(*args, **kwargs)

    return drawn


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """Return an empty figure [in] that needs no display."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def literal(text: str) -> str:
    """Return a text of the user's as a figure shows it, letter by letter: none is a formula."""
    return printable(text).replace("$", r"\$")


def boundaries_label(count: int) -> str:
    """Return what the lines of so many grain boundaries are called in a key."""
    return "grain boundary" if count == 1 else "grain boundaries"


def typeset(text: str) -> str:
    """Return a text of a figure with χ_F, γ_F, λ⁺_Y, U_Y and the like as indexed symbols."""
    return INDEXED.sub(r"$\\mathregular{\1_\2}$", text)


def grid(axes: Axes) -> None:
    """Light lines in both directions."""
    axes.grid(True)


def png(figure: Figure) -> bytes:
    """Return the figure as a PNG file of 256 colours: a third of the size that all would take."""
    drawn, buffer = BytesIO(saved(figure, "png")), BytesIO()
    with Image.open(drawn) as image:
        few = image.convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
    few.save(buffer, "png", optimize=True)
    return buffer.getvalue()


def saved(figure: Figure, kind: str) -> bytes:
    """Return the figure as a file: "png", "pdf" or "svg"."""
    buffer = BytesIO()
    with rc_context(_STYLE):
        figure.savefig(buffer, format=kind, dpi=DPI)
    return buffer.getvalue()


def data_uri(image: bytes) -> str:
    """Return a PNG file as an address that holds the picture itself."""
    return "data:image/png;base64," + base64.b64encode(image).decode("ascii")
