"""Reading stacks of height maps in digital levels, without loss."""

from __future__ import annotations

import glob
import logging
import re
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray
from scipy import ndimage

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SUFFIXES = (".tif", ".tiff", ".npy")


class ImageError(ValueError):
    """An image that cannot be used; the message names it and says what was expected."""


def read_stack(path: str | Path) -> FloatArray:
    """Read height maps in digital levels, never rescaled.

    Args:
        path: a TIFF (one page or many), an NPY array, a folder of such files, or a glob
            pattern. Files are taken in natural order (frame 9 before frame 10).

    Returns:
        Levels as stored, shape (n, rows, cols).

    Raises:
        ImageError: nothing found, or a file is unreadable, truncated, empty, in colour,
            not of numbers, or of another size than the ones before it.
    """
    files = _files(path)
    stacks: list[FloatArray] = []
    for file in files:
        stack = _read_npy(file) if file.suffix.lower() == ".npy" else _read_tiff(file)
        if stacks and stack.shape[1:] != stacks[0].shape[1:]:
            raise ImageError(
                f"{file}: frames of {_size(stack)} px, but {files[0]} has {_size(stacks[0])} px; "
                "all frames of a stack must have one size."
            )
        stacks.append(stack)
    return stacks[0] if len(stacks) == 1 else np.concatenate(stacks)


def on_surface(heights: FloatArray) -> BoolArray:
    """Pixels that carry a height: finite and not exactly zero.

    Level 0 is the bottom of the instrument's range: a trench that deep is clipped there.
    """
    return np.asarray(np.isfinite(heights) & (heights != 0.0))


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


def _files(path: str | Path) -> list[Path]:
    given = Path(path)
    if given.is_file():
        return [given]
    found = given.iterdir() if given.is_dir() else (Path(name) for name in glob.glob(str(path)))
    files = [file for file in found if file.suffix.lower() in SUFFIXES and file.is_file()]
    if not files:
        raise ImageError(f"{path}: no image found; expected a file, a folder or a pattern of "
                         f"{', '.join(SUFFIXES)} files.")  # fmt: skip
    return sorted(files, key=lambda file: [
        (int(part), "") if part.isdigit() else (-1, part)
        for part in re.split(r"(\d+)", file.name)
    ])  # fmt: skip


class _ErrorLog(logging.Handler):
    """Keeps what tifffile only logs: it cuts a truncated stack short without an exception."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.getMessage())


def _read_tiff(file: Path) -> FloatArray:
    log, logger = _ErrorLog(), logging.getLogger("tifffile")
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(log)
    try:
        with tifffile.TiffFile(file) as tiff:
            sizes = sorted({page.shape for page in tiff.pages})
            n_series = len(tiff.series)
            samples = tiff.pages.first.samplesperpixel
            levels = tiff.asarray()
    except Exception as error:  # every decoder behind tifffile raises its own type
        raise ImageError(f"{file}: cannot be read as TIFF ({error}).") from error
    finally:
        logger.removeHandler(log)
        logger.propagate = propagate
    if log.messages:
        raise ImageError(f"{file}: truncated or damaged TIFF ({log.messages[0]}).")
    if samples > 1:
        raise ImageError(f"{file}: {samples} channels a pixel; expected heights, not colours.")
    if len(sizes) > 1 or n_series > 1:
        raise ImageError(
            f"{file}: pages of unlike size or type {sizes}; all frames of a stack must be alike."
        )
    return _checked(file, levels)


def _read_npy(file: Path) -> FloatArray:
    try:
        levels = np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise ImageError(f"{file}: cannot be read as NPY ({error}).") from error
    return _checked(file, levels)


def _checked(file: Path, levels: NDArray[np.generic]) -> FloatArray:
    if levels.dtype.kind not in "uif":
        raise ImageError(f"{file}: values of type {levels.dtype}; expected integers or floats.")
    stack = levels[np.newaxis] if levels.ndim == 2 else levels
    if stack.ndim != 3:
        raise ImageError(
            f"{file}: array of shape {levels.shape}; expected heights of shape (rows, cols) "
            "or (frames, rows, cols)."
        )
    if stack.size == 0:
        raise ImageError(f"{file}: holds no pixel; expected at least one frame.")
    return np.asarray(stack, dtype=np.float64)


def _size(stack: FloatArray) -> str:
    return f"{stack.shape[1]} × {stack.shape[2]}"
