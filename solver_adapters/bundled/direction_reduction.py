"""Directions of which derivatives are sums of others, or null: they need not be carried along.

Turns of crystals span three dimensions for each grain, however many are asked for; some constants
of the general law have no effect until another one is not null.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.grain_scalars import band_names
from solver_adapters.interface import Direction, Response, Simulation
from solver_adapters.material import Material, scalar


@dataclass(frozen=True, eq=False)
class ReducedDirections:
    """A simulation along fewer directions, and what those asked for are in terms of them.

    Attributes:
        simulation: the simulation along the directions that are carried.
        shares: of each of those in the directions asked for, (n_asked, n_carried).
    """

    simulation: Simulation
    shares: FloatArray

    def whole(self, response: Response) -> Response:
        """Return the response with the derivatives along all directions asked for."""
        if np.array_equal(self.shares, np.eye(len(self.shares))):
            return response
        asked = len(self.shares)
        displacement = np.zeros((asked, *response.d_displacement.shape[1:]))
        force = self.shares @ response.d_force
        for row, carried in zip(*np.nonzero(self.shares), strict=True):
            displacement[row] += self.shares[row, carried] * response.d_displacement[carried]
        return replace(response, d_displacement=displacement, d_force=force)


def reduced_directions(simulation: Simulation) -> ReducedDirections:
    """Leave out the directions that follow from others or have no effect."""
    asked, material = simulation.directions, simulation.material
    turns = [direction for direction in asked if _only_turns(direction)]
    n_grains = simulation.mesh.n_grains
    units = _unit_turns(n_grains)
    replaced = turns if len(turns) > len(units) else []
    carried = [d for d in asked if d not in replaced and not _is_null(d, material, n_grains)]
    shares = np.zeros((len(asked), len(carried)))
    for row, direction in enumerate(asked):
        if direction in carried:
            shares[row, carried.index(direction)] = 1.0
    if replaced:
        by_turn = np.array(
            [d.rotation.ravel() if d in replaced and d.rotation is not None
             else np.zeros(len(units)) for d in asked]
        )  # fmt: skip
        shares = np.hstack([shares, by_turn])
        carried += units
    return ReducedDirections(replace(simulation, directions=tuple(carried)), shares)


def _only_turns(direction: Direction) -> bool:
    others = (direction.lattice_gradient, direction.motion, direction.points, direction.times)
    return (
        direction.rotation is not None
        and not direction.material
        and all(other is None for other in others)
    )


def _unit_turns(n_grains: int) -> list[Direction]:
    """Return a turn of each grain about each axis of the specimen."""
    turns = np.eye(3 * n_grains).reshape(-1, n_grains, 3)
    return [Direction(f"turn {k}", rotation=turn) for k, turn in enumerate(turns)]


def _is_null(direction: Direction, material: Material, n_grains: int) -> bool:
    """Whether a direction changes nothing but constants that have no effect."""
    idle = set()
    if material.Q == 0.0:
        idle.add("h_latent")
        if material.Q_latent == 0.0:
            idle.add("b")
    if material.c2 == 0.0:
        idle.add("d2")
    if material.skin_tau0 == 1.0:
        idle.add("skin_thickness")
    for height, middle, half_width in map(band_names, range(1, max(n_grains, 2) + 1)):
        if scalar(material, height) == 0.0:
            idle |= {middle, half_width}
    others = (
        direction.rotation, direction.lattice_gradient, direction.motion, direction.points,
        direction.times,
    )  # fmt: skip
    return direction.material.keys() <= idle and all(other is None for other in others)
