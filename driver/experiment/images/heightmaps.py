"""Reading stacks of height maps in digital levels, without loss."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from driver.common.errors import InputError, sentence
from driver.experiment.images.files import Refused, files_of, gap, split_dataset
from driver.experiment.images.formats import read_file
from meshes.arrays import BoolArray, FloatArray


class ImageError(InputError):
    """An image that cannot be used; the message names it and says what was expected."""


@dataclass(frozen=True, eq=False)
class Stack:
    """Height maps in digital levels, as stored.

    Attributes:
        levels: shape (n, rows, cols).
        dtype: type of the stored numbers.
        frames: file of each frame and its place there, length n.
        gap: the first gap in the numbers of the files, or an empty text.
    """

    levels: FloatArray
    dtype: np.dtype[np.generic]
    frames: tuple[tuple[Path, int], ...]
    gap: str

    @property
    def size(self) -> str:
        """Rows × columns, to be told."""
        return f"{self.levels.shape[1]} × {self.levels.shape[2]} px"


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
    parts: list[NDArray[np.generic]] = []
    for file in files:
        try:
            part = read_file(file, dataset)
            if parts and part.shape[1:] != parts[0].shape[1:]:
                raise Refused(_size(part), f"{_size(parts[0])} as {files[0].name}")
            if parts and part.dtype != parts[0].dtype:
                raise Refused(
                    f"levels of type {part.dtype}",
                    f"{parts[0].dtype} as {files[0].name}, for one scale holds for all",
                )
        except Refused as refused:
            raise ImageError(sentence(file, key, refused.found, refused.expected)) from None
        parts.append(part)
    levels = np.empty((sum(map(len, parts)), *parts[0].shape[1:]))
    np.concatenate(parts, out=levels, casting="unsafe")
    return Stack(
        levels=levels,
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


def _size(stack: NDArray[np.generic]) -> str:
    return f"{stack.shape[1]} × {stack.shape[2]} px"
