"""A bar in uniform tension carries its section times the stress of a point."""

from __future__ import annotations

import numpy as np
import pytest

from meshes.prism import CellKind, PrismGeometry, generate
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.crystal import BCC, FCC, SystemTable, bunge_matrix
from solver_adapters.interface import Simulation
from solver_adapters.material import Material
from tools.boxes import uniaxial

ROTATION = bunge_matrix(281, 8, 47)
TIMES = np.arange(5.0)
STRAINS = np.array([0.0, 1e-3, 3e-3, 6e-3, 4e-3])


def bar(geometry: PrismGeometry, kind: CellKind, material: Material) -> Simulation:
    """Flat ends that move along Y; three components pin the rest of a rigid motion."""
    mesh = generate(geometry, 2.0, kind)
    low, high = mesh.nodes["S_MINUS"], mesh.nodes["S_PLUS"]
    nodes = np.concatenate([low, high])
    mask = np.zeros((len(nodes), 3), dtype=np.bool_)
    mask[:, 1] = True
    x, z = mesh.points[low][:, [0, 2]].T
    bottom = z < z.min() + 1e-9
    mask[np.flatnonzero(bottom & (x == x[bottom].min())), ::2] = True
    # The second one stops the turn about Y.
    mask[np.flatnonzero((z == z.max()) & (x == x.min())), 0] = True
    motion = np.zeros((len(TIMES), len(nodes), 3))
    motion[:, len(low) :, 1] = geometry.length * STRAINS[:, None]
    return Simulation(
        mesh=mesh,
        material=material,
        orientations=ROTATION[None],
        times=TIMES,
        motion_nodes=nodes,
        motion_mask=mask,
        motion=motion,
        output=np.arange(len(TIMES)),
        output_nodes=mesh.nodes["S_PLUS"],
        tolerance=1e-9,
        integration="backward_euler",
    )


@pytest.mark.parametrize("systems", [BCC, FCC], ids=["bcc", "fcc"])
@pytest.mark.parametrize("kind", ["tet10", "hex20"])
@pytest.mark.parametrize(("bottom", "area"), [(3.0, 6.0), (2.0, 5.0), (0.0, 3.0)])
def test_the_force_of_a_bar_is_its_section_times_the_stress(
    bottom: float, area: float, kind: CellKind, systems: SystemTable
) -> None:
    material = Material(strain_measure="small", slip_systems=systems)
    geometry = PrismGeometry(6.0, 3.0, 2.0, bottom=bottom)
    found = BundledAdapter().solve(bar(geometry, kind, material)).force
    of_one = BundledAdapter().solve(uniaxial(material, ROTATION, TIMES, STRAINS)).force
    np.testing.assert_allclose(found, area * of_one, rtol=1e-6, atol=1e-6 * area)
    assert abs(of_one).max() > 80.0
