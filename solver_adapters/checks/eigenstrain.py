"""The largest eigenstrain that a specimen carries before loading without yielding."""

from __future__ import annotations

import numpy as np

from meshes.prism_mesh import PrismMesh
from solver_adapters.constants import elastic_constants, grain_ratios
from solver_adapters.crystal import MOST_SYSTEMS, N_110, N_112, slip_systems
from solver_adapters.interface import Simulation, UnsupportedError

# Cells with plane faces as tetrahedra of their corners.
_TETRAHEDRA = {
    10: np.array([[0, 1, 2, 3]]),
    20: np.array(
        [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]]
    ),
}


def refuse_yielding_eigenstrain(simulation: Simulation) -> None:
    """Refuse an eigenstrain that yields at the start, which is an elastic equilibrium.

    Between clamped ends the outermost fibre carries E times its eigenstrain along Y.
    """
    m = simulation.material
    if m.eigenstrain == 0:
        return
    C11, C12, C44 = elastic_constants(m)
    S11, S12 = np.linalg.inv(np.full((3, 3), C12) + (C11 - C12) * np.eye(3))[0, :2]
    along = simulation.orientations[:, 1]
    directions, normals = slip_systems(m.slip_systems)
    schmid = abs((along @ directions.T) * (along @ normals.T))
    lengths = [N_110, N_112, MOST_SYSTEMS - N_110 - N_112]  # other crystals have ratios of 1
    families = np.repeat([1.0, m.tau0_112, m.tau0_123], lengths)
    strength = m.tau0 * families[: len(normals)]
    yields = grain_ratios(m, len(along)) / (schmid / strength).max(axis=1)
    # Young's modulus of a cubic crystal along a unit vector in its axes.
    x, y, z = along.T**2
    modulus = 1 / (S11 - 2 * (S11 - S12 - 0.5 / C44) * (x * y + y * z + z * x))
    stress = modulus * _outermost_share(simulation.mesh) * abs(m.eigenstrain)
    grain = int(np.argmax(stress / yields))
    if stress[grain] > yields[grain]:
        raise UnsupportedError(
            f"eigenstrain is {m.eigenstrain:g}, by which grain {grain + 1} carries about "
            f"{stress[grain]:.3g} MPa before loading and yields at {yields[grain]:.3g}; expected "
            f"at most {abs(m.eigenstrain) * yields[grain] / stress[grain]:.2g} in size"
        )


def _outermost_share(mesh: PrismMesh) -> float:
    """Largest distance from the mean height, in shares of the depth (√18 standard deviations)."""
    corners = mesh.cells[:, _TETRAHEDRA[mesh.cells.shape[1]]].reshape(-1, 4)
    z = mesh.points[corners, 2]
    volume = abs(np.linalg.det(mesh.points[corners[:, 1:]] - mesh.points[corners[:, :1]]))
    volume /= volume.sum()
    mean = float(volume @ z.mean(axis=1))
    z = z - mean
    # Mean square of a linear function over a tetrahedron.
    square = float(volume @ ((z**2).sum(axis=1) + z.sum(axis=1) ** 2)) / 20
    return float(abs(z).max() / np.sqrt(18 * square))
