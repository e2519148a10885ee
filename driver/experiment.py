"""What was measured, in internal units and in the arrangement of the specimen frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from driver.case import Case
from driver.case_tables import Images
from driver.errors import InputError, sentence
from driver.history import History, read_history
from driver.images.heightmaps import read_stack

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class ExperimentError(InputError):
    """Measured files that do not fit together: file, what was found, what was expected."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """Height maps, loading history and loads of one specimen.

    Rows of every map run along +X, columns along +Y, heights along +Z.

    Attributes:
        frames: height maps, frame 0 before loading [µm], shape (n_images, rows, columns).
        flats: height maps of a flat reference surface [µm], shape (n_flats, rows, columns).
        repeats: repeated height maps before loading [µm], shape (n_repeats, rows, columns).
        pixel_um: side of a pixel [µm].
        origin: (row, column) of X = 0, Y = 0 [pixels].
        mask: true where pixels are used, shape (rows, columns), or None for all of them.
        history: times, stage travel and cycles.
        force: force on the specimen at each image [µN], shape (n_images,).
        gamma_f: nominal standard deviation of the height noise [µm].
        gamma_F: standard deviation of the load noise at the specimen [µN].
    """

    frames: FloatArray
    flats: FloatArray | None
    repeats: FloatArray | None
    pixel_um: float
    origin: tuple[float, float]
    mask: BoolArray | None
    history: History
    force: FloatArray
    gamma_f: float
    gamma_F: float


def read_experiment(case: Case) -> Experiment:
    """Read the images, the history and the loads of a case.

    Raises:
        ImageError: a stack cannot be read.
        HistoryError: the loading history cannot be used.
        ExperimentError: numbers or sizes of the files do not agree.
    """
    images = case.images
    history = read_history(case.path(case.history.file))
    frames = read_stack(case.path(images.frames))
    if len(frames) != history.n_images:
        raise ExperimentError(
            sentence(
                case.path(images.frames),
                "images.frames",
                f"{len(frames)} frames",
                f"{history.n_images}, the images of {case.history.file}",
            )
        )
    size = (frames.shape[1], frames.shape[2])
    mask = _optional(case, "mask", size)
    if mask is not None and len(mask) != 1:
        raise ExperimentError(
            sentence(case.path(images.mask or ""), "images.mask", f"{len(mask)} images", "one")
        )
    flats, repeats = _optional(case, "flats", size), _optional(case, "repeats", size)
    return Experiment(
        frames=heights(images, frames),
        flats=None if flats is None else heights(images, flats),
        repeats=None if repeats is None else heights(images, repeats),
        pixel_um=images.pixel_um,
        origin=origin(images, size),
        mask=None if mask is None else arrange(images, mask)[0] != 0,
        history=history,
        force=history.force * case.force_scale,
        gamma_f=images.gamma_f,
        gamma_F=case.loads.gamma_F,
    )


def heights(images: Images, levels: FloatArray) -> FloatArray:
    """Digital levels as heights along +Z [µm], rows along +X and columns along +Y.

    Args:
        images: how the files lie on the specimen.
        levels: as stored in the files, shape (n, rows, columns) of the files.
    """
    sign = 1.0 if images.heights == "+Z" else -1.0
    return sign * images.level_um * arrange(images, levels)


def arrange(images: Images, stack: FloatArray) -> FloatArray:
    """A stack of the files with its rows along +X and its columns along +Y.

    Args:
        images: how the files lie on the specimen.
        stack: shape (n, rows, columns) of the files.
    """
    along_x, along_y = images.rows_along, images.columns_along
    if along_x[1] == "Y":
        stack, along_x, along_y = stack.swapaxes(1, 2), along_y, along_x
    if along_x[0] == "-":
        stack = stack[:, ::-1]
    if along_y[0] == "-":
        stack = stack[:, :, ::-1]
    return np.ascontiguousarray(stack)


def origin(images: Images, size: tuple[int, int]) -> tuple[float, float]:
    """The pixel of X = 0, Y = 0 once the rows run along +X and the columns along +Y.

    Args:
        images: how the files lie on the specimen.
        size: (rows, columns) of the files.
    """
    along_x, along_y = images.rows_along, images.columns_along
    (row, column), (rows, columns) = images.origin_pixel, size
    if along_x[1] == "Y":
        along_x, along_y = along_y, along_x
        row, column, rows, columns = column, row, columns, rows
    return (
        row if along_x[0] == "+" else rows - 1 - row,
        column if along_y[0] == "+" else columns - 1 - column,
    )


def _optional(case: Case, key: str, size: tuple[int, int]) -> FloatArray | None:
    """A further stack of the case, of the size of the frames, if the case names one."""
    name: str | None = getattr(case.images, key)
    if name is None:
        return None
    path: Path = case.path(name)
    stack = read_stack(path)
    if stack.shape[1:] != size:
        found = f"{stack.shape[1]} × {stack.shape[2]} px"
        expected = f"{size[0]} × {size[1]} px as the frames"
        raise ExperimentError(sentence(path, f"images.{key}", found, expected))
    return stack
