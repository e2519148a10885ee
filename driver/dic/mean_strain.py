"""Mean strain of parts of the face in one image, by the motion that it has without a penalty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from driver.dic.basis import Basis
from driver.dic.system import sensitivity
from meshes.arrays import BoolArray, FloatArray, IntArray

_UNDECIDED = 1e-12  # of the largest variance: a smaller one of a combination is rounding


@dataclass(frozen=True, eq=False)
class MeanStrains:
    """Mean strain ε_XX, ε_YY, 2 ε_XY of k parts of the face in one image.

    Attributes:
        values: [1], shape (k, 3); NaN of a part without pixels, and where the image does not
            decide the motion.
        covariance: of the three of each part, by the noise of image and reference [1],
            shape (k, 3, 3).
    """

    values: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class ImageOfFace:
    """What correlation knows of one image at n_pix pixels.

    Attributes:
        xy: X, Y of the pixels [µm], shape (n_pix, 2).
        gradient: ∂f/∂X, ∂f/∂Y [1], shape (n_pix, 2).
        coefficients: measured nodal values [u | v | w] [µm], shape (n,).
        residual: ρ of that motion [µm], NaN where the image lacks a height, shape (n_pix,).
        variance: of the residual by noise [µm²], shape (n_pix,).
    """

    xy: FloatArray
    gradient: FloatArray
    coefficients: FloatArray
    residual: FloatArray
    variance: FloatArray


def mean_strains(
    image: ImageOfFace, basis_uv: Basis, basis_w: Basis, part: IntArray, n_parts: int
) -> MeanStrains:
    """Mean over the pixels of each part, free of what the penalty of u and v holds back.

    The measured motion p leaves the residual ρ; with J = ∇f·ψ over the pixels and their variances
    V the motion without a penalty is p + M⁻¹ Jᵀ V⁻¹ ρ, M = Jᵀ V⁻¹ J, of the covariance M⁻¹.
    A strain is a difference of u and v, which a translation of the stage does not touch; no
    rotation enters it.

    Args:
        image: the image.
        basis_uv: basis of u and of v.
        basis_w: basis of w.
        part: number of the part that each pixel belongs to, shape (n_pix,).
        n_parts: how many there are.
    """
    known = np.isfinite(image.residual)
    precision = diags_array(1.0 / image.variance[known])
    seen = sensitivity(image.gradient[known], basis_uv.at_pixels(known), basis_w.at_pixels(known))
    values = np.full((n_parts, 3), np.nan)
    covariance = np.full((n_parts, 3, 3), np.nan)
    present = np.unique(part)
    slopes = _slopes(basis_uv, image.xy)
    rows = np.concatenate([
        _strain(slopes, part == number, len(image.coefficients)) for number in present
    ])  # fmt: skip
    try:
        solved = splu(csc_array(seen.T @ precision @ seen)).solve(rows.T)
    except RuntimeError:  # a singular matrix: the pixels do not decide u and v
        return MeanStrains(values, covariance)
    change = solved.T @ (seen.T @ (precision @ image.residual[known]))
    values[present] = (rows @ image.coefficients + change).reshape(-1, 3)
    all_of_them = (rows @ solved).reshape(len(present), 3, len(present), 3)
    own = np.arange(len(present))
    covariance[present] = all_of_them[own, :, own, :]
    # A matrix that is singular but for rounding has a solution, with variances of either sign.
    for number in present:
        if not _is_decided(covariance[number]):
            values[number] = covariance[number] = np.nan
    return MeanStrains(values, covariance)


def _is_decided(covariance: FloatArray) -> bool:
    """Whether a matrix (3, 3) is the covariance of numbers that have been measured."""
    if not np.isfinite(covariance).all():
        return False
    variances = np.linalg.eigvalsh(covariance)
    return bool(variances[0] > _UNDECIDED * variances[-1])


def _slopes(basis: Basis, xy: FloatArray) -> tuple[csr_array, csr_array]:
    """Return ∂/∂X and ∂/∂Y of each function at the pixels [1/µm], each (n_pix, n_functions)."""
    mesh = basis.mesh
    cell, local = mesh.locate(xy)
    of_cells = mesh.gradients(cell, local)
    n, m = of_cells.shape[:2]
    place = mesh.cells[cell].ravel(), np.arange(0, m * n + 1, m)
    shape = n, len(mesh.points)
    along_x, along_y = (
        csr_array((of_cells[..., axis].ravel(), *place), shape=shape) for axis in (0, 1)
    )
    return along_x, along_y


def _strain(slopes: tuple[csr_array, csr_array], pixels: BoolArray, n: int) -> FloatArray:
    """Mean ε_XX, ε_YY, 2 ε_XY over some pixels as rows on [u | v | w], shape (3, n)."""
    along_x, along_y = (np.asarray(slope[pixels].mean(axis=0)).ravel() for slope in slopes)
    n_uv = along_x.size
    rows = np.zeros((3, n))
    rows[0, :n_uv] = along_x
    rows[1, n_uv : 2 * n_uv] = along_y
    rows[2, :n_uv], rows[2, n_uv : 2 * n_uv] = along_y, along_x
    return rows
