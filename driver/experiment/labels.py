"""The grains of a label image or an EBSD map, as columns below the measured face."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from driver.case.images import Images
from driver.case.model import Case
from driver.common.errors import InputError, sentence
from driver.common.formatting import joined
from driver.experiment.images.heightmaps import load_stack
from driver.experiment.map_labels import MapOnFace, labels_of_map, map_on_face
from driver.experiment.reading import arrange, origin
from meshes.arrays import FloatArray, IntArray
from meshes.columnar import Columns, columns_of

_KEY = "specimen.labels"
_SEVERAL = 8  # labels that are told


def columns_of_case(case: Case) -> Columns | None:
    """Return the grains of the label image or the map of a case, None of a case without.

    Raises:
        InputError: it cannot be read, does not cover the face, or has other grains than there are
            tables of them.
    """
    specimen = case.specimen
    if specimen.labels is None:
        return None
    path = case.path(specimen.labels)
    if case.labelled_by_map:
        return _columns_of_map(map_on_face(case))
    try:
        state = path.stat().st_mtime_ns
    except OSError:
        state = 0
    return _columns_of_image(
        path, state, case.images, specimen.labels_pixel_nm, specimen.width, specimen.length,
        len(case.grains),
    )  # fmt: skip


@lru_cache(maxsize=2)
def _columns_of_image(
    path: Path,
    changed: int,
    images: Images,
    pixel_nm: float | None,
    width: float,
    length: float,
    n_grains: int,
) -> Columns:
    stack = load_stack(path, _KEY)
    if len(stack) != 1:
        raise InputError(sentence(path, _KEY, f"{len(stack)} images", "one, of labels"))
    labels = arrange(images, stack[0][None])[0]
    # An image of other pixels shows the same field.
    finer = images.pixel_size_nm / (pixel_nm or images.pixel_size_nm)
    pixel = images.pixel_um / finer
    field = (round(stack.shape[0] / finer), round(stack.shape[1] / finer))
    row, column = (finer * (at + 0.5) - 0.5 for at in origin(images, field))
    squares = max(1, round(width / pixel)), max(1, round(length / pixel))
    x = (np.arange(squares[0]) + 0.5) * width / squares[0] - width / 2
    y = (np.arange(squares[1]) + 0.5) * length / squares[1]
    rows, columns = _nearest(x / pixel + row), _nearest(y / pixel + column)
    for name, at, size in (("X", rows, labels.shape[0]), ("Y", columns, labels.shape[1])):
        # Half a pixel of the rim may lie beyond.
        if at.min() < -1 or at.max() > size:
            found = f"pixels {at.min()} to {at.max()} of the face along {name}"
            raise InputError(sentence(path, _KEY, found, f"all within 0 to {size - 1}"))
    seen = labels[np.ix_(np.clip(rows, 0, labels.shape[0] - 1),
                         np.clip(columns, 0, labels.shape[1] - 1))]  # fmt: skip
    return _columns_below(path, seen, width, length, n_grains)


@lru_cache(maxsize=2)
def _columns_of_map(on_face: MapOnFace) -> Columns:
    seen, n_grains = labels_of_map(on_face), len(on_face.picks)
    return _columns_below(on_face.file, seen, on_face.width, on_face.length, n_grains)


def _columns_below(
    path: Path, seen: FloatArray | IntArray, width: float, length: float, n_grains: int
) -> Columns:
    """Return the columns below the labels of the face, rows along X, columns along Y."""
    there = np.unique(seen[seen != 0])
    if not np.array_equal(there, np.arange(1, n_grains + 1)):
        numbers = [f"{one:g}" for one in there[:_SEVERAL]]
        more = f" and {len(there) - _SEVERAL} more" if len(there) > _SEVERAL else ""
        found = f"the labels {joined(numbers) if numbers else '0 alone'}{more} on the face"
        expected = f"1 to {n_grains}, as there are tables [[grains]], and 0 where it is not known"
        raise InputError(sentence(path, _KEY, found, expected))
    try:
        return columns_of(seen.astype(np.int64) - 1, width, length)
    except ValueError as error:
        raise InputError(f"{path}: {_KEY}: {error}") from None


def _nearest(at: FloatArray) -> IntArray:
    """Return the nearest pixels, the same way everywhere half way between two."""
    return np.floor(at + 0.5).astype(np.int64)
