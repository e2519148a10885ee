"""What was measured, in internal units and in the arrangement of the specimen frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from driver.case.images import Images
from driver.case.model import Case
from driver.common.errors import InputError, sentence
from driver.experiment.history import REVERSAL, History, read_history
from driver.experiment.images.files import Refused, files_of, split_dataset
from driver.experiment.images.heightmaps import HeightMaps, Stack, StoredLevels, load_stack
from driver.experiment.log_file import HistoryError
from driver.experiment.stack_checks import (
    ExperimentError,
    Seen,
    look_at_levels,
    refuse_other_lengths,
    remarks_on_copies,
    remarks_on_pixels,
    remarks_on_repeats,
    spread,
    stack_error,
    with_height,
)
from meshes.arrays import BoolArray, FloatArray

Anything = TypeVar("Anything")
Scalar = TypeVar("Scalar", bound=np.generic)

# The relief of the repeats is that of image 0: another scale shows in its spread.
_SCALES = 2.0
_FEWEST_LOADS = 2  # as of a history, see `read_history`


@dataclass(frozen=True, eq=False)
class Experiment:
    """Height maps, loading history and loads of one specimen.

    Rows of every map run along +X, columns along +Y, heights along +Z. A pixel without a
    height is not a number.

    Attributes:
        frames: height maps, frame 0 before loading [µm], shape (n_images, rows, columns).
        flats: height maps of a flat reference surface [µm], shape (n_flats, rows, columns).
        repeats: repeated height maps before loading [µm], shape (n_repeats, rows, columns).
        pixel_um: side of a pixel [µm].
        origin: (row, column) of X = 0, Y = 0 [pixels].
        mask: true where pixels are used, shape (rows, columns), or None for all of them.
        history: times, stage travel and cycles.
        force: force on the specimen at each image [µN], shape (n_images,).
        gamma_f: nominal standard deviation of the height noise [µm]; without repeats the noise.
        gamma_F: standard deviation of the load noise at the specimen [µN].
        clipped: number of pixels of `frames` at the largest level of their type.
        noise_map: noise of each pixel, on any scale, shape (rows, columns), or None for even noise.
        remarks: what is doubtful in the files, a sentence each.
    """

    frames: HeightMaps
    flats: HeightMaps | None
    repeats: FloatArray | None
    pixel_um: float
    origin: tuple[float, float]
    mask: BoolArray | None
    history: History
    force: FloatArray
    gamma_f: float
    gamma_F: float
    clipped: int = 0
    noise_map: FloatArray | None = None
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class MeasuredMaps:
    """Height maps of a stack, made of its levels whenever one is asked for.

    Attributes:
        images: how the files lie on the specimen, and what a level means.
        levels: as stored in the files.
    """

    images: Images
    levels: StoredLevels

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of maps, of their rows along +X and of their columns along +Y."""
        _, rows, cols = self.levels.shape
        along_x_first = self.images.rows_along[1] == "X"
        return (len(self.levels), *((rows, cols) if along_x_first else (cols, rows)))

    def __len__(self) -> int:
        """Return the number of maps."""
        return len(self.levels)

    def __getitem__(self, index: int, /) -> FloatArray:
        """Heights along +Z [µm], shape (rows, columns); NaN where a pixel carries none."""
        one = self.levels[index].astype(np.float64)[None]
        return np.asarray(heights(self.images, one)[0])

    def __iter__(self) -> Iterator[FloatArray]:
        """One map after the other."""
        return (self[t] for t in range(len(self)))


def history_of(case: Case) -> History:
    """Return the loading history of a case, of its images or, where it has none, of its loads.

    Raises:
        HistoryError: the history cannot be used, or the loads that the case leaves out are none
            of it, or too many of it.
    """
    path = case.path(case.history.file)
    history = read_history(path, case.with_images, stated=case.history)
    left, loads = set(case.loads.left_out), range(history.n_images)
    unknown = sorted(left.difference(loads))
    if unknown:
        found = ", ".join(map(str, unknown))
        expected = f"numbers from 0 to {loads[-1]}, as {path} has them"
        raise HistoryError(f"loads.left_out: found {found}, expected {expected}")
    if len(loads) - len(left) < _FEWEST_LOADS:
        raise HistoryError(
            f"loads.left_out: found {len(left)} of the {len(loads)} loads of {path}, expected at "
            f"least {_FEWEST_LOADS} that stay"
        )
    return history


def fitted_loads(case: Case, loads: FloatArray) -> FloatArray:
    """Return loads of all images, shape (n_images,), no number where the case leaves one out."""
    return np.where(np.isin(np.arange(len(loads)), case.loads.left_out), np.nan, loads)


def read_experiment(case: Case) -> Experiment:
    """Read the images, the history and the loads of a case.

    Raises:
        ExperimentError: files that cannot be read or used, or that do not fit together; every
            one of them is told, one sentence a line.
    """
    problems: list[str] = []

    def or_told(read: Callable[[], Anything]) -> Anything | None:
        try:
            return read()
        except InputError as error:
            problems.append(str(error))
            return None

    images = case.images
    history = or_told(lambda: history_of(case))
    frames, seen = or_told(lambda: _frames(case, history)) or (None, Seen(0, (), {}))
    flats = or_told(lambda: _optional(case, "flats", frames))
    or_told(lambda: _refuse_unknown_noise(case))
    repeats = or_told(lambda: _optional(case, "repeats", frames))
    mask = or_told(lambda: _mask(case, frames))
    noise_map = or_told(lambda: _noise_map(case, frames))
    if problems or history is None or frames is None:
        raise ExperimentError("\n".join(problems))
    return Experiment(
        frames=MeasuredMaps(images, frames.levels),
        flats=None if flats is None else MeasuredMaps(images, flats.levels),
        repeats=None if repeats is None else _all(images, repeats),
        pixel_um=images.pixel_um,
        origin=origin(images, frames.shape),
        mask=None if mask is None else arrange(images, _used(mask)[None])[0],
        history=history,
        force=history.force * case.force_scale,
        gamma_f=images.gamma_f,
        gamma_F=case.loads.gamma_F,
        clipped=seen.clipped,
        noise_map=noise_map,
        remarks=(
            *remarks_on_pixels(case, {"frames": frames, "flats": flats, "repeats": repeats}),
            *remarks_on_copies(frames, seen.copies),
            *(remarks_on_repeats(repeats, seen, _loaded(history)) if repeats else ()),
        ),
    )


def _loaded(history: History) -> BoolArray:
    """Whether the stage has moved before each image, by more than play, shape (n_images,)."""
    moved = np.abs(history.stage - history.stage[0]) > REVERSAL * np.ptp(history.stage)
    return np.asarray(np.logical_or.accumulate(moved)[history.image_row])


def read_unloaded(case: Case, history: History) -> Experiment | None:
    """Return what can be there before a test: repeats, flats and mask.

    Args:
        case: the case; files that it names may be absent.
        history: what will be done to the specimen.

    Returns:
        An experiment without frames, its loads without a meaning; None without repeats.

    Raises:
        InputError: a file that is there cannot be used.
    """
    images = case.images
    there = {key: _is_there(case, key) for key in ("repeats", "flats", "mask")}
    repeats = _optional(case, "repeats", None) if there["repeats"] else None
    if repeats is None:
        return None
    flats = _optional(case, "flats", repeats) if there["flats"] else None
    mask = _mask(case, repeats) if there["mask"] else None
    unloaded = _all(images, repeats)
    return Experiment(
        frames=np.zeros((0, *unloaded.shape[1:])),
        flats=None if flats is None else MeasuredMaps(images, flats.levels),
        repeats=unloaded,
        pixel_um=images.pixel_um,
        origin=origin(images, repeats.shape),
        mask=None if mask is None else arrange(images, _used(mask)[None])[0],
        history=history,
        force=np.zeros(history.n_images),
        gamma_f=images.gamma_f,
        gamma_F=case.loads.gamma_F,
    )


NO_FRAMES = 'images.frames: found nothing (boundary.motion = "stage" does without), expected images'


def refuse_absent_images(case: Case) -> None:
    """Refuse a case whose images are not named or not there, before anything is computed.

    Raises:
        ExperimentError: frames are not named, a file is not there, or nothing tells the noise; a
            line each.
    """
    problems: list[str] = []
    for key, missing in (
        ("frames", NO_FRAMES), ("repeats", ""), ("flats", ""), ("mask", ""),
        ("noise_map", ""),
    ):  # fmt: skip
        name: str | None = getattr(case.images, key)
        if name is None:
            problems += filter(None, [missing])
            continue
        try:
            files_of(split_dataset(case.path(name))[0])
        except Refused as refused:
            problems.append(str(stack_error(case, key, refused.found, refused.expected)))
    try:
        _refuse_unknown_noise(case)
    except ExperimentError as error:
        problems.append(str(error))
    if problems:
        raise ExperimentError("\n".join(problems))


def _refuse_unknown_noise(case: Case) -> None:
    """Refuse a case of which neither repeats nor a stated number tells the noise of the images."""
    if case.images.repeats is None and "noise_nm" not in case.images.model_fields_set:
        expected = (
            "repeated images of the unloaded surface (their mean is the reference, their scatter "
            "the noise), or images.noise_nm, a number > 0: the noise stated instead"
        )
        raise ExperimentError(sentence(case.file, "images.repeats", "nothing", expected))


def _is_there(case: Case, key: str) -> bool:
    name: str | None = getattr(case.images, key)
    if name is None:
        return False
    try:
        files_of(split_dataset(case.path(name))[0])
    except Refused:
        return False
    return True


def heights(images: Images, levels: FloatArray) -> FloatArray:
    """Digital levels as heights along +Z [µm], rows along +X and columns along +Y.

    Args:
        images: how the files lie on the specimen, and what a level means.
        levels: as stored in the files, shape (n, rows, columns) of the files.

    Returns:
        Not a number where a pixel carries no height.
    """
    sign = 1.0 if images.heights == "+Z" else -1.0
    arranged = arrange(images, levels)
    surface = (sign * images.level_um) * arranged + sign * images.offset_um
    surface[~with_height(images, arranged)] = np.nan
    return surface


def _all(images: Images, stack: Stack) -> FloatArray:
    return np.stack(list(MeasuredMaps(images, stack.levels)))


def arrange(images: Images, stack: NDArray[Scalar]) -> NDArray[Scalar]:
    """Return a stack of the files with its rows along +X and its columns along +Y.

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


def as_in_files(images: Images, stack: NDArray[Scalar]) -> NDArray[Scalar]:
    """Return a stack with its rows along +X and its columns along +Y, as the files have it.

    Args:
        images: how the files lie on the specimen.
        stack: as `arrange` returns it.
    """
    along_x, along_y = images.rows_along, images.columns_along
    swapped = along_x[1] == "Y"
    if swapped:
        along_x, along_y = along_y, along_x
    if along_x[0] == "-":
        stack = stack[:, ::-1]
    if along_y[0] == "-":
        stack = stack[:, :, ::-1]
    return np.ascontiguousarray(stack.swapaxes(1, 2) if swapped else stack)


def origin(images: Images, size: tuple[int, int]) -> tuple[float, float]:
    """Return the pixel of X = 0, Y = 0 once the rows run along +X and the columns along +Y.

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


def _stack(case: Case, key: str, name: str, like: Stack | None) -> Stack:
    """Return a stack of the case that has the size of the frames."""
    stack = load_stack(case.path(name), f"images.{key}")
    refuse_other_lengths(case, key, stack)
    if like is not None and stack.shape != like.shape:
        raise stack_error(case, key, stack.size, f"{like.size} as the frames")
    return stack


def _frames(case: Case, history: History | None) -> tuple[Stack, Seen]:
    """Return the frames, and what a look at each has found."""
    if case.images.frames is None:
        raise ExperimentError(NO_FRAMES)
    stack = _stack(case, "frames", case.images.frames, None)
    if history is not None and len(stack) != history.n_images:
        gap = f" ({stack.gap})" if stack.gap else ""
        count = "1 frame" if len(stack) == 1 else f"{len(stack)} frames"
        found, images = f"{count}{gap}", f"the images of {case.history.file}"
        raise stack_error(case, "frames", found, f"{history.n_images}, {images}")
    seen = look_at_levels(case, "frames", stack)
    if len(seen.copies) == len(stack) - 1 > 0:
        found = f"the levels of frame 0 in all {len(stack)} frames"
        raise stack_error(case, "frames", found, "an image of each stop")
    return stack, seen


def _optional(case: Case, key: str, frames: Stack | None) -> Stack | None:
    """Flats or repeats, if the case names them: on the scale of the frames, two at least."""
    name: str | None = getattr(case.images, key)
    if name is None:
        return None
    stack = _stack(case, key, name, frames)
    if frames is not None and stack.dtype != frames.dtype:
        expected = f"{frames.dtype} as the frames, for one height_per_level_nm holds for all"
        raise stack_error(case, key, f"levels of type {stack.dtype}", expected)
    if len(stack) < 2:
        of = {
            "flats": "their scatter is the error of their mean",
            "repeats": "their scatter is the noise",
        }
        raise stack_error(case, key, "1 frame", f"at least 2 ({of[key]})")
    for t, original in look_at_levels(case, key, stack).copies:
        raise stack_error(
            case, key, f"frame {t} with every pixel as in frame {original}",
            "frames that were each taken anew", stack.file(t),
        )  # fmt: skip
    if key == "repeats" and frames is not None:
        first, repeat = (spread(case.images, s[0]) for s in (frames, stack))
        if not first / _SCALES <= repeat <= first * _SCALES:
            level = case.images.height_per_level_nm
            raise stack_error(
                case, key, f"heights that spread over {level * repeat:.3g} nm",
                f"about {level * first:.3g} nm as in image 0: one scale holds for all",
            )  # fmt: skip
    return stack


def _mask(case: Case, frames: Stack | None) -> Stack | None:
    if case.images.mask is None:
        return None
    stack = _stack(case, "mask", case.images.mask, frames)
    if len(stack) != 1:
        raise stack_error(case, "mask", f"{len(stack)} images", "one")
    if not _used(stack).any():
        raise stack_error(case, "mask", "0 at every pixel", "another number where pixels are used")
    return stack


def _noise_map(case: Case, frames: Stack | None) -> FloatArray | None:
    """Return the noise of each pixel, in the arrangement of the specimen."""
    if case.images.noise_map is None:
        return None
    stack = _stack(case, "noise_map", case.images.noise_map, frames)
    if len(stack) != 1:
        raise stack_error(case, "noise_map", f"{len(stack)} images", "one")
    noise = stack[0]
    bad = ~(np.isfinite(noise) & (noise > 0))
    if bad.any():
        row, column = np.argwhere(bad)[0]
        found = f"{noise[row, column]:.3g} at row {row}, column {column}"
        raise stack_error(case, "noise_map", found, "a number above 0 at every pixel")
    return np.asarray(arrange(case.images, noise[None])[0])


def _used(mask: Stack) -> BoolArray:
    return np.asarray(np.isfinite(mask[0]) & (mask[0] != 0))
