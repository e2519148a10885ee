"""The image part of the residual: what the functions of the correlation mesh make of it.

With ρ = f + w − g(x + u) of a predicted motion, b_j = Σ_pixels (∇f·ψ_j) ρ. Its noise covariance is
σ² M, M_jk = Σ (∇f·ψ_j)(∇f·ψ_k). The stage re-centres between images: what a rigid motion explains
is projected out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.sparse as sp

from driver.dic.basis import Basis
from driver.dic.surface_images import SurfaceImages
from driver.identification.reference_noise import reference_noise
from meshes.arrays import BoolArray, FloatArray, IntArray

Gauge = Literal["translation", "rigid"]
_SHIFT_ITERATIONS = 3
# Modes of M this much weaker than the strongest carry no information.
_WEAKEST_MODE = 1e-9


@dataclass(frozen=True, eq=False)
class ImageData:
    """The image part of the residual.

    Attributes:
        images: the corrected series with its low-noise gradient.
        test: ∇f·ψ_j at the pixels, shape (n_pix, n_functions).
        rigid: motion of unit rigid motions at the pixels, shape (n_rigid, n_pix, 3).
        mean_motion: mean motion of free correlation, by which the frames are found [µm],
            shape (T, 3).
        whiten: what turns b into independent unit numbers, rigid motions projected out,
            shape (n_z, n_functions).
        shared: covariance between the frames beside their own noise, in units of its variance,
            shape (T, T).
        noise_factor: estimated noise over the noise of the repeats.
        variance: of the noise at each pixel over its mean, shape (n_pix,), None where it is even.
        lacking: which pixels say nothing in which frame, shape (T, n_pix), None where all say
            something, see `lacking_pixels`.
    """

    images: SurfaceImages
    test: sp.csr_array
    rigid: FloatArray
    mean_motion: FloatArray
    whiten: FloatArray
    shared: FloatArray
    noise_factor: float = 1.0
    variance: FloatArray | None = None
    lacking: BoolArray | None = None

    @property
    def n_z(self) -> int:
        """Whitened numbers of one image."""
        return int(self.whiten.shape[0])

    def residual(
        self, motion: FloatArray, index: IntArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Whitened residual of a predicted motion.

        Args:
            motion: u, v, w at the pixels [µm] of the frames in `index`, (T, n_pix, 3).
            index: the frames, shape (T,).

        Returns:
            z (T, n_z) without the correlation in time; the rigid motion that each frame needed
            (T, n_rigid) [µm]; ρ after it (T, n_pix) [µm].
        """
        seen, inverse = self._rigid_slope, self._inverse(index)
        # The stage re-centres by pixels: start where free correlation found each frame.
        shift = np.zeros((len(index), len(self.rigid)))
        shift[:, :3] = self.mean_motion[index] - motion.mean(axis=1)
        for _ in range(_SHIFT_ITERATIONS):
            moved = motion + np.einsum("tr,rpc->tpc", shift, self.rigid)
            rho = self._without(np.nan_to_num(self.images.residual(moved, index)), index)
            step = np.einsum("tr,trq->tq", rho @ seen, inverse)
            shift += step
        # The last, small step to first order.
        rho = self._without(rho - step @ seen.T, index)
        z = (rho @ self.test) @ self.whiten.T / self.noise_factor
        return np.asarray(z), shift, rho

    def sensitivity(
        self, d_surface: FloatArray, projection: sp.csr_array, index: IntArray
    ) -> FloatArray:
        """Whitened effect of surface-node motions.

        Args:
            d_surface: motions in the frames of `index`, shape (k, T, n, 3).
            projection: surface nodes → pixels, shape (n_pix, n).
            index: the frames, shape (T,).

        Returns:
            Shape (k, T, n_z).
        """
        k, T, n, _ = d_surface.shape
        flat = d_surface.reshape(k, T, 3 * n)
        surface = _by_component(self.test.T, self.slope, projection)
        z = flat @ (self.whiten @ surface).T
        lacking = self._gone(index)
        if lacking:
            rigid = _by_component(self._rigid_slope.T, self.slope, projection)
        for t, gone in lacking:
            # What a frame does not have says nothing, and its rigid motion is that of the rest.
            of_gone = projection[gone].toarray()[:, :, None] * self.slope[gone][:, None, :]
            absent = of_gone.reshape(gone.size, 3 * n)
            tested = surface - self.test[gone].T @ absent
            moved = rigid - self._rigid_slope[gone].T @ absent
            tested -= self._tested_rigid(gone) @ np.linalg.solve(self._normal(gone), moved)
            z[:, t] = flat[:, t] @ (self.whiten @ tested).T
        return np.asarray(z / self.noise_factor)

    def pixel_sensitivity(self, d_motion: FloatArray, index: IntArray | None = None) -> FloatArray:
        """Whitened effect of motions at the pixels, (..., n_pix, 3) → (..., n_z).

        Args:
            d_motion: the motions.
            index: the frames that they belong to, shape (T,), if they are motions (T, n_pix, 3);
                None for such as are of no frame.
        """
        seen = np.einsum("...pc,pc->...p", d_motion, self.slope)
        if index is not None:
            for t, gone in self._gone(index):
                seen[t, gone] = 0.0
                step = np.linalg.solve(self._normal(gone), self._rigid_slope.T @ seen[t])
                seen[t] -= self._rigid_slope @ step
                seen[t, gone] = 0.0
        flat = seen.reshape(-1, seen.shape[-1]) @ self.test @ self.whiten.T / self.noise_factor
        return np.asarray(flat.reshape(*seen.shape[:-1], self.n_z))

    @cached_property
    def _rigid_slope(self) -> FloatArray:
        """What unit rigid motions do to ρ, shape (n_pix, n_rigid)."""
        return np.asarray(np.einsum("rpc,pc->pr", self.rigid, self.slope))

    def _normal(self, gone: IntArray) -> FloatArray:
        """Return the normal matrix of rigid motions without some pixels, (n_rigid, n_rigid)."""
        seen, absent = self._rigid_slope, self._rigid_slope[gone]
        return np.asarray(seen.T @ seen - absent.T @ absent)

    def _tested_rigid(self, gone: IntArray) -> FloatArray:
        """B of unit rigid motions without some pixels, shape (n_functions, n_rigid)."""
        seen = self._rigid_slope
        return np.asarray(self.test.T @ seen - self.test[gone].T @ seen[gone])

    def _inverse(self, index: IntArray) -> FloatArray:
        """Inverse normal matrices of frames, shape (T, n_rigid, n_rigid)."""
        whole = np.linalg.inv(self._normal(np.zeros(0, dtype=np.int64)))
        inverse = np.repeat(whole[None], len(index), axis=0)
        for t, gone in self._gone(index):
            inverse[t] = np.linalg.inv(self._normal(gone))
        return inverse

    def _without(self, rho: FloatArray, index: IntArray) -> FloatArray:
        """ρ with 0 where a frame lacks the pixel, shape (T, n_pix)."""
        return rho if self.lacking is None else np.where(self.lacking[index], 0.0, rho)

    def _gone(self, index: IntArray) -> list[tuple[int, IntArray]]:
        """Return the frames that lack pixels: their places in `index`, and which they lack."""
        if self.lacking is None:
            return []
        places = np.flatnonzero(self.lacking[index].any(axis=1))
        return [(int(t), np.flatnonzero(self.lacking[index[t]])) for t in places]

    @property
    def slope(self) -> FloatArray:
        """(∂f/∂x, ∂f/∂y, −1) at the pixels, shape (n_pix, 3)."""
        return np.concatenate([self.images.gradient, -np.ones((len(self.images.xy), 1))], axis=1)


def build_image_data(
    images: SurfaceImages,
    basis_uv: Basis,
    basis_w: Basis,
    mean_motion: FloatArray,
    gauge: Gauge,
    places: FloatArray,
    lacking: BoolArray | None = None,
) -> ImageData:
    """Prepare test functions and whitening.

    Args:
        images: the series, gradient refined.
        basis_uv: functions of u and v at the pixels.
        basis_w: functions of w at the pixels.
        mean_motion: mean motion of free correlation in each frame [µm], shape (T, 3).
        gauge: "translation" removes the mean motion of each image, "rigid" rotations too.
        places: displacement of some places of the specimen in the frames [µm], shape (T, p, 2).
        lacking: as in `ImageData`.
    """
    fx, fy = images.gradient.T
    test = sp.hstack(
        [
            sp.diags_array(fx) @ basis_uv.values,
            sp.diags_array(fy) @ basis_uv.values,
            -1.0 * basis_w.values,
        ]
    ).tocsr()
    rigid = _rigid_motions(images.xy, gauge)
    whiten = _whitening(images, test, (test.T @ test).toarray(), rigid)
    shared = reference_noise(images, test, whiten, places)
    return ImageData(images, test, rigid, mean_motion, whiten, shared, lacking=lacking)


def _by_component(
    rows: sp.csr_array | FloatArray, slope: FloatArray, projection: sp.csr_array
) -> FloatArray:
    """Rows over the pixels of what surface-node motions do to ρ, shape (n_rows, 3 n)."""
    effect = [rows @ (sp.diags_array(along) @ projection) for along in slope.T]
    dense = [block.toarray() if sp.issparse(block) else block for block in effect]
    return np.stack(dense, axis=2).reshape(dense[0].shape[0], -1)


def reweighted(image: ImageData, variance: FloatArray) -> ImageData:
    """Return the image part with each pixel counted by the inverse of its own variance.

    Args:
        image: the image part with all pixels alike.
        variance: of the noise at each pixel, on any scale, shape (n_pix,).
    """
    variance = variance / variance.mean()
    test = sp.csr_array(sp.diags_array(1.0 / variance) @ image.test)
    matrix = (image.test.T @ test).toarray()
    whiten = _whitening(image.images, test, matrix, image.rigid)
    return replace(image, test=test, whiten=whiten, variance=variance)


def _whitening(
    images: SurfaceImages, test: sp.csr_array, matrix: FloatArray, rigid: FloatArray
) -> FloatArray:
    """Return what whitens b of covariance σ² `matrix`, rigid motions projected out."""
    slope = np.concatenate([images.gradient, -np.ones((len(images.xy), 1))], axis=1)
    eigenvalue, vector = np.linalg.eigh(matrix)
    kept = eigenvalue > _WEAKEST_MODE * eigenvalue[-1]
    root = (vector[:, kept] / np.sqrt(eigenvalue[kept])).T / images.sigma
    seen = root @ (test.T @ np.einsum("rpc,pc->pr", rigid, slope))
    left = np.linalg.svd(seen, full_matrices=True)[0]
    return np.asarray(left[:, seen.shape[1] :].T @ root)


def _rigid_motions(xy: FloatArray, gauge: Gauge) -> FloatArray:
    unit = np.broadcast_to(np.eye(3)[:, None, :], (3, len(xy), 3))
    if gauge == "translation":
        return np.array(unit)
    x, y = (xy - xy.mean(axis=0)).T
    turns = np.zeros((3, len(xy), 3))
    turns[0, :, 0], turns[0, :, 1] = -y, x
    turns[1, :, 2], turns[2, :, 2] = x, y
    return np.concatenate([unit, turns])
