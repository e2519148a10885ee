"""Maps of what free correlation has measured: reference with its mesh, motion, residuals."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike
from scipy import ndimage

from driver.report.maps import Face
from driver.report.measured import MeasuredMotion
from driver.report.style import SIGNED, WIDTH, boundaries_label, new_figure, styled
from meshes.arrays import FloatArray, IntArray

FIELD = "viridis"  # perceptually uniform, and told apart by the colour-blind
COMPONENTS = ("u (along X)", "v (along Y)", "w (along Z)")
LIMIT = 4.0  # ρ/σ at the ends of the colour scale
_ROI, _MESH, _AXES, _BOUNDARY = "#f0e442", "#56b4e9", "#56b4e9", "#d55e00"
_RIM = [withStroke(linewidth=3.0, foreground="black")]
_RIM_PIXELS = 5  # shown beside the region: beyond may lie trenches, filled from their rim
_SHADE = 0.35  # share of light that the deepest pixel takes from the colours of a field
_QUADS = 40_000  # of a field at most: motion is smooth, so large images are drawn coarser


@styled
def reference(measured: MeasuredMotion) -> Figure:
    """Return reference image with region of interest, meshes of correlation and grain boundary."""
    face, heights = measured.face, measured.reference
    low, high = _limits(measured)
    figure = new_figure(_height(face, heights.shape, WIDTH - 1.3) + 0.85)
    axes = figure.subplots()
    extent = face.extent((0.0, 0.0), heights.shape)
    picture = axes.imshow(_nm(measured), cmap="gray", vmin=low, vmax=high, extent=extent)
    figure.colorbar(picture, ax=axes, fraction=0.03, pad=0.01, label="height [nm]")
    for name, nodes, cells, width, alpha in (
        ("w", measured.nodes_w, measured.cells_w, 0.6, 0.55),
        ("u, v", measured.nodes_uv, measured.cells_uv, 1.3, 1.0),
    ):
        axes.add_collection(_outlines(nodes, cells, width, alpha), autolim=False)
        axes.plot([], [], color=_MESH, lw=1.5 * width, alpha=alpha,
                  label=f"mesh of {name}: {len(cells)} elements")  # fmt: skip
    inside = np.zeros(heights.shape)
    inside[face.rows, face.cols] = 1.0
    x = (np.arange(heights.shape[0]) - face.origin[0]) * face.pixel
    y = (np.arange(heights.shape[1]) - face.origin[1]) * face.pixel
    axes.contour(y, x, inside, levels=[0.5], colors=_ROI, linewidths=1.8)
    axes.plot([], [], color=_ROI, label="region of interest")
    for number, trace in enumerate(face.traces):
        axes.plot(trace[:, 1], trace[:, 0], color=_BOUNDARY, lw=2.2, path_effects=_RIM,
                  label="" if number else boundaries_label(len(face.traces)))  # fmt: skip
    _frame(axes, face, heights.shape)
    _scale_bar(axes)
    axes.set(xlabel="Y [µm] (loading axis)", ylabel="X [µm]")
    figure.legend(loc="outside upper center", ncols=4)
    return figure


@styled
def fields(measured: MeasuredMotion) -> Figure:
    """u, v, w of the shown images over the reference, on the mesh moved with them, enlarged.

    The mean over the face is removed from each; a component has one colour scale.
    """
    face, shown, factor = measured.face, measured.shown, measured.exaggeration
    shape = measured.reference.shape
    width = (WIDTH - 0.7) / 3
    figure = new_figure((_height(face, shape, width) + 0.34) * len(shown) + 1.0)
    axes = figure.subplots(len(shown), 3, squeeze=False, sharex=True, sharey=True)
    low, high = _limits(measured)
    extent = face.extent((0.0, 0.0), shape)
    values = 1e3 * measured.motion
    step = int(np.ceil(np.sqrt(face.rows.size / _QUADS)))
    light = relief(face.grid(_nm(measured)[face.rows, face.cols]), low, high)[::step, ::step]
    scales = [ScalarMappable(Normalize(*field_limits(values[..., k])), FIELD) for k in range(3)]
    for row, image in enumerate(shown):
        corners = moved_corners(face, factor * measured.motion[row, :, :2])
        corners = corners[np.ix_(*(_ends(n - 1, step) for n in corners.shape[:2]))]
        moved = measured.nodes_uv + factor * measured.nodal_uv[row]
        for k, component in enumerate(COMPONENTS):
            axis = axes[row, k]
            axis.imshow(_nm(measured), cmap="gray", vmin=low, vmax=high, extent=extent, alpha=0.55)
            seen = face.grid(values[row, :, k])[::step, ::step]
            colours = np.asarray(scales[k].to_rgba(seen), dtype=np.float64)
            colours[..., :3] *= light
            axis.pcolormesh(corners[..., 1], corners[..., 0], colours)
            axis.add_collection(_outlines(moved, measured.cells_uv, 0.7, 0.9, "black"), False)
            axis.add_collection(_border(measured.nodes_uv, measured.cells_uv), autolim=False)
            _frame(axis, face, shape)
            if k == 0:
                axis.set_ylabel("X [µm]")
            if row == len(shown) - 1:
                axis.set_xlabel("Y [µm]")
                figure.colorbar(scales[k], ax=axes[:, k], location="bottom", shrink=0.9, aspect=28,
                                extend="both", label=f"{component}, mean removed [nm]")  # fmt: skip
        axes[row, 0].set_title(
            f"image {image}: end of loading {measured.cycle[image]}, "
            f"stage {measured.stage[image]:.4g} µm",
            fontsize=9,
        )
    enlarged = "true to scale" if factor == 1 else f"{factor:g} times enlarged"
    axes[0, 0].plot([], [], color="black", lw=1.2, label=f"mesh of u and v, its motion {enlarged}")
    axes[0, 0].plot([], [], color=_ROI, lw=1.6, ls="--", label="outline of the mesh at rest")
    figure.legend(loc="outside upper right", ncols=2)
    return figure


@styled
def residuals(measured: MeasuredMotion) -> Figure:
    """ρ of the shown images in nanometres (and grey levels), and in units of its noise."""
    face, shown = measured.face, measured.shown
    shape = (np.ptp(face.rows) + 1, np.ptp(face.cols) + 1)
    height = (WIDTH - 2.4) / 2 * shape[0] / shape[1] + 0.36
    figure = new_figure(height * len(shown) + 0.5)
    axes = figure.subplots(len(shown), 2, squeeze=False, sharex=True, sharey=True)
    limit = 1e3 * LIMIT * measured.sigma
    for row, image in enumerate(shown):
        metric, standard = 1e3 * measured.residual[row], measured.standardised[row]
        nm = face.show(axes[row, 0], metric, SIGNED, -limit, limit)
        over = face.show(axes[row, 1], standard, SIGNED, -LIMIT, LIMIT)
        axes[row, 0].set_title(f"image {image}: rms {_rms(metric):.2f} nm", fontsize=9)
        axes[row, 1].set_title(f"image {image}: χ = {_rms(standard):.3f}", fontsize=9)
        axes[row, 0].set_ylabel("X [µm]")
    for axis in axes[-1]:
        axis.set_xlabel("Y [µm]")
    bar = figure.colorbar(nm, ax=axes[:, 0], shrink=0.75, aspect=30, extend="both")
    bar.set_label("ρ [nm]", labelpad=1.0)

    def to_levels(nm: ArrayLike) -> ArrayLike:
        return np.asarray(nm, dtype=np.float64) / (1e3 * measured.level)

    def to_nm(levels: ArrayLike) -> ArrayLike:
        return np.asarray(levels, dtype=np.float64) * (1e3 * measured.level)

    other = bar.ax.secondary_yaxis("left", functions=(to_levels, to_nm))
    other.set_ylabel("ρ [grey levels]", labelpad=1.0)
    figure.colorbar(over, ax=axes[:, 1], shrink=0.75, aspect=30, extend="both", label="ρ/σ [1]")
    return figure


def moved_corners(face: Face, motion: FloatArray) -> FloatArray:
    """Corners of the pixels of the region's bounding box, moved with its pixels.

    Args:
        face: the region of interest.
        motion: u, v of its pixels [µm], shape (n_pix, 2).

    Returns:
        X, Y [µm], shape (rows + 1, columns + 1, 2): a corner moves by the mean of the pixels
        around it, off the region by that of the nearest one.
    """
    moved = np.stack([face.grid(part) for part in motion.T], axis=-1)
    nearest = ndimage.distance_transform_edt(
        np.isnan(moved[..., 0]), return_distances=False, return_indices=True
    )
    padded = np.pad(moved[tuple(nearest)], ((1, 1), (1, 1), (0, 0)), mode="edge")
    mean = (padded[:-1, :-1] + padded[1:, :-1] + padded[:-1, 1:] + padded[1:, 1:]) / 4
    first = np.array([face.rows.min(), face.cols.min()])
    places = np.moveaxis(np.indices(mean.shape[:2]), 0, -1) + first - 0.5
    return np.asarray((places - np.array(face.origin)) * face.pixel + mean)


def _ends(n: int, step: int) -> IntArray:
    """Return the corners of a line of n pixels between which every so many are drawn as one."""
    return np.append(np.arange(0, n, step), n)


def relief(heights: FloatArray, low: float, high: float) -> FloatArray:
    """Light on the colours of a field, so that the image is seen through them.

    Args:
        heights: of the pixels [nm], NaN off the region, shape (rows, columns).
        low: height where the light is weakest [nm].
        high: height where it is full.

    Returns:
        Factors on red, green and blue, shape (rows, columns, 1).
    """
    depth = np.clip((high - np.nan_to_num(heights)) / max(high - low, 1e-12), 0.0, 1.0)
    return np.asarray(1.0 - _SHADE * depth)[..., None]


def field_limits(values: FloatArray) -> tuple[float, float]:
    """Return ends of a colour scale: all but the lowest and the highest hundredth of the values."""
    low, high = np.percentile(values, (1.0, 99.0))
    return (float(low), float(high)) if high > low else (float(low) - 1.0, float(low) + 1.0)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def _nm(measured: MeasuredMotion) -> FloatArray:
    """Return the reference in nanometres above the median of the region."""
    face, heights = measured.face, measured.reference
    return np.asarray(1e3 * (heights - np.median(heights[face.rows, face.cols])))


def _limits(measured: MeasuredMotion) -> tuple[float, float]:
    inside = _nm(measured)[measured.face.rows, measured.face.cols]
    low, high = np.percentile(inside, (0.5, 99.8))
    return float(low), float(high)


def _window(face: Face, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """First and last row, first and last column of what is shown of the reference."""
    return (
        max(int(face.rows.min()) - _RIM_PIXELS, 0),
        min(int(face.rows.max()) + _RIM_PIXELS, shape[0] - 1),
        max(int(face.cols.min()) - 3 * _RIM_PIXELS, 0),
        min(int(face.cols.max()) + 3 * _RIM_PIXELS, shape[1] - 1),
    )


def _height(face: Face, shape: tuple[int, ...], width: float) -> float:
    top, bottom, left, right = _window(face, shape)
    return width * (bottom - top + 1) / (right - left + 1)


def _frame(axes: Axes, face: Face, shape: tuple[int, ...]) -> None:
    """Limits of the axes, Y to the right and X down as the rows."""
    top, bottom, left, right = _window(face, shape)
    axes.set_xlim(*(face.pixel * (end - face.origin[1]) for end in (left - 0.5, right + 0.5)))
    axes.set_ylim(*(face.pixel * (end - face.origin[0]) for end in (bottom + 0.5, top - 0.5)))
    axes.set_aspect("equal")


def _scale_bar(axes: Axes) -> None:
    """Draw a bar of about a sixth of the width, a round number of micrometres long."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    power = 10.0 ** np.floor(np.log10((right - left) / 6))
    length = power * max(s for s in (1, 2, 5) if s * power <= (right - left) / 6)
    thick = 0.02 * abs(bottom - top)
    x0, x = right - 0.02 * (right - left) - length, bottom - 2.6 * thick
    axes.add_patch(Rectangle((x0, x), length, thick, fc="white", ec="black", lw=0.8, zorder=5))
    axes.text(x0, x + thick / 2, f"{length:g} µm  ", color="white", ha="right", va="center",
              weight="bold", path_effects=_RIM, zorder=5)  # fmt: skip


def _outlines(
    nodes: FloatArray, cells: IntArray, width: float, alpha: float, colour: str = _MESH
) -> PolyCollection:
    """Elements of a mesh (X, Y) as lines, Y to the right."""
    return PolyCollection(list(nodes[cells][..., ::-1]), facecolors="none", edgecolors=colour,
                          linewidths=width, alpha=alpha)  # fmt: skip


def _border(nodes: FloatArray, cells: IntArray) -> LineCollection:
    """Return the sides (X, Y) that belong to one element alone, Y to the right."""
    sides = np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1).reshape(-1, 2)
    ends, count = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    lines = nodes[ends[count == 1]][..., ::-1]
    return LineCollection(list(lines), colors=_ROI, linewidths=1.0, linestyles="--")
