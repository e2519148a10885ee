"""Whether the levels of a stack can be heights, and what its files say of the pixels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path

import numpy as np

from driver.case.images import Images
from driver.case.instrument_files import LEVEL_NM
from driver.case.model import Case
from driver.common.errors import InputError, sentence
from driver.experiment.images.heightmaps import Stack
from meshes.arrays import BoolArray, FloatArray

_TALLEST = 1e6  # nm; beyond it a level means something else, such as 3e38 for no height
# A level that stands for no height: at this share of the pixels if it lies away from all others by
# half of their spread, at so many pixels if by three times their whole range.
_SHARE, _SPREADS = 5e-3, 0.5
_FEW, _RANGES = 10, 3.0
# Frames that end alike are stretched where the relief changes by this share from one to the next,
# and by more than the noise of so many pixels.
_STRETCHED, _OF_NOISE, _FEWEST = 3e-3, 2.0, 4
_TOLD = 5  # copies
_PIXEL_OFF = 0.01  # of the size that a file states, beyond which one of both is in doubt


class ExperimentError(InputError):
    """Measured files that do not fit together: a line each, with file, key, found, expected."""


def stack_error(
    case: Case, key: str, found: str, expected: str, file: Path | None = None
) -> ExperimentError:
    """Return what is wrong with a file that a key of the images names."""
    path = file or case.path(getattr(case.images, key))
    return ExperimentError(sentence(path, f"images.{key}", found, expected))


def with_height(images: Images, levels: FloatArray) -> BoolArray:
    """Whether each level means a height."""
    finite = np.isfinite(levels)
    if images.off_surface_level == "none":
        return finite
    return np.asarray(finite & (levels != images.off_surface_level))


@dataclass(frozen=True)
class Seen:
    """What a look at every frame of a stack has found.

    Attributes:
        clipped: number of pixels at the largest level of their type.
        copies: frames with every level of an earlier one, and that one.
        first_of: first frame with all its levels, by their hash.
    """

    clipped: int
    copies: tuple[tuple[int, int], ...]
    first_of: Mapping[bytes, int]


def look_at_levels(case: Case, key: str, stack: Stack) -> Seen:
    """Read every frame once.

    Raises:
        ExperimentError: a frame has no relief or a level that is no height, or each was stretched
            to a contrast of its own.
    """
    limit = np.inf
    if stack.dtype.kind in "ui":
        limit = 2.0 ** (8 * stack.dtype.itemsize - (stack.dtype.kind == "i")) - 1.0
    clipped, reliefs, ends = 0, list[float](), set[tuple[float, float]]()
    first_of, copies = dict[bytes, int](), list[tuple[int, int]]()
    for t in range(len(stack)):
        levels = stack[t]
        kept = with_height(case.images, levels)
        _refuse_strange(case, key, stack, t, levels, kept, limit)
        clipped += int(np.count_nonzero(levels == limit))
        reliefs.append(float(np.std(levels[kept])))
        ends.add((float(np.nanmin(levels)), float(np.nanmax(levels))))
        same = first_of.setdefault(_hash(levels), t)
        if same != t:
            copies.append((t, same))
    _refuse_stretched(case, key, stack, np.array(reliefs), ends)
    return Seen(clipped, tuple(copies), first_of)


def _hash(levels: FloatArray) -> bytes:
    return blake2b(levels.tobytes()).digest()


def _refuse_stretched(
    case: Case, key: str, stack: Stack, reliefs: FloatArray, ends: set[tuple[float, float]]
) -> None:
    """Refuse frames that end at the same levels, though the relief of each is another.

    Of one surface the relief stays, whatever the noise of its pixels, but for what is stretched.
    """
    if len(reliefs) < _FEWEST or len(ends) > 1:
        return
    change = float(np.median(np.abs(np.diff(np.log(reliefs)))))
    rows, columns = stack.shape
    if change > max(_STRETCHED, _OF_NOISE / np.sqrt(rows * columns)):
        ((low, high),) = ends
        raise stack_error(
            case, key,
            f"levels from {low:g} to {high:g} in each frame, whose relief changes by "
            f"{100 * change:.2g} % from one to the next",
            "one scale for all: heights that no program stretched to the contrast of each image",
        )  # fmt: skip


def _refuse_strange(
    case: Case, key: str, stack: Stack, t: int, levels: FloatArray, kept: BoolArray, limit: float
) -> None:
    there = levels[kept]
    marked = np.isfinite(levels).sum() > there.size
    level, count = (None, 0) if marked else _isolated(there, limit)
    if level is not None:
        others = there[there != level]
        raise stack_error(
            case, key,
            f"level {_exact(level)} at {count} pixels ({count / levels.size:.2g} of all) of frame "
            f"{t}, away from all others ({others.min():.6g} … {others.max():.6g})",
            f"heights; images.off_surface_level = {_exact(level)} if it marks pixels without one",
            stack.file(t),
        )  # fmt: skip
    # Instruments may measure from a stage far away.
    far = stack.levels.sources[t].in_nm and there.size
    away = np.abs(there - (np.median(there) if far else 0.0))
    if away.max(initial=0.0) * case.images.height_per_level_nm > _TALLEST:
        raise stack_error(
            case, key, f"level {there[np.argmax(away)]:.3g} in frame {t}",
            f"heights within {_TALLEST:g} nm; NaN, or off_surface_level, for a pixel without",
            stack.file(t),
        )  # fmt: skip
    if there.size and np.ptp(there) > 0:
        return
    found = f"level {there[0]:g} at every pixel" if there.size else "no pixel with a height"
    raise stack_error(case, key, f"{found} in frame {t}", "heights of a surface", stack.file(t))


def _isolated(levels: FloatArray, limit: float) -> tuple[float | None, int]:
    """Return the smallest or largest level and its count, if it cannot belong to the others.

    Few pixels at the limit of their type are dust that is cut there.
    """
    step = 1.0 if np.isfinite(limit) else 0.0  # between two integers
    for extreme in (levels.min(initial=np.inf), levels.max(initial=-np.inf)):
        at = levels == extreme
        count, others = int(np.count_nonzero(at)), levels[~at]
        if count < _FEW or not others.size:
            continue
        apart = float(np.abs(others - extreme).min())
        if extreme != limit and apart > _RANGES * np.ptp(others) > 0:
            return float(extreme), count
        if count >= _SHARE * levels.size and apart > step:
            low, high = np.percentile(others, (5, 95))
            if apart > _SPREADS * (high - low) > 0:
                return float(extreme), count
    return None, 0


def _exact(level: float) -> str:
    """Return a number as a case states it, with all its digits."""
    return f"{level:g}" if float(f"{level:g}") == level else repr(level)


def spread(images: Images, levels: FloatArray) -> float:
    """Nine tenths of the heights lie within it [levels]."""
    low, high = np.percentile(levels[with_height(images, levels)], (5, 95))
    return float(high - low)


def refuse_other_lengths(case: Case, key: str, stack: Stack) -> None:
    """Hold the lengths that a file with heights states against those of the case.

    Raises:
        ExperimentError: its heights would be scaled, or its pixels are of another size.
    """
    for t, source in enumerate(stack.levels.sources):
        if not source.in_nm:
            continue
        if case.images.height_per_level_nm != LEVEL_NM:
            raise stack_error(
                case, key,
                f"heights in nanometres and height_per_level_nm = "
                f"{case.images.height_per_level_nm:g}",
                f"height_per_level_nm = {LEVEL_NM:g} for files that tell their heights",
                stack.file(t),
            )  # fmt: skip
        if source.pixel_nm is not None and _off(case, source.pixel_nm):
            mean = sum(source.pixel_nm) / 2
            raise stack_error(
                case, key, f"pixels of {mean:.6g} nm in the file",
                f"the {case.images.pixel_size_nm:g} of images.pixel_size_nm, to {_PIXEL_OFF:.0%}",
                stack.file(t),
            )  # fmt: skip


def _off(case: Case, sizes: tuple[float, float]) -> bool:
    return max(abs(size / case.images.pixel_size_nm - 1.0) for size in sizes) > _PIXEL_OFF


def remarks_on_copies(stack: Stack, copies: tuple[tuple[int, int], ...]) -> Iterator[str]:
    """Say which frames are copies of others, the first of them."""
    for frame, original in copies[:_TOLD]:
        yield sentence(
            stack.file(frame), "images.frames", f"every level of frame {original} in frame {frame}",
            "an image that was taken anew: its noise differs",
        )  # fmt: skip
    if len(copies) > _TOLD:
        yield f"images.frames: {len(copies) - _TOLD} more frames are copies of others"


def remarks_on_repeats(repeats: Stack, frames: Seen, loaded: BoolArray) -> Iterator[str]:
    """Say which repeats are copies of frames after the loading has begun, the first of them.

    Args:
        repeats: the repeats.
        frames: what a look at the frames has found.
        loaded: whether the stage has moved before each frame, shape (n_frames,).
    """
    same = {t: frames.first_of.get(_hash(repeats[t])) for t in range(len(repeats))}
    found = {t: frame for t, frame in same.items() if frame is not None and loaded[frame]}
    for t, frame in list(found.items())[:_TOLD]:
        yield sentence(
            repeats.file(t), "images.repeats",
            f"every level of frame {frame} of images.frames in repeat {t}",
            "images of the surface before it is loaded, which show its noise and where it began",
        )  # fmt: skip
    if len(found) > _TOLD:
        yield f"images.repeats: {len(found) - _TOLD} more repeats are frames of the test"


def remarks_on_pixels(case: Case, stacks: dict[str, Stack | None]) -> Iterator[str]:
    """Say where a file states another size of the pixels than the case.

    Args:
        case: the case.
        stacks: by the key of the images that names each.
    """
    stated = case.images.pixel_size_nm
    for key, stack in stacks.items():
        sizes = None if stack is None else stack.levels.sources[0].pixel_nm
        if stack is None or sizes is None:
            continue
        if _off(case, sizes):
            rows, columns = sizes
            found = f"pixels of {columns:.4g} nm" + (
                f" along its rows and {rows:.4g} nm along its columns"
                if abs(rows / columns - 1.0) > _PIXEL_OFF else ""
            )  # fmt: skip
            expected = f"the {stated:g} of images.pixel_size_nm, which are used"
            yield sentence(stack.file(0), f"images.{key}", f"{found} in the file", expected)
