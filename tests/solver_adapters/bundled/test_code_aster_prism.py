"""The whole solver against Code_Aster on a prism of 669 tetrahedra, at the same time steps."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.code_aster_prism import forces, reference, simulation
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.interface import Response


@pytest.fixture(scope="module")
def own() -> Response:
    """At the instants of every step, with the displacement of all nodes."""
    asked, _ = reference()
    return BundledAdapter().solve(asked)


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


def test_the_face_moves_as_in_code_aster(own: Response) -> None:
    asked, expected = reference()
    face = np.flatnonzero(asked.mesh.points[:, 2] > -1e-6)
    difference = abs(own.displacement - expected.displacement)[:, face]
    print(difference.max(axis=(1, 2)))
    assert difference.max() < 2e-4
