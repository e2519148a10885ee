"""Maps of the report on the specimen and on its measured face, from arrays to figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from driver.report.figures import side_labels
from driver.report.style import GREY, SIGNED, new_figure, styled
from meshes.arrays import FloatArray, IntArray
from meshes.cells import EDGES, outer_faces

GRAINS = ("#a8cfe6", "#f3c98b", "#b7d9a8", "#d8b4d8", "#e8aaa0", "#cfc79f")
_BOUNDARY = "#d55e00"
_ELEVATION, _AZIMUTH = 24.0, -28.0  # shows the measured face, the face at +X and S⁻
_LIGHT = np.array([0.33, -0.25, 0.91])
_SHOWN = 4.0  # ρ/σ at the ends of the colour scale


@dataclass(frozen=True, eq=False)
class Face:
    """Where the pixels of the region of interest are.

    Attributes:
        rows: row of each pixel, shape (n_pix,).
        cols: column of each pixel, shape (n_pix,).
        pixel: side of a pixel [µm].
        origin: (row, column) of X = 0, Y = 0.
        traces: ends (X, Y) of each grain boundary [µm], shape (n, 2, 2).
    """

    rows: IntArray
    cols: IntArray
    pixel: float
    origin: tuple[float, float]
    traces: FloatArray

    def grid(self, values: FloatArray) -> FloatArray:
        """Values at the pixels as an image of the region, NaN off it."""
        shape = np.ptp(self.rows) + 1, np.ptp(self.cols) + 1
        image = np.full(shape, np.nan)
        image[self.rows - self.rows.min(), self.cols - self.cols.min()] = values
        return image

    def extent(
        self, first: tuple[float, float], shape: tuple[int, ...]
    ) -> tuple[float, float, float, float]:
        """Limits (Y left, Y right, X bottom, X top) [µm] of an image from its first pixel."""
        row, column = first[0] - self.origin[0] - 0.5, first[1] - self.origin[1] - 0.5
        left, right, bottom, top = column, column + shape[1], row + shape[0], row
        return self.pixel * left, self.pixel * right, self.pixel * bottom, self.pixel * top

    def show(self, axes: Axes, values: FloatArray, cmap: str, low: float, high: float) -> AxesImage:
        """Draw values at the pixels, Y to the right and X down as the rows, with the boundary."""
        image = self.grid(values)
        extent = self.extent((float(self.rows.min()), float(self.cols.min())), image.shape)
        picture = axes.imshow(image, cmap=cmap, vmin=low, vmax=high, extent=extent,
                              interpolation="nearest")  # fmt: skip
        self.draw_traces(axes)
        for spine in axes.spines.values():
            spine.set_visible(False)
        return picture

    def draw_traces(self, axes: Axes) -> None:
        """Draw the grain boundaries, where there are some."""
        for trace in self.traces:
            axes.plot(trace[:, 1], trace[:, 0], color="black", lw=1.2, ls="--")


@styled
def specimen(points: FloatArray, cells: IntArray, grain: IntArray, names: Sequence[str]) -> Figure:
    """Return the prism in parallel projection: outer faces of its cells by grain, boundary marked.

    Args:
        points: nodes [µm], shape (n_nodes, 3).
        cells: tet10 or hex20 cells, shape (n_cells, 10) or (n_cells, 20).
        grain: grain of each cell, shape (n_cells,).
        names: names of the grains.
    """
    figure = new_figure(3.6)
    axes = figure.subplots()
    right, up, towards = _view()
    seen = points @ np.column_stack([right, up])
    faces, owner = visible_faces(points, cells, towards)
    normals = _normals(points, faces)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    light = 0.62 + 0.38 * np.clip(normals @ _LIGHT, 0.0, 1.0)
    base = np.array([to_rgb(GRAINS[grain[cell] % len(GRAINS)]) for cell in owner])
    axes.add_collection(
        PolyCollection(
            list(seen[faces]), facecolors=light[:, None] * base, edgecolors="#33333366",
            linewidths=0.6,
        )
    )  # fmt: skip
    axes.add_collection(
        LineCollection(
            list(seen[boundary_edges(faces, grain[owner])]), colors=_BOUNDARY, linewidths=2.8,
            capstyle="round",
        )
    )  # fmt: skip

    def at(x: float, y: float, z: float) -> tuple[float, float]:
        place = np.array([x, y, z])
        return float(place @ right), float(place @ up)

    low, high = points.min(axis=0), points.max(axis=0)
    n_edges = len(EDGES[cells.shape[1]])
    for index, name in enumerate(names):
        middle = points[np.unique(cells[grain == index][:, :-n_edges])].mean(axis=0)
        axes.text(*at(0.0, middle[1], high[2]), name, ha="center", va="center", weight="bold",
                  fontsize=11)  # fmt: skip
    axes.text(*at(0.0, low[1], 0.4 * low[2]), "S⁻", ha="center", va="center", weight="bold")
    axes.text(*at(0.5 * high[0], high[1] + 0.5, 0.5 * low[2]), "S⁺", va="center", weight="bold")
    corner = np.array([low[0] - 1.0, low[1] - 2.6, low[2]])
    for k, name in enumerate("XYZ"):
        tip, letter = (corner + length * np.eye(3)[k] for length in (1.6, 2.1))
        axes.annotate("", xy=at(*tip), xytext=at(*corner), annotation_clip=False,
                      arrowprops={"arrowstyle": "-|>", "color": "black"})  # fmt: skip
        axes.text(*at(*letter), name, ha="center", va="center", weight="bold")
    for k, first, last, side in (
        (1, (low[0] - 0.6, low[1], high[2]), (low[0] - 0.6, high[1], high[2]), "right"),
        (0, (low[0], high[1] + 0.6, high[2]), (high[0], high[1] + 0.6, high[2]), "left"),
    ):
        axes.annotate("", xy=at(*last), xytext=at(*first), annotation_clip=False,
                      arrowprops={"arrowstyle": "<->", "lw": 0.9, "color": GREY})  # fmt: skip
        middle = 0.5 * (np.array(first) + np.array(last))
        axes.text(*at(*middle), f"  {high[k] - low[k]:g} µm  ", ha=side, va="bottom", color=GREY)
    axes.update_datalim([at(*(corner - 0.3)), at(low[0], high[1] + 1.0, high[2] + 0.5)])
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.08)
    axes.axis("off")
    return figure


def visible_faces(
    points: FloatArray, cells: IntArray, towards: FloatArray
) -> tuple[IntArray, IntArray]:
    """Corner nodes of the outer faces that are seen from a direction, and their cells.

    Args:
        points: nodes [µm], shape (n_nodes, 3).
        cells: tet10 or hex20 cells, positive Jacobian, shape (n_cells, 10) or (n_cells, 20).
        towards: direction to the viewer, shape (3,).

    Returns:
        faces, in order round each, (n, 3) or (n, 4), and the cell of each (n,).
    """
    outer, owner = outer_faces(cells)
    faces = outer[:, : outer.shape[1] // 2]
    seen = _normals(points, faces) @ towards > 0
    return faces[seen], owner[seen]


def _normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """Return normals of plane faces (n, 3) or (n, 4), of any length, shape (n, 3)."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    return np.asarray(np.cross(b - a, c - a))


def boundary_edges(faces: IntArray, grain: IntArray) -> IntArray:
    """Edges that a face of one grain shares with a face of another, shape (n, 2)."""
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    grains = np.repeat(grain, faces.shape[1])
    unique, place = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    lowest, highest = np.full(len(unique), np.iinfo(np.int64).max), np.full(len(unique), -1)
    np.minimum.at(lowest, place.ravel(), grains)
    np.maximum.at(highest, place.ravel(), grains)
    return np.asarray(unique[lowest != highest])


def _view() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return unit vectors of the specimen frame to the right, up and towards the viewer."""
    e, a = np.radians([_ELEVATION, _AZIMUTH])
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return right, np.cross(towards, right), towards


@styled
def fields(face: Face, rows: Mapping[str, FloatArray]) -> Figure:
    """u, v, w at one instant, measured and predicted, and their difference; mean of each removed.

    Args:
        face: the region of interest.
        rows: motion at the pixels [µm] by title of its row, measured and predicted, each of shape
            (n_pix, 3).
    """
    figure = new_figure(1.35 * (len(rows) + 1) + 1.1)
    axes = figure.subplots(len(rows) + 1, 3, squeeze=False, sharex=True, sharey=True)
    centred = {name: 1e3 * (motion - motion.mean(axis=0)) for name, motion in rows.items()}
    measured, predicted = centred.values()
    shown = centred | {"difference": measured - predicted}
    for k, component in enumerate(("u (along X)", "v (along Y)", "w (along Z)")):
        every = np.concatenate([motion[:, k] for motion in centred.values()])
        limit = float(np.percentile(np.abs(every), 99.5))
        for row, (name, motion) in enumerate(shown.items()):
            axis = axes[row, k]
            picture = face.show(axis, motion[:, k], SIGNED, -limit, limit)
            if row == 0:
                axis.set_title(component)
            if name == "difference":
                rms = float(np.sqrt(np.mean(motion[:, k] ** 2)))
                axis.set_title(f"rms {rms:.1f} nm", fontsize=9)
            if k == 0:
                axis.set_ylabel(f"{name}\nX [µm]")
        axes[-1, k].set_xlabel("Y [µm]")
        figure.colorbar(picture, ax=axes[:, k], location="bottom", shrink=0.85, aspect=28,
                        label=f"{component[0]} − mean [nm]")  # fmt: skip
    return figure


@styled
def residual_maps(
    face: Face, titles: Sequence[str], maps: Mapping[str, FloatArray], rms: Mapping[str, FloatArray]
) -> Figure:
    """ρ/σ at some images, and its rms over all images, for each model.

    Args:
        face: the region of interest.
        titles: title of each image, length n.
        maps: ρ/σ of "before" (and "after"), each of shape (n, n_pix).
        rms: its rms over all images, each of shape (n_pix,).
    """
    sides = tuple(maps)
    n = len(titles)
    figure = new_figure(1.58 * (n + 1) + 1.0, 9.6 if len(sides) > 1 else 6.0)
    axes = figure.subplots(n + 1, len(sides), squeeze=False, sharex=True, sharey=True)
    names = side_labels(sides)
    every = np.concatenate(list(rms.values()))
    low = min(1.0, float(np.percentile(every, 0.5)))
    high = max(1.2, float(np.percentile(every, 99.5)))
    for column, side in enumerate(sides):
        for row in range(n):
            axis = axes[row, column]
            signed = face.show(axis, maps[side][row], SIGNED, -_SHOWN, _SHOWN)
            value = np.sqrt(np.mean(maps[side][row] ** 2))
            axis.set_title(f"{titles[row]}, {names[side]}: rms {value:.2f}", fontsize=9)
        axis = axes[n, column]
        spread = face.show(axis, rms[side], "cividis", low, high)
        axis.set_title(f"rms over all images, {names[side]}", fontsize=9)
        axis.set_xlabel("Y [µm]")
    for axis in axes[:, 0]:
        axis.set_ylabel("X [µm]")
    figure.colorbar(signed, ax=axes[:n], shrink=0.6, label="ρ/σ [1]", extend="both")
    figure.colorbar(spread, ax=axes[n:], label="rms of ρ/σ [1]")
    return figure
