"""Elongation, tilt and mean height change of the specimen, with covariances over the images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from driver.dic.covariance import covariance_in_time, held_back
from driver.dic.elongation import edge_motion
from driver.dic.series import SurfaceMotion
from driver.dic.surface_images import SurfaceImages
from driver.dic.system import System
from meshes.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Reading:
    """A number that is read from the motion of each of T images.

    Attributes:
        value: [µm], shape (T,).
        covariance: of the noise of images and reference and of the flat pattern [µm²], (T, T).
        held: standard deviation of what the penalty holds back [µm], alike in all images.
        single: standard deviation of an image by itself, not smoothed along travel, median [µm].
    """

    value: FloatArray
    covariance: FloatArray
    held: float
    single: float

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation in each image, all of it [µm], shape (T,)."""
        return np.asarray(np.sqrt(self.covariance.diagonal() + self.held**2))

    @property
    def own(self) -> float:
        """Standard deviation of an image without what all images share [µm], median."""
        T = self.value.size
        shared = (self.covariance.sum() - self.covariance.trace()) / max(T * (T - 1), 1)
        return float(np.sqrt(np.median(self.covariance.diagonal()) - shared))


@dataclass(frozen=True, eq=False)
class Unpenalised:
    """The elongation of each of T images without a penalty.

    Attributes:
        value: [µm], shape (T,).
        sigma: standard deviation of an image by its own noise [µm], infinity where the images do
            not decide the motion.
    """

    value: FloatArray
    sigma: float


def readings(
    measured: SurfaceMotion,
    images: SurfaceImages,
    length: float,
    smoothed: SurfaceMotion,
    smoother: FloatArray,
) -> dict[str, Reading]:
    """Elongation v(S+) − v(S−), tilt w(S+) − w(S−), and the mean of w over the pixels.

    The region of interest ends short of the edges: its mean stretch is carried on to them. The
    stage's translation moves the mean of w alone, which smoothing leaves as it is.

    Args:
        measured: motion of each image by itself.
        images: the images behind it.
        length: of the specimen [µm].
        smoothed: the motion along stage travel; `measured` itself where it is not smoothed.
        smoother: S, shape (T, T).

    Returns:
        By name: elongation, tilt, mean_w.

    Raises:
        ImageError: a mesh ends before an edge of the region of interest.
    """
    lower, upper = images.bounds[2:]
    reach = length / (upper - lower)
    edges = edge_motion(smoothed, images, lower, upper)
    mean_w = np.zeros(measured.coefficients.shape[1])
    mean_w[-len(measured.basis_w.nodes) :] = measured.basis_w.values.mean(axis=0)
    functionals = np.array([reach * edges.difference(1), reach * edges.difference(2), mean_w])
    covariances = covariance_in_time(measured, images, functionals)
    readings_by_name = {}
    for name, functional, covariance in zip(
        ("elongation", "tilt", "mean_w"), functionals, covariances, strict=True
    ):
        held = held_back(measured, images, functional)
        single = float(np.median(np.sqrt(covariance.diagonal() + held**2)))
        if name != "mean_w":
            covariance = smoother @ covariance @ smoother.T
        readings_by_name[name] = Reading(
            smoothed.coefficients @ functional, covariance, held, single
        )
    return readings_by_name


def without_penalty(measured: SurfaceMotion, images: SurfaceImages, length: float) -> Unpenalised:
    """Elongation as `readings`, but of the motion that images have without a penalty of u and v.

    The right-hand side b = M p + P p of the motion p of a frame is that without penalty, too. So
    L M⁻¹ b = L p + (M⁻¹ Lᵀ)ᵀ P p; of w the penalty stays, where a frame lacks pixels.

    Args:
        measured: motion of each image by itself.
        images: the images behind it.
        length: of the specimen [µm].

    Raises:
        ImageError: a mesh ends before an edge of the region of interest.
    """
    lower, upper = images.bounds[2:]
    edges = edge_motion(measured, images, lower, upper)
    functional = length / (upper - lower) * edges.difference(1)
    value = np.asarray(measured.coefficients @ functional)
    equations, system = measured.equations, measured.system
    common = _weights(
        equations.without_penalty(np.ones(measured.compared.shape[1], dtype=bool)), functional
    )
    if common is None:
        return Unpenalised(value, np.inf)
    # The noise of the right-hand side has the covariance σ² M at most.
    sigma = images.sigma * float(np.sqrt(functional @ common))
    for t in np.flatnonzero(~measured.lost).tolist():
        weights: FloatArray | None = common
        if not measured.compared[t].all():
            weights = _weights(equations.without_penalty(measured.compared[t]), functional)
        if weights is None:
            return Unpenalised(value, np.inf)
        value[t] += weights @ (system.weights[0] * (system.parts[0] @ measured.coefficients[t]))
    return Unpenalised(value, sigma)


def _weights(free: System, functional: FloatArray) -> FloatArray | None:
    """M⁻¹ Lᵀ, the penalty of w in M; None where images do not decide u and v alone."""
    return None if free.ridge else free.solve(functional)
