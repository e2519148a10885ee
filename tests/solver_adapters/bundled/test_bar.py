"""A bar in uniform tension carries its section times the stress of a point."""

from __future__ import annotations

import numpy as np
import pytest

from meshes.prism import CellKind, PrismGeometry
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.crystal import BCC, FCC, SystemTable
from solver_adapters.material import Material
from tests.solver_adapters.bundled.bars import ROTATION, STRAINS, TIMES, bar
from tools.boxes import uniaxial


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
