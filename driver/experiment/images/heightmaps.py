"""Stacks of height maps: in digital levels as files hold them, and handed out one at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, overload

import numpy as np
from scipy import ndimage

from driver.common.errors import InputError, sentence, why
from driver.experiment.images.file_frames import FileFrames, Levels
from driver.experiment.images.files import Refused, files_of, gap, split_dataset
from driver.experiment.images.formats import open_file
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
class StoredLevels(Sequence[Levels]):
    """Levels of the frames of a stack, read from their files whenever one is asked for.

    Attributes:
        frames: file of each frame and its place there, length n.
        sources: frames of that file, length n.
        key: key of the case that names the files, to be told.
    """

    frames: tuple[tuple[Path, int], ...]
    sources: tuple[FileFrames, ...]
    key: str

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of frames, rows and columns."""
        return (len(self), *self.sources[0].shape[1:])

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.frames)

    @overload
    def __getitem__(self, index: int, /) -> Levels: ...

    @overload
    def __getitem__(self, index: slice, /) -> Sequence[Levels]: ...

    def __getitem__(self, index: int | slice, /) -> Levels | Sequence[Levels]:
        """Levels of a frame, shape (rows, cols).

        Raises:
            ImageError: its file is no longer as it was when the stack was loaded.
        """
        if isinstance(index, slice):
            return [self[t] for t in range(*index.indices(len(self)))]
        (file, place), source = self.frames[index], self.sources[index]
        try:
            return source.read(place)
        except Exception as error:  # of the decoders each raises its own types
            found = error.found if isinstance(error, Refused) else why(error)
            expected = "the file that was read at first: run again"
            raise ImageError(sentence(file, self.key, found, expected)) from None


@dataclass(frozen=True, eq=False)
class Stack:
    """Height maps in digital levels, as stored.

    Attributes:
        levels: of each frame, of the type that is stored, each of shape (rows, cols).
        gap: the first gap in the numbers of the files, or an empty text.
    """

    levels: StoredLevels
    gap: str

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """Type of the stored numbers."""
        return self.levels.sources[0].dtype

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame."""
        return self.levels.shape[1:]

    @property
    def size(self) -> str:
        """Rows × columns, to be told."""
        return _size(self.shape)

    def file(self, index: int) -> Path:
        """Return the file of a frame."""
        return self.levels.frames[index][0]

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.levels)

    def __getitem__(self, index: int) -> FloatArray:
        """Levels of one frame as floating-point numbers, shape (rows, cols)."""
        return self.levels[index].astype(np.float64)


def load_stack(path: str | Path, key: str = "images") -> Stack:
    """Open height maps in digital levels, never rescaled; each of them can be read.

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
    parts: list[FileFrames] = []
    for file in files:
        try:
            part = open_file(file, dataset)
            if parts and part.shape[1:] != parts[0].shape[1:]:
                first = _size(parts[0].shape[1:])
                raise Refused(_size(part.shape[1:]), f"{first} as {files[0].name}")
            if parts and part.dtype != parts[0].dtype:
                raise Refused(
                    f"levels of type {part.dtype}",
                    f"{parts[0].dtype} as {files[0].name}, for one scale holds for all",
                )
        except Refused as refused:
            raise ImageError(sentence(file, key, refused.found, refused.expected)) from None
        parts.append(part)
    each = [(f, k, part) for f, part in zip(files, parts, strict=True) for k in range(len(part))]
    levels = StoredLevels(
        frames=tuple((file, place) for file, place, _ in each),
        sources=tuple(part for _, _, part in each),
        key=key,
    )
    return Stack(levels, gap([file.name for file in files]))


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


def _size(shape: tuple[int, int]) -> str:
    return f"{shape[0]} × {shape[1]} px"
