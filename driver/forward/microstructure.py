"""Geometry and orientations as parameters: the same mesh, its nodes and crystals moved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from driver.parameters.microstructure import boundary_names, gradient_name
from meshes.arrays import FloatArray
from meshes.prism import PrismGeometry
from meshes.prism_mesh import PrismMesh
from meshes.velocity import (
    InvertedCellsError,
    apex_shift,
    boundary_bow,
    boundary_shift,
    boundary_tilt,
    depth_scale,
    moved,
)
from solver_adapters.crystal import rotation_vector_matrix
from solver_adapters.interface import SolverError


def _vector(values: Mapping[str, float], what: str) -> FloatArray:
    return np.array([values[f"{what}_{axis}"] for axis in "xyz"])


def _left_jacobian(vector: FloatArray) -> FloatArray:
    """exp(ω + dω) = exp(J dω)·exp(ω) to first order (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    first = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    second = (1 - np.sinc(angle / np.pi)) / angle**2 if angle > 1e-4 else 1 / 6
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


@dataclass(frozen=True, eq=False)
class Microstructure:
    """Drawn mesh, measured orientations, and the velocities of the nodes.

    Attributes:
        mesh: the prism as drawn.
        orientations: measured crystal → specimen rotations, shape (n_grains, 3, 3).
        velocities: node velocity for each geometric parameter, shape (n_nodes, 3).
        scales: prior scales that the measured orientations tell, by name of the parameter.
    """

    mesh: PrismMesh
    orientations: FloatArray
    velocities: Mapping[str, FloatArray]
    scales: Mapping[str, float] = field(default_factory=dict)

    @property
    def parameters(self) -> frozenset[str]:
        """Names of the parameters that can be moved in this specimen."""
        names = set(self.velocities)
        for grain in range(1, len(self.orientations) + 1):
            names |= {f"rotation_grain{grain}_{axis}" for axis in "xyz"}
            names |= {f"{gradient_name(grain)}_{axis}" for axis in "xyz"}
        if len(self.orientations) > 1:
            names |= {f"rotation_frame_{axis}" for axis in "xyz"}
        return frozenset(names)

    def moved_mesh(self, values: Mapping[str, float]) -> PrismMesh:
        """Return the mesh with its nodes where the parameters put them.

        Raises:
            SolverError: the change would turn a cell inside out.
        """
        active = {name: v for name, v in self.velocities.items() if values[name] != 0.0}
        if not active:
            return self.mesh
        shift = sum((values[name] * v for name, v in active.items()), np.zeros((1, 3)))
        try:
            return moved(self.mesh, np.asarray(shift))
        except InvertedCellsError as error:
            raise SolverError(str(error)) from None

    def rotated(self, values: Mapping[str, float]) -> FloatArray:
        """Orientations with the grain rotations and the turn of the EBSD frame."""
        frame = rotation_vector_matrix(_vector(values, "rotation_frame"))
        return np.stack(
            [
                frame
                @ rotation_vector_matrix(_vector(values, f"rotation_grain{grain + 1}"))
                @ orientation
                for grain, orientation in enumerate(self.orientations)
            ]
        )

    def lattice_gradient(self, values: Mapping[str, float]) -> FloatArray | None:
        """Rotation vector of the lattice per µm along Y [rad/µm], (n_grains, 3); None if null."""
        gradient = np.zeros((len(self.orientations), 3))
        for grain in range(len(self.orientations)):
            gradient[grain] = _vector(values, gradient_name(grain + 1))
        return gradient if gradient.any() else None

    def lattice_gradient_rate(self, name: str) -> FloatArray:
        """Its derivative with respect to one parameter, shape (n_grains, 3)."""
        what, axis = name.rsplit("_", 1)
        names = [gradient_name(grain + 1) for grain in range(len(self.orientations))]
        rate = np.zeros((len(self.orientations), 3))
        rate[names.index(what), "xyz".index(axis)] = 1.0
        return rate

    def rotation_rate(self, values: Mapping[str, float], name: str) -> FloatArray:
        """Rotation rate of each grain for a unit rate of one parameter, shape (n_grains, 3)."""
        what, axis = name.rsplit("_", 1)
        unit = np.eye(3)["xyz".index(axis)]
        frame = _vector(values, "rotation_frame")
        rates = np.zeros((len(self.orientations), 3))
        if what == "rotation_frame":
            rates[:] = _left_jacobian(frame) @ unit
        else:
            grain = int(what.removeprefix("rotation_grain")) - 1
            own = _left_jacobian(_vector(values, what)) @ unit
            rates[grain] = rotation_vector_matrix(frame) @ own
        return rates


def build_microstructure(
    mesh: PrismMesh,
    geometry: PrismGeometry,
    orientations: FloatArray,
    scales: Mapping[str, float] | None = None,
) -> Microstructure:
    """Collect the geometric parameters that the specimen has.

    Args:
        mesh: the prism as drawn.
        geometry: of the prism and of its grain boundaries.
        orientations: measured crystal → specimen rotations, shape (n_grains, 3, 3).
        scales: prior scales that these tell, by name of the parameter.
    """
    velocities = {
        "depth_scale": depth_scale(mesh, geometry),
        "apex_shift": apex_shift(mesh, geometry),
    }
    for number, names in enumerate(boundary_names(geometry.n_grains), start=1):
        fields = (
            boundary_shift(mesh, geometry, number),
            boundary_tilt(mesh, geometry, "x", number),
            boundary_tilt(mesh, geometry, "z", number),
            boundary_bow(mesh, geometry, number),
        )
        velocities |= dict(zip(names, fields, strict=True))
    return Microstructure(mesh, orientations, velocities, dict(scales or {}))
