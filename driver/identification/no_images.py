"""The image part of a case without images: it has no pixels and no numbers."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from driver.common.splines.images import SplineImages
from driver.dic.surface_images import SurfaceImages
from driver.identification.image_data import ImageData
from meshes.arrays import FloatArray, IntArray


class NoImages(ImageData):
    """An image part that sees nothing, whatever moves."""

    def residual(
        self, motion: FloatArray, index: IntArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As `ImageData.residual`, without numbers."""
        nothing = np.zeros((len(index), 0))
        return nothing, nothing, nothing

    def sensitivity(
        self, d_surface: FloatArray, projection: sp.csr_array, index: IntArray
    ) -> FloatArray:
        """As `ImageData.sensitivity`, without numbers."""
        return np.zeros((*d_surface.shape[:2], 0))

    def pixel_sensitivity(self, d_motion: FloatArray, index: IntArray | None = None) -> FloatArray:
        """As `ImageData.pixel_sensitivity`, without numbers."""
        return np.zeros((*d_motion.shape[:-2], 0))


def no_images(n_loads: int) -> NoImages:
    """Return the image part beside so many loads."""
    none, nowhere = np.zeros(0), np.zeros((0, 2))
    no_index, no_codes = np.zeros(0, dtype=np.int64), np.zeros((0, 0), dtype=np.uint8)
    images = SurfaceImages(
        xy=nowhere, rows=no_index, cols=no_index, reference=none, gradient=nowhere,
        frames=SplineImages(np.zeros((n_loads, 0, 0)), 1.0, (0.0, 0.0)),
        sigma=1.0, n_reference=1, shape=(0, 0), pixel=1.0, bounds=(0.0, 0.0, 0.0, 0.0),
        reference_image=np.zeros((0, 0)), noise_dof=0, sigma_flat=0.0, codes=no_codes,
        flat_error=np.zeros((0, 0)), flat_pattern=None, flat_noise=np.zeros((0, 0)),
    )  # fmt: skip
    return NoImages(
        images,
        test=sp.csr_array((0, 0)),
        rigid=np.zeros((0, 0, 3)),
        mean_motion=np.zeros((n_loads, 3)),
        whiten=np.zeros((0, 0)),
        shared=np.zeros((n_loads, n_loads)),
    )
