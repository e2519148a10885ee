"""Frames of one file, read one at a time: a long series need not fit into memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import prod
from pathlib import Path
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from driver.experiment.images.files import Refused

Levels = NDArray[np.generic]


@dataclass(frozen=True, eq=False)
class FileFrames:
    """Height maps of one file in digital levels, as stored.

    Processes hand them to each other: what reads them can be pickled.

    Attributes:
        shape: numbers of frames, rows and columns.
        dtype: type of the stored numbers.
        read: returns the levels of a frame, shape (rows, cols), from the file as it is then; it
            may be called from several threads.
        pixel_nm: pitch of its rows and of its columns as the file states it, None where it is
            silent.
        in_nm: whether the levels are heights in nanometres by themselves.
    """

    shape: tuple[int, int, int]
    dtype: np.dtype[np.generic]
    read: Callable[[int], Levels]
    pixel_nm: tuple[float, float] | None = None
    in_nm: bool = False

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.shape[0]

    def all_read(self) -> FileFrames:
        """Return these frames, once each of them could be read."""
        for index in range(len(self)):
            self.read(index)
        return self


def stack_shape(
    shape: tuple[int, ...], dtype: np.dtype[np.generic], axes: str = ""
) -> tuple[int, int, int]:
    """Numbers of frames, rows and columns of an array.

    Args:
        shape: of the array.
        dtype: of its numbers.
        axes: what the file calls its axes, a letter each.

    Raises:
        Refused: it is empty, not of numbers, or has another number of axes than two or three.
    """
    if dtype.kind not in "buif":
        raise Refused(f"values of type {dtype}", "integers or floats")
    if len(shape) not in (2, 3):
        named = f" (axes {axes})" if axes else ""
        raise Refused(
            f"an array of shape {shape}{named}",
            "heights of shape (rows, columns) or (frames, rows, columns)",
        )
    if prod(shape) == 0:
        raise Refused("no pixel", "at least one frame")
    n, rows, cols = shape if len(shape) == 3 else (1, *shape)
    return n, rows, cols


def in_memory(levels: Levels) -> FileFrames:
    """Return frames that were read as a whole, shape (rows, cols) or (n, rows, cols)."""
    shape = stack_shape(levels.shape, levels.dtype)
    return FileFrames(shape, levels.dtype, levels.reshape(shape).__getitem__)


def contiguous(
    file: Path, offset: int, shape: tuple[int, int, int], dtype: np.dtype[np.generic]
) -> FileFrames:
    """Return frames that lie in a file one after the other, as they are in memory.

    They are read and not mapped: mapped pages would count as memory of the process.

    Args:
        file: the file.
        offset: where the first frame begins [bytes].
        shape: numbers of frames, rows and columns.
        dtype: type of a number, in the byte order of the file.
    """
    return FileFrames(shape, dtype, _Contiguous(file, offset, shape, dtype))


@dataclass(frozen=True)
class _Contiguous:
    """Reads a frame of `contiguous`, whose arguments it has."""

    file: Path
    offset: int
    shape: tuple[int, int, int]
    dtype: np.dtype[np.generic]

    def __call__(self, index: int) -> Levels:
        _, rows, cols = self.shape
        begin = self.offset + index * rows * cols * self.dtype.itemsize
        levels = np.fromfile(self.file, self.dtype, rows * cols, offset=begin)
        if levels.size < rows * cols:
            raise ValueError(f"{levels.size} of the {rows * cols} levels of frame {index}")
        return levels.reshape(rows, cols)


def in_blocks(
    shape: tuple[int, int, int],
    dtype: np.dtype[np.generic],
    together: int,
    read_block: Callable[[int, int], Levels],
) -> FileFrames:
    """Return frames that a file stores some together; the last of such blocks stay in memory.

    Args:
        shape: numbers of frames, rows and columns.
        dtype: type of a number.
        together: frames of a block.
        read_block: returns the frames from a first one to before a last one; it can be pickled.
    """
    return FileFrames(shape, dtype, _InBlocks(shape[0], together, read_block))


@dataclass(frozen=True)
class _InBlocks:
    """Reads a frame of `in_blocks`, by the block that holds it."""

    n_frames: int
    together: int
    read_block: Callable[[int, int], Levels]

    def __call__(self, index: int) -> Levels:
        if self.together == 1:
            return np.asarray(self.read_block(index, index + 1)[0])
        place = index % self.together
        first = index - place
        with _BLOCKS:
            last = min(first + self.together, self.n_frames)
            block: Levels = _held(self.read_block, first, last)
        return np.array(block[place])


_BLOCKS = Lock()


@lru_cache(maxsize=2)
def _held(read_block: Callable[[int, int], Levels], first: int, last: int) -> Levels:
    return np.asarray(read_block(first, last))
