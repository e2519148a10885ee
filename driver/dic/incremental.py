"""Correlation of each image with the one before, its motion composed onto the reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from driver.common.element_sizes import ELEMENT_UV, ELEMENT_W
from driver.common.splines.kernels import coefficients
from driver.dic.basis import Basis, motion_at_pixels
from driver.dic.correlation import Correlation, Options, checked, correlate, region_and_bases
from driver.dic.kernels import spread
from driver.dic.system import sensitivity
from driver.experiment.images.heightmaps import ImageError
from meshes.arrays import BoolArray, FloatArray
from meshes.plane_mesh import PlaneMesh


@dataclass(frozen=True, eq=False)
class IncrementalCorrelation:
    """Motion in T images, each measured against the one before and added up at the nodes.

    The meshes are carried along: their nodes stay at the same points of the surface, so that
    the nodal values of the steps add up as they are.

    Attributes:
        steps: the correlation of each image with the one before, length T.
        coefficients: nodal values [u | v | w] against the reference, shape (T, n).
        basis_uv: basis of u and of v at the pixels of the reference.
        basis_w: basis of w there.
        n_reference: number of images averaged into the reference.
    """

    steps: tuple[Correlation, ...]
    coefficients: FloatArray
    basis_uv: Basis
    basis_w: Basis
    n_reference: int

    @property
    def sigma(self) -> FloatArray:
        """Noise of one image as each step has it; a changing pattern counts, shape (T,)."""
        return np.array([step.sigma for step in self.steps])

    @property
    def converged(self) -> BoolArray:
        """Whether the step to each image and all before it did, shape (T,)."""
        return np.logical_and.accumulate([bool(step.converged[0]) for step in self.steps])

    def at_pixels(self, t: int = -1) -> FloatArray:
        """u, v, w of image t at the pixels of the reference, shape (n_pix, 3)."""
        p = self.coefficients[t][None]
        return np.asarray(motion_at_pixels(self.basis_uv, self.basis_w, p)[0])

    def sigma_of(self, functionals: FloatArray, t: int = -1) -> FloatArray:
        """Return the standard deviation by noise of functionals of [u | v | w] of an image, (m,).

        Image k is the end of step k and the reference of step k + 1. With q_k = J_k A_k⁻¹ Lᵀ, the
        weights of its residual in L p, its noise enters by q_{k+1} at its pixels less q_k
        where step k has read it between them: while the pattern stays, the two nearly
        cancel, and what is left of the images between is their interpolation.

        Args:
            functionals: L, shape (m, n).
            t: image.
        """
        steps = self.steps[: range(len(self.steps))[t] + 1]
        return np.sqrt([self._variance(steps, row) for row in np.atleast_2d(functionals)])

    def _variance(self, steps: Sequence[Correlation], functional: FloatArray) -> float:
        total, before = 0.0, np.zeros(steps[0].shape)
        for k, step in enumerate(steps):
            at = step.system.pixels
            seen = sensitivity(at.slope, step.basis_uv, step.basis_w)
            weights = (seen @ step.system.solve(functional)) * step.compared[0]
            before[at.rows.astype(int), at.cols.astype(int)] += weights
            shared = self.n_reference if k == 0 else 1
            sigma = step.sigma if k == 0 else 0.5 * (step.sigma + steps[k - 1].sigma)
            total += sigma**2 / shared * float(np.sum(before**2))
            moved = np.column_stack([at.rows, at.cols]) + step.at_pixels()[:, :2] / at.pixel
            before = -coefficients(spread(moved, weights, step.shape))
        return total + steps[-1].sigma ** 2 * float(np.sum(before**2))


def correlate_incrementally(
    reference: NDArray[Any],
    images: NDArray[Any] | Sequence[NDArray[Any]],
    pixel: float = 1.0,
    mask: NDArray[Any] | None = None,
    mesh_uv: PlaneMesh | float = ELEMENT_UV,
    mesh_w: PlaneMesh | float = ELEMENT_W,
    sigma: float | None = None,
    n_reference: int = 1,
    options: Options | None = None,
) -> IncrementalCorrelation:
    """Find the motion of every image by way of those before it, for a pattern that changes.

    `correlate` of each image with the one before. A pattern that stays is better held against the
    reference itself: an image that is lost loses all that follow, and what is no noise adds up.
    By how much a pattern that changes pulls in each step is in no standard deviation.

    Args:
        reference: as of `correlate`.
        images: as of `correlate`, in their order.
        pixel: as of `correlate`.
        mask: as of `correlate`; it is carried along.
        mesh_uv: as of `correlate`.
        mesh_w: as of `correlate`.
        sigma: as of `correlate`; estimated in each step if None.
        n_reference: as of `correlate`.
        options: as of `correlate`.

    Raises:
        ImageError: as of `correlate`, or a step folds a cell or moves the surface out of the image.
    """
    f, stack = checked(reference, images, pixel, sigma, n_reference)
    region, basis_uv, basis_w = region_and_bases(f, mask, pixel, mesh_uv, mesh_w)
    try:
        at_w = basis_uv.at(basis_w.nodes)
    except ValueError:
        raise ImageError(
            "mesh_w has nodes outside mesh_uv; one within it is expected, for it is carried along."
        ) from None
    n = len(basis_uv.nodes)
    total = np.zeros(2 * n + len(basis_w.nodes))
    steps, sums, before = list[Correlation](), list[FloatArray](), f
    for t, image in enumerate(stack):
        uv = _moved(basis_uv.mesh, np.column_stack([total[:n], total[n : 2 * n]]))
        w = _moved(basis_w.mesh, at_w @ np.column_stack([total[:n], total[n : 2 * n]]))
        seen = region if t == 0 else _carried(region, basis_uv.mesh, uv, pixel)
        try:
            step = correlate(
                before, image, pixel, seen, uv, w, sigma, n_reference if t == 0 else 1, options
            )
        except (ImageError, ValueError) as error:
            raise ImageError(f"image {t} against the one before: {error}") from None
        total = total + step.coefficients[0]
        steps.append(step)
        sums.append(total)
        before = image
    return IncrementalCorrelation(tuple(steps), np.array(sums), basis_uv, basis_w, n_reference)


def _moved(mesh: PlaneMesh, motion: FloatArray) -> PlaneMesh:
    return replace(mesh, points=mesh.points + motion)


def _carried(region: BoolArray, start: PlaneMesh, now: PlaneMesh, pixel: float) -> BoolArray:
    """Pixels at which points of a region have arrived, by the mesh that is carried along."""
    places = np.argwhere(np.ones(region.shape, dtype=bool))
    cell, local = now.locate(places * np.float64(pixel))
    inside = cell >= 0
    came = start.interpolation(cell[inside], local[inside]) @ start.points / pixel
    rows, cols = np.clip(np.rint(came).astype(np.int64), 0, np.array(region.shape) - 1).T
    carried = np.zeros(region.shape, dtype=bool)
    carried[tuple(places[inside].T)] = region[rows, cols]
    return carried
