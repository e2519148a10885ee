"""Pictures of slip: activity of the systems over the images, loading axes in the triangle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.path import Path

from driver.report.maps import GRAINS
from driver.report.slip import SHOWN, GrainSlip, schmid_factors
from driver.report.style import CYCLES, GREY, WIDTH, grid, literal, new_figure, styled
from meshes.arrays import FloatArray, IntArray
from solver_adapters.crystal import system_name

_FINE = 121  # points along a side of the contours
_LEVELS = np.arange(0.30, 0.501, 0.02)


@styled
def activity(images: IntArray, grains: Sequence[GrainSlip]) -> Figure:
    """Accumulated slip of the systems over the images, a grain beside the other.

    Args:
        images: numbers of the images, shape (n,).
        grains: their slips, each known.
    """
    figure = new_figure(3.4)
    for axes, grain in zip(
        figure.subplots(1, len(grains), sharey=True, squeeze=False)[0], grains, strict=True
    ):
        assert grain.accumulated is not None
        percent, order = 100.0 * grain.accumulated, grain.order
        for system, colour in zip(order[:SHOWN], CYCLES, strict=False):
            axes.plot(
                images, percent[:, system], color=colour, label=system_name(grain.systems, system)
            )
        rest = percent[:, order[SHOWN:]].sum(axis=1)
        if len(order) > SHOWN:
            others = f"{len(order) - SHOWN} others"
            axes.plot(images, rest, color=GREY, linestyle="--", label=others)
        axes.set_title(literal(grain.name))
        axes.set_xlabel("image")
        axes.set_ylabel("accumulated slip [%]")
        axes.label_outer()
        axes.legend()
        grid(axes)
    return figure


@styled
def loading_axes(grains: Sequence[GrainSlip]) -> Figure:
    """Inverse pole figure: the loading axis of each grain, over the largest Schmid factor.

    Args:
        grains: the grains.
    """
    figure = new_figure(3.6, 0.6 * WIDTH)
    axes = figure.subplots()
    rim = _rim()
    side = np.linspace(0.0, float(rim.max()), _FINE)
    x, y = np.meshgrid(side, side)
    places = _on_sphere(x.ravel(), y.ravel())
    factors = [schmid_factors(axis, grains[0].systems).max() for axis in places]
    largest = np.reshape(factors, x.shape)
    contours = axes.contourf(x, y, largest, levels=_LEVELS, cmap="cividis")
    contours.set_clip_path(Path(rim), transform=axes.transData)
    figure.colorbar(contours, ax=axes, label="largest Schmid factor [1]")
    axes.plot(*rim.T, color="black", linewidth=1.2)
    for index, grain in enumerate(grains):
        place = stereographic(in_triangle(grain.axis))
        axes.plot(
            *place, "o", markersize=10, markerfacecolor=GRAINS[index % len(GRAINS)],
            markeredgecolor="black", label=literal(grain.name),
        )  # fmt: skip
    _corners(axes)
    axes.legend(loc="upper left")
    axes.set_aspect("equal")
    axes.set_axis_off()
    return figure


def in_triangle(axis: FloatArray) -> FloatArray:
    """Return the equivalent of an axis of a cubic crystal in the triangle 001, 011, 111.

    Its components without signs in ascending order are x ≤ y ≤ z; the triangle has y along the
    side from 001 to 011 and x across it.

    Args:
        axis: unit vector, shape (3,).
    """
    x, y, z = np.sort(np.abs(axis))
    return np.array([y, x, z])


def stereographic(direction: FloatArray) -> FloatArray:
    """Project unit vectors of the upper half from its lower pole (x, y)/(1 + z).

    The convention of Kocks, Tomé and Wenk, Texture and Anisotropy (1998), section 2.2.

    Args:
        direction: shape (..., 3).

    Returns:
        shape (..., 2).
    """
    return np.asarray(direction[..., :2] / (1.0 + direction[..., 2:]))


def _on_sphere(x: FloatArray, y: FloatArray) -> FloatArray:
    """Undo `stereographic`, shape (n, 3)."""
    square = x**2 + y**2
    return np.column_stack([2 * x, 2 * y, 1 - square]) / (1 + square)[:, None]


def _rim() -> FloatArray:
    """Return the closed outline of the triangle 001, 011, 111, shape (n, 2)."""
    t = np.linspace(0.0, 1.0, _FINE)
    arc = np.column_stack([np.ones(_FINE), t, np.ones(_FINE)])
    arc /= np.linalg.norm(arc, axis=1, keepdims=True)
    origin = np.zeros((1, 2))
    return np.concatenate([origin, stereographic(arc), origin])


def _corners(axes: Axes) -> None:
    corners = {"001": (0, 0, 1), "011": (1, 0, 1), "111": (1, 1, 1)}
    for name, corner in corners.items():
        x, y = stereographic(np.array(corner) / np.linalg.norm(corner)).tolist()
        below = name != "111"
        axes.annotate(
            name, (x, y), xytext=(0, -4 if below else 4), textcoords="offset points", ha="center",
            va="top" if below else "bottom",
        )  # fmt: skip
