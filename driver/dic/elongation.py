"""Motion of the two end edges, and what a translation of the stage does not touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from driver.dic.basis import Basis
from driver.dic.series import SurfaceMotion
from driver.dic.surface_images import SurfaceImages
from driver.experiment.images.heightmaps import ImageError
from meshes.arrays import BoolArray, FloatArray

SAMPLES = 64  # along each edge


@dataclass(frozen=True, eq=False)
class EdgeMotion:
    """Mean motion of the end edges Y = y_minus and Y = y_plus in T frames.

    Attributes:
        minus: mean u, v, w of the lower edge [µm], shape (T, 3).
        plus: the same of the upper edge, shape (T, 3).
        covariance_one: covariance of [minus | plus] from the noise of one frame [µm²],
            shape (6, 6).
        n_reference: number of images averaged into the reference.
        average: [minus | plus] of nodal values [u | v | w], shape (6, n).
    """

    minus: FloatArray
    plus: FloatArray
    covariance_one: FloatArray
    n_reference: int
    average: FloatArray

    def difference(self, component: int) -> FloatArray:
        """Return the weights of plus less minus of u, v or w (0, 1, 2), shape (n,)."""
        return np.asarray(self.average[3 + component] - self.average[component])

    @property
    def elongation(self) -> FloatArray:
        """v⁺ − v⁻ [µm], free of the stage's translation, shape (T,)."""
        return np.asarray(self.plus[:, 1] - self.minus[:, 1])

    @property
    def tilt(self) -> FloatArray:
        """w⁺ − w⁻ [µm], free of the stage's focus, shape (T,)."""
        return np.asarray(self.plus[:, 2] - self.minus[:, 2])

    @property
    def elongation_sigma(self) -> float:
        """Standard deviation of the elongation of a frame [µm], the reference's noise included."""
        difference = np.zeros(6)
        difference[[1, 4]] = -1.0, 1.0
        variance = difference @ self.covariance_one @ difference
        return float(np.sqrt(variance * (1.0 + 1.0 / self.n_reference)))


def edge_motion(
    motion: SurfaceMotion, images: SurfaceImages, y_minus: float, y_plus: float, band: float = 0.0
) -> EdgeMotion:
    """Average the measured motion along both end edges.

    Args:
        motion: measured motion.
        images: the images behind it.
        y_minus: Y of the lower edge [µm].
        y_plus: Y of the upper edge [µm].
        band: length along Y, inwards from each edge, of the strip that is averaged over [µm];
            0 for the line itself. A strip has less noise and, where the specimen strains,
            less elongation.

    Points that lie off a mesh are passed over: an edge of it need not be straight.

    Raises:
        ImageError: an edge lies outside the bounds of the bases.
    """
    x = np.linspace(images.xy[:, 0].min(), images.xy[:, 0].max(), SAMPLES)
    inwards = band * np.sign(y_plus - y_minus)
    means = []
    for y_edge, y_inner in ((y_minus, y_minus + inwards), (y_plus, y_plus - inwards)):
        y = np.linspace(y_edge, y_inner, SAMPLES if band else 1)
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        points = points[_on(motion.basis_uv, points) & _on(motion.basis_w, points)]
        if not len(points):
            raise ImageError(
                f"the meshes of correlation end before the edge Y = {y_edge:.4g} µm; meshes that "
                "reach it are expected."
            )
        uv, w = (basis.at(points).mean(axis=0) for basis in (motion.basis_uv, motion.basis_w))
        means.append(block_diag(uv, uv, w))
    average = np.vstack(means)
    edges = motion.coefficients @ average.T
    return EdgeMotion(
        minus=edges[:, :3],
        plus=edges[:, 3:],
        covariance_one=average @ motion.covariance_one @ average.T,
        n_reference=motion.n_reference,
        average=average,
    )


def _on(basis: Basis, points: FloatArray) -> BoolArray:
    return np.asarray(basis.mesh.locate(points)[0] >= 0)
