"""The whole solver against Code_Aster on a prism of 669 tetrahedra, at the same time steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from solver_adapters.bundled.adapter import BundledAdapter
from tools.code_aster_prism import forces, reference, simulation


# Code_Aster integrates this element with five points, prismid with four: hence the 0.05 %.
def test_a_load_cycle_of_the_prism_agrees_with_code_aster() -> None:
    times, rows = forces()
    instants, expected = rows.T
    response = BundledAdapter().solve(simulation(times))
    assert response.cuts == 0
    force = response.force[np.searchsorted(times, instants - 1e-6)]
    difference = abs(force - expected) / abs(expected).max()
    assert difference[:5].max() < 1e-4
    assert difference.max() < 6e-4


def test_with_the_gauss_points_of_code_aster_the_prism_is_its_own_to_a_millionth() -> None:
    """Code_Aster stopped its iteration at relative residuals of 1e-5, some far below."""
    asked, expected = reference()
    response = BundledAdapter().solve(replace(asked, tet10_points=5))
    difference = abs(response.force - expected.force) / abs(expected.force).max()
    assert difference.max() < 1e-6
    assert abs(response.displacement - expected.displacement).max() < 1e-6
