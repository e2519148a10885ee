"""Stacks of height maps: in digital levels as files hold them, and handed out one at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from scipy import ndimage

from driver.common.errors import InputError, sentence
from driver.experiment.images.files import Refused, files_of, gap, split_dataset
from driver.experiment.images.formats import Levels, read_file
from meshes.arrays import BoolArray, FloatArray


class ImageError(InputError):
    """An image that cannot be used; the message names it and says what was expected."""


class HeightMaps(Protocol):
    """Height maps of one size [µm], one at a time; an array of shape (n, rows, cols) is such."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers n of maps, of their rows and of their columns."""

    def __len__(self) -> int:
        """Return the number n of maps."""

    def __getitem__(self, index: int, /) -> FloatArray:
        """Return one map, shape (rows, cols)."""

    def __iter__(self) -> Iterator[FloatArray]:
        """One map after the other."""


@dataclass(frozen=True, eq=False)
class Stack:
    """Height maps in digital levels, as stored: of 8 bits a pixel takes one byte.

    Attributes:
        levels: of each frame, of the type that is stored, each of shape (rows, cols).
        dtype: type of the stored numbers.
        frames: file of each frame and its place there, length n.
        gap: the first gap in the numbers of the files, or an empty text.
    """

    levels: tuple[Levels, ...]
    dtype: np.dtype[np.generic]
    frames: tuple[tuple[Path, int], ...]
    gap: str

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame."""
        rows, cols = self.levels[0].shape
        return rows, cols

    @property
    def size(self) -> str:
        """Rows × columns, to be told."""
        return _size(self.levels[0])

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.levels)

    def __getitem__(self, index: int) -> FloatArray:
        """Levels of one frame as floating-point numbers, shape (rows, cols)."""
        return self.levels[index].astype(np.float64)


def load_stack(path: str | Path, key: str = "images") -> Stack:
    """Read height maps in digital levels, never rescaled.

    Args:
        path: a TIFF (one page or many), a PNG, an NPY array, a dataset of an HDF5 file
            (`images.h5:/frames`), a folder of such files, or a glob pattern. Files are taken
            in natural order (frame 9 before frame 10).
        key: key of the case that names the path, to be told.

    Raises:
        ImageError: nothing found, or a file is unreadable, truncated, empty, in colour,
            not of numbers, or of another size or type than the ones before it.
    """
    name, dataset = split_dataset(path)
    try:
        files = files_of(name)
    except Refused as refused:
        raise ImageError(sentence(Path(path), key, refused.found, refused.expected)) from None
    parts: list[Levels] = []
    for file in files:
        try:
            part = read_file(file, dataset)
            if parts and part.shape[1:] != parts[0].shape[1:]:
                raise Refused(_size(part[0]), f"{_size(parts[0][0])} as {files[0].name}")
            if parts and part.dtype != parts[0].dtype:
                raise Refused(
                    f"levels of type {part.dtype}",
                    f"{parts[0].dtype} as {files[0].name}, for one scale holds for all",
                )
        except Refused as refused:
            raise ImageError(sentence(file, key, refused.found, refused.expected)) from None
        parts.append(part)
    return Stack(
        levels=tuple(levels for part in parts for levels in part),
        dtype=parts[0].dtype,
        frames=tuple(
            (f, k) for f, part in zip(files, parts, strict=True) for k in range(len(part))
        ),
        gap=gap([file.name for file in files]),
    )


def on_surface(heights: FloatArray) -> BoolArray:
    """Pixels that carry a height: the finite ones."""
    return np.asarray(np.isfinite(heights))


def fill_off_surface(heights: FloatArray, valid: BoolArray) -> FloatArray:
    """Extend the surface over the pixels without a height by their nearest neighbours.

    A spline through a trench wall would ring some pixels into the face.

    Args:
        heights: one height map, shape (rows, cols).
        valid: pixels that carry a height, at least one, shape (rows, cols).
    """
    if valid.all():
        return heights
    nearest = ndimage.distance_transform_edt(~valid, return_distances=False, return_indices=True)
    return np.asarray(heights[tuple(nearest)])


def _size(frame: Levels) -> str:
    return f"{frame.shape[0]} × {frame.shape[1]} px"
