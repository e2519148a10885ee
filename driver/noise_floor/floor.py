"""The noise floor against mesh size, the mesh to take, and the noise that the repeats show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from driver.case.model import Case
from driver.dic.basis import grid_basis
from driver.dic.regularisation import Penalty
from driver.dic.resolution_check import refuse_too_fine
from driver.dic.series import Roughness, measure
from driver.dic.surface_images import SurfaceImages
from driver.experiment.images.heightmaps import ImageError
from driver.experiment.images.plane import plane_modes
from driver.experiment.reading import Experiment
from driver.forward.build import surface_images
from driver.noise_floor.laboratory import elongation
from driver.results.noise_floor import Row

LADDER = (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384)  # px
MESHES = 6
PAPER_GAMMA_U = 0.026  # µm; DIC uncertainty of the elongation of the reference experiment
_NEAR = 1.1  # of the least error of the elongation

RULE = (
    "of the meshes whose error of the elongation is within 10 % of the least, the one with the "
    "least error of ε_YY (bias and scatter together, root mean square over all motions)"
)


def sizes(images: SurfaceImages, ratio: float) -> tuple[int, ...]:
    """Return the smallest elements of u and v that pixels can decide and memory has room for [px].

    Args:
        images: the series.
        ratio: element of w over that of u and v.

    Raises:
        ImageError: there are too few pixels for any.
    """
    candidates: list[int] = []
    for size in LADDER:
        try:
            _refuse(images, size, ratio)
        except ImageError:
            continue
        candidates.append(size)
    if not candidates:
        _refuse(images, LADDER[-1], ratio)
    return tuple(candidates[:MESHES])


def _refuse(images: SurfaceImages, size: int, ratio: float) -> None:
    """Refuse elements of a size as a correlation would."""
    elements = size * images.pixel, ratio * size * images.pixel
    n_uv, n_w = (len(grid_basis(images.xy, images.bounds, s).nodes) for s in elements)
    refuse_too_fine(len(images.xy), n_uv, n_w)


def chosen(rows: Sequence[Row]) -> Row:
    """Return the mesh to take, by `RULE`."""
    least = min(row.errors.total("elongation") for row in rows)
    near = [row for row in rows if row.errors.total("elongation") <= _NEAR * least]
    return min(near, key=lambda row: row.errors.total("strain"))


def repeats_as_frames(case: Case, experiment: Experiment) -> SurfaceImages:
    """Return the repeats as a series of their own mean."""
    assert experiment.repeats is not None  # or there is no reference
    return surface_images(case, replace(experiment, frames=experiment.repeats))


def measured_gamma_u(
    repeats: SurfaceImages,
    length: float,
    size_uv: float,
    size_w: float,
    roughness: Roughness = None,
    penalty: Penalty | None = None,
) -> tuple[float, int]:
    """Return the standard deviation of the elongation of an image that the repeats show.

    Each of the n repeats is correlated with their mean. All share the noise of that mean, so
    their scatter is that of one image; a later image has, with the reference, √(1 + 1/n) times it.

    Args:
        repeats: the repeats as a series.
        length: of the specimen [µm].
        size_uv: element size of u and v [µm].
        size_w: element size of w [µm].
        roughness: as in `measure`.
        penalty: as in `measure`.

    Returns:
        [µm], and its degrees of freedom n − 1: it is known to a share of 1/√(2 (n − 1)).
    """
    motion = measure(repeats, size_uv, size_w, roughness, penalty=penalty)
    stretch, _ = elongation(motion, repeats, length)
    n = len(stretch)
    return float(stretch.std(ddof=1) * np.sqrt(1 + 1 / n)), n - 1


def relief_rms(images: SurfaceImages) -> float:
    """Rms of the heights of the reference about their best plane [µm]."""
    planes = plane_modes(images.rows.astype(np.float64), images.cols.astype(np.float64))
    heights = images.reference - planes @ (planes.T @ images.reference)
    return float(heights.std())
