"""Noise of the boundary motion: at each image the specimen may be longer than its knots say.

Between images the elongation is linear in stage travel; at the stop of image t it departs from
that by an independent e_t of standard deviation σ_e. The data then have the covariance
C₀ + σ_e² G Gᵀ, G_st = ∂(data of image s)/∂e_t, which ties images and loads together.

What an elongation at one stop does depends on what the specimen does there: an elastic one answers
with its stiffness, a yielding one with a small part of it. G is therefore that of the simulation
itself, not of an elastic body. A stop acts on later images only through what it leaves in the
crystals, and further slip wears that off within a few images: column t is nearly zero beyond
`REACH` images after t. So the stops t, t + REACH, t + 2 REACH, … share one direction of
differentiation, and each answer is that of the last stop before it (columns of a banded Jacobian
in groups: Curtis, Powell & Reid, IMA J. Appl. Math. 13 (1974) 117).

The answer is linear: σ_e is small against the travel between two images, so that no stop turns
loading into unloading.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from driver.boundary import elongation_names, knot_declarations
from driver.model import ForwardModel
from solver_adapters.interface import Direction

if TYPE_CHECKING:
    from driver.identification.data import ImageData

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

REACH = 8  # images over which the effect of a stop is followed


@dataclass(frozen=True, eq=False)
class BoundaryJitter:
    """σ_e and the answers of the data to an elongation at each stop.

    Attributes:
        sigma: σ_e [µm].
        load: answer of the load reading of image s to the stop of image s − lag [µN/µm],
            shape (T, reach).
        image: answer of the whitened numbers of image s, at a noise factor of 1 [1/µm], shape
            (T, reach, n_z).
    """

    sigma: float
    load: FloatArray
    image: FloatArray

    def columns(self) -> tuple[FloatArray, FloatArray]:
        """σ_e G, a row for each stop: loads (T, T) and images (T, T, n_z)."""
        T, reach = self.load.shape
        load, image = np.zeros((T, T)), np.zeros((T, T, self.image.shape[2]))
        for lag in range(reach):
            seen = np.arange(lag, T)
            load[seen - lag, seen] = self.sigma * self.load[seen, lag]
            image[seen - lag, seen] = self.sigma * self.image[seen, lag]
        return load, image


def boundary_jitter(
    model: ForwardModel,
    image: ImageData,
    values: Mapping[str, float],
    sigma: float,
    reach: int = REACH,
) -> BoundaryJitter:
    """The answers of a simulation to an elongation at each stop, from `reach` directions.

    Args:
        model: the forward model.
        image: the image part of the data.
        values: every parameter.
        sigma: σ_e [µm].
        reach: images over which the effect of a stop is followed.

    Raises:
        SolverError: as `ForwardModel.predict`.
    """
    stops = stops_of(model)
    T, reach = len(stops), min(reach, len(stops))
    n_knots = model.boundary.weights.shape[1]
    scale = knot_declarations(n_knots)[0].scale
    shape = unit_elongation(model, values)
    directions = tuple(
        Direction(
            f"elongation at the stops of every {reach}th image from image {first}",
            motion=stops[first::reach].any(axis=0)[:, None, None] * shape,
            scale=scale,
        )
        for first in range(reach)
    )
    simulation = replace(model.simulation(values), directions=directions)
    response = model.adapter.solve(simulation, model.workspace)
    d_surface = response.d_displacement.copy()
    d_surface[..., 2] *= 1 + values["height_scale"]
    d_load = (1 + values["load_gain"]) * response.d_force
    look = model.observe(response, values, ()).look.value
    z = replace(image, noise_factor=1.0).sensitivity(d_surface, look)
    load, answers = np.zeros((T, reach)), np.zeros((T, reach, image.n_z))
    for s in range(T):
        for lag in range(min(reach, s + 1)):
            group = (s - lag) % reach
            load[s, lag], answers[s, lag] = d_load[group, s], z[group, s]
    return BoundaryJitter(sigma, load, answers)


def stops_of(model: ForwardModel) -> BoolArray:
    """The instants of the stop at which each image was taken, shape (T, n_times).

    They are those at the stage travel of the image, from the image before it on.
    """
    weights, rows = model.boundary.weights, model.image_row
    stops = np.zeros((rows.size, len(weights)), dtype=bool)
    before = -1
    for stop, row in zip(stops, rows, strict=True):
        here = np.arange(before + 1, row + 1)
        stop[here] = np.abs(weights[here] - weights[row]).max(axis=1) < 1e-9
        before = row
    return stops


def unit_elongation(model: ForwardModel, values: Mapping[str, float]) -> FloatArray:
    """Motion of the end-face nodes per elongation, as at the first peak, shape (n, 3)."""
    unit = model.boundary.derivative(values, elongation_names(model.boundary.weights.shape[1])[0])
    return np.asarray(unit[int(np.argmax(np.abs(unit).max(axis=(1, 2))))])
