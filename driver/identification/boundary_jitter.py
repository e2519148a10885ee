"""Noise of the boundary motion: at each image the specimen may be longer than its knots say.

Between turning points the elongation is linear in stage travel; at the stop of image t it departs
from that by an independent e_t of standard deviation σ_e. The data then have the covariance
C₀ + σ_e² G Gᵀ, G_st = ∂(data of image s)/∂e_t, which ties images and loads together.

G is that of the simulation, with a direction for the stop of each image. A cheaper one would not
do: where the specimen yields, its load answers with a fifth to a two-hundredth of the elastic
stiffness, and what a stop leaves in the crystals is seen for dozens of images after it.

The answer is linear, and read when the image was taken: σ_e is small against the travel between
two images, so that no stop turns loading into unloading, and a lag of the loads is short against
the time between them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from driver.forward.model import ForwardModel
from driver.parameters.boundary import elongation_names, knot_declarations
from meshes.arrays import BoolArray, FloatArray
from solver_adapters.interface import Direction
from solver_adapters.time_steps import once_more

if TYPE_CHECKING:
    from driver.identification.image_data import ImageData


_TOGETHER = 64  # directions of one simulation: they are held in memory together


@dataclass(frozen=True, eq=False)
class BoundaryJitter:
    """σ_e G, a row for the stop of each image.

    Attributes:
        load: answer of the load reading of each image [µN], shape (T, T).
        image: answer of the whitened numbers of each image, at a noise factor of 1,
            shape (T, T, n_z).
    """

    load: FloatArray
    image: FloatArray


def boundary_jitter(
    model: ForwardModel, image: ImageData, values: Mapping[str, float], sigma: float
) -> BoundaryJitter:
    """Return the answers of a simulation to an elongation of σ_e at each stop.

    Args:
        model: the forward model.
        image: the image part of the data.
        values: every parameter.
        sigma: σ_e [µm].

    Raises:
        SolverError: as `ForwardModel.predict`.
    """
    values = {**values, "load_lag": 0.0}
    stops = stops_of(model)
    scale = knot_declarations(model.boundary.weights.shape[1])[0].scale
    shape = unit_elongation(model, values)
    directions = [
        Direction(f"stop of image {t}", motion=stop[:, None, None] * shape, scale=scale)
        for t, stop in enumerate(stops)
    ]
    simulation, bare = model.simulation(values), replace(image, noise_factor=1.0)
    loads, images = [], []
    for first in range(0, len(stops), _TOGETHER):
        asked = replace(simulation, directions=tuple(directions[first : first + _TOGETHER]))
        response = model.adapter.solve(asked, model.workspace)
        simulation = once_more(simulation, response)
        projection = model.observe(response, values, ()).projection.value
        moved = response.d_displacement * [1.0, 1.0, 1.0 + values["height_scale"]]
        images.append(sigma * bare.sensitivity(moved, projection, np.arange(moved.shape[1])))
        loads.append(sigma * (1 + values["load_gain"]) * response.d_force)
    return BoundaryJitter(np.concatenate(loads), np.concatenate(images))


def stops_of(model: ForwardModel) -> BoolArray:
    """Return the instants of the stop at which each image was taken, shape (T, n_times).

    They are those at the stage travel of the image, from the image before it on.
    """
    weights, rows = model.boundary.weights, model.image_row
    stops = np.zeros((rows.size, len(weights)), dtype=bool)
    before = -1
    for stop, row in zip(stops, rows, strict=True):
        between = np.arange(before + 1, row + 1)
        stop[between] = np.abs(weights[between] - weights[row]).max(axis=1) < 1e-9
        before = row
    return stops


def unit_elongation(model: ForwardModel, values: Mapping[str, float]) -> FloatArray:
    """Motion of the end-face nodes per elongation, as at the first peak, shape (n, 3)."""
    unit = model.boundary.derivative(values, elongation_names(model.boundary.weights.shape[1])[0])
    return np.asarray(unit[int(np.argmax(np.abs(unit).max(axis=(1, 2))))])
