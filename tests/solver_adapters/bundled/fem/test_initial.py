"""State and skin before loading."""

from __future__ import annotations

import numpy as np
import pytest

from solver_adapters.bundled.fem.initial import (
    depth_share,
    initial_state,
    skin_factor,
    surface_distance,
)
from solver_adapters.bundled.law.law import STRAIN_MODES
from solver_adapters.bundled.law.state_layout import S_OVER, S_X
from solver_adapters.crystal import BCC, bunge_matrix, slip_systems
from solver_adapters.material import StrainMeasure

ROTATIONS = np.stack([bunge_matrix(281, 8, 47), bunge_matrix(211, 45, 150), np.eye(3)])
AXIAL = np.diag([-0.5, 1.0, -0.5])


@pytest.mark.parametrize("measure", ["small", "finite"])
def test_an_eigenstrain_stands_in_the_specimen_frame_and_keeps_the_volume(
    measure: StrainMeasure,
) -> None:
    depth = np.array([0.3, -0.2, 0.0])
    state = initial_state(measure, BCC, 0.0, 2e-3, ROTATIONS, depth)
    for R, share, row in zip(ROTATIONS, depth, state, strict=True):
        if measure == "small":
            crystal = np.einsum("k,kij->ij", row[:5], STRAIN_MODES[:5])
            np.testing.assert_allclose(R @ crystal @ R.T, 2e-3 * share * AXIAL, atol=1e-18)
        else:
            inverse = R @ row[:9].reshape(3, 3) @ R.T
            np.testing.assert_allclose(np.linalg.det(inverse), 1.0, rtol=1e-14)
            np.testing.assert_allclose(inverse, np.eye(3) - 2e-3 * share * AXIAL, atol=1e-6)


def test_prior_cold_work_is_in_proportion_to_the_schmid_factors_along_the_axis() -> None:
    state = initial_state("small", BCC, 5e-5, 0.0, ROTATIONS, np.zeros(3))
    m, n = slip_systems(BCC)
    for R, row in zip(ROTATIONS, state, strict=True):
        factors = ((m @ R.T)[:, 1]) * ((n @ R.T)[:, 1])
        np.testing.assert_allclose(row[S_X:S_OVER], 1e-4 * factors, rtol=1e-13, atol=1e-20)
        assert abs(row[S_X:S_OVER]).max() <= 5e-5


def test_the_depth_of_a_triangular_section_is_counted_from_its_centroid() -> None:
    """Shares go from −1/3 at the face to 2/3 at the apex."""
    edges = np.linspace(0.0, 1.0, 4001)
    middle = (edges[1:] + edges[:-1]) / 2
    width = 1 - middle
    share = depth_share(-3.4641 * middle, width)
    np.testing.assert_allclose(share, middle - 1 / 3, atol=1e-4)


def test_the_skin_fades_with_the_distance_from_the_nearest_side() -> None:
    # A tetrahedron with its corner at the origin: three sides are coordinate planes.
    corners = np.array([[0, 0, 0], [3, 0, 0], [0, 3, 0], [0, 0, 3]], dtype=np.float64)
    facets = corners[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]]
    points = np.array([[0.2, 0.5, 0.9], [0.9, 0.1, 0.6], [0.7, 0.7, 0.7]])
    distance = surface_distance(points, facets)
    slanted = (3 - points.sum(axis=1)) / np.sqrt(3)
    np.testing.assert_allclose(distance, np.minimum(points.min(axis=1), slanted), atol=1e-12)
    factor = skin_factor(1.4, 0.3, distance)
    np.testing.assert_allclose(factor, 1 + 0.4 * np.exp(-distance / 0.3))
    assert (skin_factor(1.0, 0.3, distance) == 1.0).all()
