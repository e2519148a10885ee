"""Pictures of the kinematic Hessian and of the correlation matrix of the parameters."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from driver.common.formatting import compact
from driver.report.style import SIGNED, WIDTH, new_figure, styled, typeset
from meshes.arrays import FloatArray

_DECADES = 8  # of the logarithmic scale at most: what is smaller is beyond any use
_LARGEST_TYPE, _SMALLEST_TYPE = 9.5, 7.0  # pt, of numbers in cells
_WRITTEN = 0.7  # correlations beyond which the value is written among many
_PALE = "#e6e6e6"  # a cell that is zero


@styled
def hessian_and_correlation(
    hessian_names: Sequence[str],
    hessian: FloatArray,
    names: Sequence[str],
    correlation: FloatArray,
) -> Figure:
    """Return the kinematic Hessian and the correlation matrix of a few parameters, with numbers.

    Args:
        hessian_names: parameters of the Hessian, length m.
        hessian: shape (m, m).
        names: parameters of the correlation matrix, length k.
        correlation: shape (k, k).
    """
    figure = new_figure(WIDTH / 2 + 0.35)
    left, right = figure.subplots(1, 2)
    left.set_title("Kinematic Hessian")
    picture = _logarithmic(left, hessian)
    _numbers(left, picture, np.abs(hessian), [[compact(x) for x in row] for row in hessian])
    _cells(left, hessian_names)
    _bar(figure, left, picture, "magnitude of the entry [1], logarithmic")
    right.set_title("Correlation")
    picture = _signed(right, correlation)
    texts = [[f"{x:.2f}".replace("-", "−") for x in row] for row in correlation]
    _numbers(right, picture, correlation, texts)
    _cells(right, names)
    _bar(figure, right, picture, "correlation [1]")
    return figure


@styled
def correlation_of_all(names: Sequence[str], matrix: FloatArray) -> Figure:
    """Correlation matrix of every parameter; strong ones with their value.

    Args:
        names: the parameters, length k.
        matrix: shape (k, k).
    """
    k = len(names)
    side = min(WIDTH - 1.6, max(4.2, 0.34 * k + 1.0))
    figure = new_figure(side, side + 0.9)
    axes = figure.subplots()
    picture = _signed(axes, matrix)
    texts = [[_strong(x) if i != j else "" for j, x in enumerate(row)]
             for i, row in enumerate(matrix)]  # fmt: skip
    _numbers(axes, picture, matrix, texts)
    _cells(axes, names)
    figure.colorbar(picture, ax=axes, shrink=0.75, label="correlation [1]")
    return figure


def _strong(value: float) -> str:
    if abs(value) < _WRITTEN:
        return ""
    return f"{value:.2f}".replace("-", "−").replace("0.", ".")


def _numbers(
    axes: Axes, picture: AxesImage, values: FloatArray, texts: Sequence[Sequence[str]]
) -> None:
    size = min(_LARGEST_TYPE, max(_SMALLEST_TYPE, 60.0 / len(values)))
    for row, column in itertools.product(range(len(values)), repeat=2):
        axes.text(column, row, texts[row][column], ha="center", va="center", fontsize=size,
                  color=_ink(picture, float(values[row, column])))  # fmt: skip


def _logarithmic(axes: Axes, matrix: FloatArray) -> AxesImage:
    """Magnitudes on a logarithmic scale; nothing where the entry is zero."""
    magnitude = np.ma.masked_equal(np.abs(matrix), 0.0)
    largest = float(magnitude.max()) if magnitude.count() else 1.0
    smallest = float(magnitude.min()) if magnitude.count() else 0.1
    norm = LogNorm(max(min(smallest, 0.1 * largest), largest * 10.0**-_DECADES), largest)
    axes.set_facecolor(_PALE)
    return axes.imshow(magnitude, cmap="cividis", norm=norm)


def _signed(axes: Axes, matrix: FloatArray) -> AxesImage:
    return axes.imshow(matrix, cmap=SIGNED, vmin=-1.0, vmax=1.0)


def _ink(picture: AxesImage, value: float) -> str:
    """Black or white, whichever has more contrast with the colour of a cell."""
    if value == 0.0:
        return "black"
    colour = np.ravel(picture.to_rgba(np.array([value])))[:3]
    luminance = float((colour**2.2) @ np.array([0.2126, 0.7152, 0.0722]))
    return "black" if luminance > 0.18 else "white"


def _cells(axes: Axes, names: Sequence[str]) -> None:
    """Names of rows and columns, and white lines between the cells."""
    k = len(names)
    written = [typeset(name) for name in names]
    axes.set_xticks(range(k), written, rotation=90 if max(map(len, names)) > 5 else 0)
    axes.set_yticks(range(k), written)
    axes.tick_params(length=0, labelsize=9.0, pad=4)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.set_xticks(np.arange(k + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(k + 1) - 0.5, minor=True)
    axes.tick_params(which="minor", length=0)
    axes.grid(False)
    axes.grid(True, which="minor", color="white", lw=0.9)


def _bar(figure: Figure, axes: Axes, picture: AxesImage, unit: str) -> None:
    figure.colorbar(picture, ax=axes, location="bottom", shrink=0.85, aspect=30, label=unit)
