"""The picture of a check: the case drawn over the first image, and what the stage and load did."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from driver.case.model import Case
from driver.check.ebsd_picture import MapPicture, draw_map
from driver.check.slip_traces import slip_traces
from driver.common.atomic_write import write_whole
from driver.experiment.history import History
from driver.experiment.images.region import CodeArray, Excluded
from driver.experiment.reading import Experiment, fitted_loads
from driver.forward.geometry import boundary_traces, grain_places
from driver.report.style import boundaries_label, literal
from meshes.arrays import FloatArray

_HEIGHT, _MAP_HEIGHT = 5.4, 4.6  # inches
_ROI, _BOUNDARY, _AXES, _SLIP = "#ffe14d", "#ff8a1f", "#35d0ff", "#8dff6a"
_TRACES = (("-", "—"), ("--", "- -"))
"""Styles of the slip traces of a grain, drawn and told, one for each plane that is shown."""
_TRACE, _NAME_BESIDE = 0.16, 0.2
"""Half of a slip trace, and where the text beside it begins, over the width of the face."""
_LEFT_OUT = {
    Excluded.TRENCH: ("#3b6cff", "trench"),
    Excluded.MASK: ("#b04fff", "mask"),
    Excluded.DUST: ("#ff3b3b", "dust"),
}
# A dark rim keeps lines and letters legible on any grey.
_RIM = [withStroke(linewidth=3.5, foreground="black")]
_THIN_RIM = [withStroke(linewidth=2.0, foreground="black")]


def draw(
    case: Case,
    experiment: Experiment,
    path: Path,
    codes: CodeArray | None = None,
    maps: Sequence[MapPicture] = (),
    rotations: FloatArray | None = None,
) -> None:
    """Draw the picture of a check into a PNG file.

    Args:
        case: the case.
        experiment: its measured data.
        path: file to write.
        codes: what becomes of each pixel, values of `Excluded`, or None if it is not known.
        maps: the EBSD maps of the case.
        rotations: crystal → specimen of each grain, shape (n_grains, 3, 3), by which slip traces
            are drawn, or None if they are not known.
    """
    heights = (_HEIGHT, _MAP_HEIGHT) if maps else (_HEIGHT,)
    figure = Figure(figsize=(14.0, sum(heights)), layout="constrained")
    FigureCanvasAgg(figure)  # draws without a display, whatever the user's backend
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    grid = parts[0].add_gridspec(2, 2, width_ratios=(1.9, 1.0))
    face = parts[0].add_subplot(grid[:, 0])
    _draw_image(face, case, experiment, codes)
    if rotations is not None:
        draw_slip_traces(face, case, rotations)
    face.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3, fontsize=8, framealpha=0.85,
        facecolor="#555555", labelcolor="white",
    )  # fmt: skip
    _draw_stage(parts[0].add_subplot(grid[0, 1]), experiment)
    load = fitted_loads(case, experiment.force)
    _draw_load(parts[0].add_subplot(grid[1, 1]), experiment.history, load)
    if maps:
        places = parts[1].subplots(1, len(maps), squeeze=False)[0]
        for axes, one in zip(places, maps, strict=True):
            draw_map(axes, one)
    picture = BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    write_whole(path, picture.getvalue())


def _draw_image(axes: Axes, case: Case, experiment: Experiment, codes: CodeArray | None) -> None:
    row, column = experiment.origin
    pixel, specimen = experiment.pixel_um, case.specimen
    heights = experiment.frames[0] * 1e3
    n_rows, n_columns = heights.shape
    # Axes in µm: Y to the right, X down as the rows of the image.
    extent = (
        (-0.5 - column) * pixel,
        (n_columns - 0.5 - column) * pixel,
        (n_rows - 0.5 - row) * pixel,
        (-0.5 - row) * pixel,
    )
    low, high = np.nanpercentile(heights, (1, 99.5))
    axes.set_facecolor("black")  # pixels without a height
    picture = axes.imshow(heights, cmap="gray", extent=extent, vmin=low, vmax=high)
    if codes is not None:
        for reason, (colour, name) in _LEFT_OUT.items():
            if not np.any(codes == reason):
                continue
            axes.imshow(
                np.where(codes == reason, 1.0, np.nan), cmap=ListedColormap([colour]),
                extent=extent, alpha=0.55, interpolation="nearest",
            )  # fmt: skip
            axes.plot([], [], "s", color=colour, label=f"left out: {name}")
    bar = axes.figure.colorbar(picture, ax=axes, shrink=0.62, pad=0.02)
    bar.set_label("height of the first image [nm]")
    axes.add_patch(
        Rectangle(
            (0.0, -specimen.width / 2),
            specimen.length,
            specimen.width,
            fill=False,
            edgecolor=_ROI,
            linewidth=1.8,
            linestyle="--",
            label="measured face (ROI)",
            path_effects=_RIM,
        )
    )
    draw_grains(axes, case)
    axes.plot(0, 0, "o", color=_AXES, ms=7, mec="black", label="X = 0, Y = 0")
    arm = 0.3 * specimen.width
    for name, tip in (("X", (0.0, arm)), ("Y", (arm, 0.0))):
        axes.annotate(
            "", xy=tip, xytext=(0, 0), arrowprops={"arrowstyle": "-|>", "color": _AXES, "lw": 2.2}
        )
        axes.text(
            tip[0] * 1.3, tip[1] * 1.3, name, color=_AXES, ha="center", va="center",
            weight="bold", fontsize=13, path_effects=_RIM,
        )  # fmt: skip
    axes.set(
        xlabel="Y [µm] (loading axis)",
        ylabel="X [µm]",
        title=f"First image, {n_rows} × {n_columns} px of {pixel * 1e3:g} nm; Z to the viewer",
    )


def draw_grains(axes: Axes, case: Case) -> None:
    """Draw the grain boundaries, the name of each grain between them, and those of the end faces.

    Args:
        axes: of the face, Y to the right and X down [µm].
        case: the case.
    """
    specimen, traces = case.specimen, boundary_traces(case)
    for name, at, turn in (("S_MINUS", 0.0, "right"), ("S_PLUS", specimen.length, "left")):
        axes.text(
            at, -0.5 * specimen.width, f" {name} ", color=_ROI, ha=turn, va="top", fontsize=8,
            path_effects=_RIM,
        )  # fmt: skip
    for number, trace in enumerate(traces):
        axes.plot(
            trace[:, 1],
            trace[:, 0],
            color=_BOUNDARY,
            lw=2.2,
            label="" if number else boundaries_label(len(traces)),
            path_effects=_RIM,
        )
    for grain, (x, y) in grain_places(case):
        beside = (y + _NAME_BESIDE * specimen.width, x - 0.13 * specimen.width, "left")
        above = (y, -0.38 * specimen.width, "center")
        at_y, at_x, aligned = beside if specimen.boundaries_stay else above
        axes.text(
            at_y,
            at_x,
            literal(case.grains[grain].name),
            color=_BOUNDARY,
            ha=aligned,
            weight="bold",
            fontsize=11,
            path_effects=_RIM,
        )


def draw_slip_traces(axes: Axes, case: Case, rotations: FloatArray) -> None:
    """Draw the slip traces of each grain, of the planes that tension along Y shears most.

    Args:
        axes: of the face, Y to the right and X down [µm].
        case: the case.
        rotations: crystal → specimen of each grain, shape (n_grains, 3, 3).
    """
    arm, told = _TRACE * case.specimen.width, "slip traces of the largest Schmid factors"
    systems = case.material.to_material().slip_systems
    for grain, (x, y) in grain_places(case):
        traces = slip_traces(rotations[grain], systems)
        lines = []
        for (style, sign), trace in zip(_TRACES, traces, strict=False):
            along_x, along_y = arm * np.array(trace.along)
            axes.plot(
                [y - along_y, y + along_y], [x - along_x, x + along_x], style, color=_SLIP, lw=1.6,
                label=told, path_effects=_RIM,
            )  # fmt: skip
            told = ""
            lines.append(f"{sign} {trace.plane} {trace.schmid:.2f}")
        axes.text(
            y + _NAME_BESIDE * case.specimen.width, x, "\n".join(lines), color=_SLIP,
            fontsize=8, va="center",
            path_effects=_THIN_RIM,
        )  # fmt: skip


def _draw_stage(axes: Axes, experiment: Experiment) -> None:
    history = experiment.history
    axes.plot(history.time, history.stage, color="0.55", lw=1.2, label="stage")
    rows = history.image_row
    axes.plot(history.time[rows], history.stage[rows], ".", ms=4, color="C0", label="image")
    turning = history.turning
    axes.plot(history.time[turning], history.stage[turning], "o", ms=7, mfc="none", mec="C3",
              label="turning point")  # fmt: skip
    axes.set(xlabel="time [s]", ylabel="stage travel [µm]", title="Stage")
    axes.legend(fontsize=8, loc="lower right")
    axes.grid(alpha=0.3)


def _draw_load(axes: Axes, history: History, load: FloatArray) -> None:
    stage = history.stage[history.image_row]
    for cycle in np.unique(history.cycle):
        members = np.flatnonzero(history.cycle == cycle)
        # The line of a cycle starts where the one before ended.
        joined = members if members[0] == 0 else np.r_[members[0] - 1, members]
        axes.plot(stage[joined], load[joined], ".-", ms=4, lw=1, label=f"cycle {cycle}")
    axes.set(xlabel="stage travel [µm]", ylabel="load on the specimen [µN]", title="Load")
    low, high = float(np.nanmin(load)), float(np.nanmax(load))
    axes.set_ylim(bottom=min(0.0, low) - 0.25 * (high - low))
    axes.legend(fontsize=8, loc="lower center", ncols=3)
    axes.grid(alpha=0.3)
