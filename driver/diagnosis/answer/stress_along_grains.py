"""Critical stress along each grain in which a fit lets it vary, with its uncertainty."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from driver.common.formatting import number, with_sigma
from driver.identification.fit import Fit
from meshes.arrays import AnyArray, FloatArray
from meshes.cells import extent_along_y
from meshes.prism_mesh import PrismMesh
from solver_adapters.grain_scalars import band_names, mode_names
from solver_adapters.inside_grain import band_factor, mode_factor
from solver_adapters.parameter import Parameter

_PLACES = 81
_STEP = 1e-30  # of a complex step


@dataclass(frozen=True)
class Band:
    """A band across a grain, in µm.

    Attributes:
        ratio: τ0 in its middle over that without it, and its standard deviation [-].
        middle: where its middle lies along Y, and its standard deviation [µm].
        width: over which a half of ln τ0 is left, and its standard deviation [µm].
    """

    ratio: tuple[float, float]
    middle: tuple[float, float]
    width: tuple[float, float]


@dataclass(frozen=True, eq=False)
class StressAlongGrain:
    """Critical stress along one grain, in the middle of its width.

    Attributes:
        grain: its number, from 1.
        y: places along Y from one end of the grain to the other, at any depth [µm], shape (n,).
        ratio: factor on the τ0 of the grain there [-], shape (n,).
        sigma: standard deviation of the factor [-], shape (n,).
        band: the band across it, None where there is none.
    """

    grain: int
    y: FloatArray
    ratio: FloatArray
    sigma: FloatArray
    band: Band | None

    def sentence(self) -> str:
        """Return where the critical stress is least and largest, and the band, in words."""
        least, most = int(np.argmin(self.ratio)), int(np.argmax(self.ratio))
        if self.band is not None:
            ratio, middle, width = (
                with_sigma(*found) for found in (self.band.ratio, self.band.middle, self.band.width)
            )
            return (
                f"The band in grain {self.grain} has {ratio} times the critical stress that the "
                f"grain would have there without it, its middle lies at Y = {middle} µm, and it is "
                f"{width} µm wide."
            )
        ends = [
            f"{with_sigma(self.ratio[k], self.sigma[k])} (at Y = {number(self.y[k])} µm)"
            for k in (least, most)
        ]
        return (
            f"Along grain {self.grain} the critical stress lies between {ends[0]} and {ends[1]} "
            "times that without modes and band, in the middle of the width."
        )

    def record(self) -> dict[str, Any]:
        """Return what `diagnosis.json` holds of it."""
        band = self.band and {
            "ratio": list(self.band.ratio),
            "middle_um": list(self.band.middle),
            "width_um": list(self.band.width),
        }
        return {
            "grain": self.grain,
            "text": self.sentence(),
            "y_um": self.y.tolist(),
            "ratio": self.ratio.tolist(),
            "sigma": self.sigma.tolist(),
            "band": band,
        }


def stress_along_grains(
    mesh: PrismMesh, fitted: Fit, parameters: Mapping[str, Parameter]
) -> tuple[StressAlongGrain, ...]:
    """Return the critical stress along the grains in which a fit has freed its modes or its band.

    Args:
        mesh: of the specimen, its nodes where the fit has them.
        fitted: the fit.
        parameters: declarations by name.
    """
    return tuple(_along_grains(mesh, fitted, parameters))


def _along_grains(
    mesh: PrismMesh, fitted: Fit, parameters: Mapping[str, Parameter]
) -> Iterator[StressAlongGrain]:
    free, values = fitted.best.free, fitted.values
    slopes = np.array([parameters[name].slope(values[name]) for name in free])
    covariance = fitted.covariance * slopes * slopes[:, None]
    for index in range(mesh.n_grains):
        modes, band = mode_names(index + 1), band_names(index + 1)
        if not set(free) & {*modes[:2], band[0]}:  # the slope along X changes nothing here
            continue
        cells = mesh.cells[mesh.grain == index]
        mean, half = extent_along_y(mesh.points, cells)
        ends = mesh.points[cells, 1]
        y = np.linspace(ends.min(), ends.max(), _PLACES)
        names = (*modes, *band)
        at = np.array([values[name] for name in names], dtype=np.complex128)
        rows = [free.index(name) for name in names if name in free]
        steps = 1j * _STEP * np.eye(len(names))[[name in free for name in names]]
        eta = (y - mean) / half
        changes = np.array([_factor(at + step, eta).imag / _STEP for step in steps])
        of_these = covariance[np.ix_(rows, rows)]
        variance = np.einsum("kn,kl,ln->n", changes, of_these, changes)
        sigma = {name: float(np.sqrt(covariance[k, k])) for k, name in enumerate(free)}
        yield StressAlongGrain(
            index + 1,
            y,
            _factor(at, eta).real,
            np.sqrt(np.maximum(variance, 0.0)),  # of rounding where nothing is unknown
            _band(band, values, sigma, mean, half),
        )


def _factor(values: AnyArray, eta: FloatArray) -> AnyArray:
    """Factor on τ0 of modes and band in the middle of the width, (n,)."""
    modes, band = list(values[:3]), list(values[3:])
    return mode_factor(modes, eta, np.zeros_like(eta)) * band_factor(band, eta)


def _band(
    names: tuple[str, str, str],
    values: Mapping[str, float],
    sigma: Mapping[str, float],
    mean: float,
    half: float,
) -> Band | None:
    height, middle, half_width = names
    if height not in sigma:
        return None
    ratio = float(np.exp(values[height]))
    return Band(
        (ratio, ratio * sigma[height]),
        (mean + half * values[middle], half * sigma.get(middle, 0.0)),
        (2.0 * half * values[half_width], 2.0 * half * sigma.get(half_width, 0.0)),
    )
