"""Series of the user's own reference in known motions, and the errors of correlation on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from driver.dic.basis import Basis
from driver.dic.elongation import edge_motion
from driver.dic.regularisation import Penalty
from driver.dic.series import Roughness, SurfaceMotion, measure
from driver.dic.surface_images import SurfaceImages, prepare
from driver.noise_floor.motions import KnownMotion
from driver.noise_floor.quiet import without_noise
from driver.results.noise_floor import QUANTITIES, Errors
from driver.virtual.microscope.series import carried
from driver.virtual.microscope.texture import Texture, texture
from meshes.arrays import FloatArray

SERIES, DRAWS = 4, 2  # series with a reference of their own; images of each motion in a series
_MARGIN = 32  # px of the reference around the region of interest that are kept
_GAUGE = 0.5  # px; half the length over which the strain at a pixel is taken
_EDGE = 64  # points along an end edge


@dataclass(frozen=True, eq=False)
class Laboratory:
    """The clean images, the same for all meshes.

    Attributes:
        relief: the mean of the repeats without its noise, as a function of position.
        region: region of interest, shape (rows, columns).
        clean: an image of each motion [µm], shape (n_motions, rows, columns).
        motions: what moved them.
        truth: u, v, w and ε_YY at the pixels, shape (n_motions, n_pix, 4).
        elongation: of the specimen [µm], shape (n_motions,).
        length: of the specimen [µm].
        bounds: rectangle (x0, x1, y0, y1) of the correlation [µm].
        sigma: noise of an image [µm].
        n_reference: images averaged into a reference.
    """

    relief: Texture
    region: NDArray[np.bool_]
    clean: FloatArray
    motions: tuple[KnownMotion, ...]
    truth: FloatArray
    elongation: FloatArray
    length: float
    bounds: tuple[float, float, float, float]
    sigma: float
    n_reference: int

    def series(self, number: int) -> SurfaceImages:
        """One series with noise of its own in repeats and images, the same for all meshes."""
        rng = np.random.default_rng(number)
        still = np.repeat(self.relief.heights[None], self.n_reference, axis=0)
        moved = np.repeat(self.clean, DRAWS, axis=0)
        return prepare(
            moved + self.sigma * rng.normal(size=moved.shape),
            still + self.sigma * rng.normal(size=still.shape),
            None,
            self.relief.pixel,
            self.relief.origin,
            self.bounds,
            self.region,
        )


def laboratory(images: SurfaceImages, motions: Sequence[KnownMotion], length: float) -> Laboratory:
    """Move the reference of a series.

    Args:
        images: the user's images.
        motions: how to move it.
        length: of the specimen [µm], from Y = 0.
    """
    low = np.maximum([images.rows.min() - _MARGIN, images.cols.min() - _MARGIN], 0)
    high = np.minimum(
        [images.rows.max() + _MARGIN, images.cols.max() + _MARGIN], np.array(images.shape) - 1
    )
    window = np.s_[low[0] : high[0] + 1, low[1] : high[1] + 1]
    row, column = images.frames.origin
    origin = (float(row - low[0]), float(column - low[1]))
    used = np.s_[
        images.rows.min() - low[0] : images.rows.max() - low[0] + 1,
        images.cols.min() - low[1] : images.cols.max() - low[1] + 1,
    ]
    quiet = without_noise(images.reference_image[window], used, images.sigma, images.n_reference)
    relief = texture(quiet, images.pixel, origin)
    region = np.zeros(images.shape, dtype=bool)
    region[images.rows, images.cols] = True
    rows, columns = relief.heights.shape
    x, y = np.meshgrid(
        (np.arange(rows) - origin[0]) * images.pixel,
        (np.arange(columns) - origin[1]) * images.pixel,
        indexing="ij",
    )
    truth, elongation = [], []
    for motion in motions:
        value, slopes = motion(images.xy[:, 0], images.xy[:, 1])
        truth.append(np.column_stack([value, slopes[:, 1, 1]]))
        across = np.linspace(*images.bounds[:2], _EDGE)
        ends = [motion(across, np.full(_EDGE, end))[0][:, 1].mean() for end in (0.0, length)]
        elongation.append(ends[1] - ends[0])
    return Laboratory(
        relief=relief,
        region=region[window],
        clean=np.array([carried(relief, motion)(x, y) for motion in motions]),
        motions=tuple(motions),
        truth=np.array(truth),
        elongation=np.array(elongation),
        length=length,
        bounds=images.bounds,
        sigma=images.sigma,
        n_reference=images.n_reference,
    )


def errors(
    lab: Laboratory,
    size_uv: float,
    size_w: float,
    done: Callable[[], None] = lambda: None,
    roughness: Roughness = None,
    penalty: Penalty | None = None,
) -> Errors:
    """Correlate all series with one mesh.

    With e_k the errors of n draws of one motion, the scatter is their standard deviation s and the
    bias² is ē² − s²/n, which has no share of noise on average, or 0.

    Args:
        lab: the laboratory.
        size_uv: element size of u and v [µm].
        size_w: element size of w [µm].
        done: called after each series.
        roughness: as in `measure`.
        penalty: as in `measure`.
    """
    deviations: dict[str, list[FloatArray]] = {quantity: [] for quantity in QUANTITIES}
    predicted, converged = [], []
    for number in range(SERIES):
        images = lab.series(number)
        motion = measure(images, size_uv, size_w, roughness, penalty=penalty)
        fields = np.concatenate([motion.at_pixels(), strain_yy(motion, images)[..., None]], axis=2)
        wrong = fields - np.repeat(lab.truth, DRAWS, axis=0)
        for index, quantity in enumerate(QUANTITIES[:4]):
            deviations[quantity].append(wrong[..., index].reshape(len(lab.motions), DRAWS, -1))
        stretch, sigma = elongation(motion, images, lab.length)
        deviations["elongation"].append(
            stretch.reshape(-1, DRAWS, 1) - lab.elongation[:, None, None]
        )
        predicted.append(sigma)
        converged.append(motion.converged.mean())
        done()
    bias, scatter = {}, {}
    for quantity, series in deviations.items():
        draws = np.concatenate(series, axis=1)
        variance = draws.var(axis=1, ddof=1)
        square = np.mean(draws.mean(axis=1) ** 2 - variance / draws.shape[1], axis=1)
        bias[quantity] = np.sqrt(np.maximum(square, 0.0))
        scatter[quantity] = np.sqrt(variance.mean(axis=1))
    return Errors(bias, scatter, float(np.mean(predicted)), float(np.mean(converged)))


def elongation(
    motion: SurfaceMotion, images: SurfaceImages, length: float
) -> tuple[FloatArray, float]:
    """Elongation of the specimen in each image and its standard deviation [µm], as `measure.h5`."""
    lower, upper = images.bounds[2:]
    edges, reach = edge_motion(motion, images, lower, upper), length / (upper - lower)
    return reach * edges.elongation, reach * edges.elongation_sigma


def strain_yy(motion: SurfaceMotion, images: SurfaceImages) -> FloatArray:
    """ε_YY of the measured motion over a pixel about each pixel [-], shape (T, n_pix)."""
    basis: Basis = motion.basis_uv
    n, reach = len(basis.nodes), _GAUGE * images.pixel
    lower, upper = images.bounds[2:]
    ahead, behind = images.xy.copy(), images.xy.copy()
    ahead[:, 1] = np.minimum(ahead[:, 1] + reach, upper)
    behind[:, 1] = np.maximum(behind[:, 1] - reach, lower)
    v = motion.coefficients[:, n : 2 * n].T
    change = basis.at(ahead) @ v - basis.at(behind) @ v
    return np.asarray((change / (ahead - behind)[:, 1:]).T)
