"""Slip of each grain as the images alone tell it, without a law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from driver.case.model import Case
from driver.dic.basis import basis_on
from driver.dic.mean_strain import ImageOfFace, MeanStrains, mean_strains
from driver.experiment.orientations import orientations_of
from driver.forward.build import correlation_meshes
from driver.identification.data import Data
from driver.identification.least_slip import LeastSlip, least_slip
from driver.identification.problem import IdentificationProblem
from meshes.arrays import FloatArray
from meshes.surface_grains import grains_at
from solver_adapters.constants import elastic_constants
from solver_adapters.crystal import schmid_tensors, system_count
from solver_adapters.material import Material

_PARTS = ((0, 0), (1, 1), (0, 1))  # of a strain, as they are measured; the last one twice


@dataclass(frozen=True, eq=False)
class MeasuredSlip:
    """Slips of the systems since the reference, by the mean strain of each grain on the face.

    NaN of a grain that does not reach the face, and where the image does not decide its strain.

    Attributes:
        image: its number.
        strain: ε_XX, ε_YY, 2 ε_XY of each grain [1], shape (n_grains, 3).
        strain_sigma: their standard deviations [1], shape (n_grains, 3).
        elastic: the elastic part, which is subtracted [1], shape (n_grains, 3).
        slip: of each system, with its sign [1], shape (n_grains, n).
        sigma: its standard deviation [1], shape (n_grains, n).
        without: growth of the sum where a system may not slip, as in `LeastSlip` [1],
            shape (n_grains, n).
        total: sum of |slip|, its standard deviation and its noise floor [1], shape (n_grains, 3).
    """

    image: int
    strain: FloatArray
    strain_sigma: FloatArray
    elastic: FloatArray
    slip: FloatArray
    sigma: FloatArray
    without: FloatArray
    total: FloatArray


def slip_of_images(
    case: Case,
    problem: IdentificationProblem,
    data: Data,
    coefficients: FloatArray,
    residual: FloatArray,
) -> MeasuredSlip:
    """Return the measured slip at the last image that is fitted.

    Args:
        case: the case, whose orientations and elastic constants are taken.
        problem: the experiment, and the mesh with its grains.
        data: images in use, with the noise that the identification found.
        coefficients: nodal values of free correlation [µm], shape (T, n).
        residual: ρ of free correlation [µm], NaN where an image lacks a height, (T, n_pix).
    """
    image, images = data.image, data.image.images
    last = int(data.index[data.with_image][-1])
    uv, w = (basis_on(images.xy, images.bounds, mesh) for mesh in correlation_meshes(case))
    variance = (images.sigma * image.noise_factor) ** 2 * (1.0 + 1.0 / images.n_reference)
    left = residual[last].astype(np.float64)
    if image.lacking is not None:
        left[image.lacking[last]] = np.nan
    each = np.ones(left.size) if image.variance is None else image.variance
    face = ImageOfFace(images.xy, images.gradient, coefficients[last], left, variance * each)
    mesh = problem.working.microstructure.mesh
    strains = mean_strains(face, uv, w, grains_at(mesh, images.xy), mesh.n_grains)
    stress = float(problem.experiment.force[last]) / case.section
    return measured_slip(last, strains, orientations_of(case), case.material.to_material(), stress)


def measured_slip(
    image: int, strains: MeanStrains, orientations: FloatArray, material: Material, stress: float
) -> MeasuredSlip:
    """Return the smallest slips that make the measured strains.

    Args:
        image: number of the image.
        strains: mean strains of the grains on the face.
        orientations: crystal → specimen, shape (n_grains, 3, 3).
        material: slip systems and elastic constants.
        stress: of tension along Y, mean over the section [MPa].
    """
    n_systems, width = len(material.slip_systems), system_count(material.slip_systems)
    elastic = np.array([elastic_strain(turn, material, stress) for turn in orientations])
    slip, sigma, without = (np.full((len(elastic), width), np.nan) for _ in range(3))
    total = np.full((len(elastic), 3), np.nan)
    for grain in np.flatnonzero(np.isfinite(strains.values).all(axis=1)):
        columns = strains_of_slip(orientations[grain], material)[:, :n_systems]
        rest = strains.values[grain] - elastic[grain]
        found: LeastSlip = least_slip(columns, rest, strains.covariance[grain])
        slip[grain], sigma[grain] = 0.0, 0.0
        slip[grain, :n_systems], sigma[grain, :n_systems] = found.slip, found.sigma
        without[grain, :n_systems] = found.without
        total[grain] = found.total, found.total_sigma, found.floor
    deviation = np.sqrt(np.diagonal(strains.covariance, axis1=1, axis2=2))
    return MeasuredSlip(image, strains.values, deviation, elastic, slip, sigma, without, total)


def strains_of_slip(orientation: FloatArray, material: Material) -> FloatArray:
    """Strain ε_XX, ε_YY, 2 ε_XY of a unit slip of each system [1], shape (3, n).

    n is `system_count` of the table.

    Args:
        orientation: crystal → specimen, shape (3, 3).
        material: the slip systems.
    """
    tensors = orientation @ schmid_tensors(material.slip_systems) @ orientation.T
    return _in_plane(0.5 * (tensors + tensors.transpose(0, 2, 1))).T


def elastic_strain(orientation: FloatArray, material: Material, stress: float) -> FloatArray:
    """Strain ε_XX, ε_YY, 2 ε_XY of a cubic crystal in tension along Y [1], shape (3,).

    With the stress σ in crystal axes ε = S12 tr σ + S44/2 σ + (S11 − S12 − S44/2) diag σ.

    Args:
        orientation: crystal → specimen, shape (3, 3).
        material: the elastic constants.
        stress: along Y [MPa].
    """
    c11, c12, c44 = elastic_constants(material)
    s12 = -c12 / ((c11 - c12) * (c11 + 2.0 * c12))
    difference, half_s44 = 1.0 / (c11 - c12), 0.5 / c44
    axis = orientation[1]
    in_crystal = stress * np.outer(axis, axis)
    strain = (
        s12 * stress * np.eye(3)
        + half_s44 * in_crystal
        + (difference - half_s44) * np.diag(np.diag(in_crystal))
    )
    return _in_plane(orientation @ strain @ orientation.T)


def _in_plane(strain: FloatArray) -> FloatArray:
    """ε_XX, ε_YY, 2 ε_XY of strains (..., 3, 3), shape (..., 3)."""
    parts = [strain[..., i, j] for i, j in _PARTS]
    return np.stack([*parts[:2], 2.0 * parts[2]], axis=-1)
