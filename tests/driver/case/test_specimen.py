from __future__ import annotations

import numpy as np
import pytest

from driver.case.specimen import Orientation, Specimen
from tests.driver.case.tables import refused


def test_a_prism_whose_depth_is_not_given_has_an_equilateral_section() -> None:
    specimen = Specimen(width_um=4.0)
    assert specimen.depth == pytest.approx(np.sqrt(4.0**2 - 2.0**2))
    assert specimen.area == pytest.approx(4 * np.sqrt(3))
    deeper = Specimen(width_um=4.0, depth_um=5.0)
    assert (deeper.depth, deeper.area) == (5.0, 10.0)


def test_the_finer_mesh_is_finer() -> None:
    place, expected = refused(Specimen, mesh_size_um=1.0, fine_mesh_size_um=1.0)
    assert (place, expected) == ("fine_mesh_size_um", "a number < mesh_size_um = 1")


def test_a_grain_boundary_has_a_point_and_a_normal_or_neither() -> None:
    point, normal = (0.0, 6.0, 0.0), (0.1, 1.0, 0.0)
    assert refused(Specimen, boundary_point_um=point)[0] == "boundary_normal"
    assert refused(Specimen, boundary_normal=normal)[0] == "boundary_point_um"
    both = Specimen(boundary_point_um=point, boundary_normal=normal)
    assert both.boundary_normal == normal and Specimen().boundary_point_um is None
    nowhere = refused(Specimen, boundary_point_um=point, boundary_normal=(0.0, 0.0, 0.0))
    assert nowhere == ("boundary_normal", "a normal other than zero")


def test_a_rounded_rotation_is_made_a_proper_one() -> None:
    rounded = ((0.8660, -0.5000, 0.0), (0.5000, 0.8660, 0.0), (0.0, 0.0, 1.0))
    rotation = Orientation(ebsd_to_specimen=rounded).rotation
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(rotation[0], [3**0.5 / 2, -0.5, 0], atol=1e-4)


def test_what_is_no_rotation_to_a_thousandth_or_mirrors_is_refused() -> None:
    near, far, mirror = (
        ((1.0, slope, 0.0), (-slope, 1.0, 0.0), (0.0, 0.0, last))
        for slope, last in ((3e-4, 1.0), (4e-2, 1.0), (0.0, -1.0))
    )
    assert np.linalg.det(Orientation(ebsd_to_specimen=near).rotation) == pytest.approx(1.0)
    assert "orthonormal rows" in refused(Orientation, ebsd_to_specimen=far)[1]
    assert "mirrors the crystal" in refused(Orientation, ebsd_to_specimen=mirror)[1]
