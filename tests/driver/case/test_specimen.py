from __future__ import annotations

import numpy as np
import pytest

from driver.case.specimen import Specimen
from tests.driver.case.tables import refused


def test_a_prism_whose_depth_is_not_given_has_an_equilateral_section() -> None:
    specimen = Specimen(width_um=4.0)
    assert specimen.depth == pytest.approx(np.sqrt(4.0**2 - 2.0**2))
    assert specimen.area == pytest.approx(4 * np.sqrt(3))
    deeper = Specimen(width_um=4.0, depth_um=5.0)
    assert (deeper.depth, deeper.area) == (5.0, 10.0)


def test_a_bar_is_a_rectangle_or_a_trapezoid() -> None:
    square = Specimen(shape="bar", width_um=3.0)
    assert (square.depth, square.bottom, square.area) == (3.0, 3.0, 9.0)
    tapered = Specimen(shape="bar", width_um=3.0, depth_um=2.0, bottom_width_um=2.5)
    assert tapered.area == pytest.approx(5.5)
    assert Specimen(width_um=3.0).bottom == 0.0
    refusal = refused(Specimen, bottom_width_um=2.5)
    assert refusal == ("bottom_width_um", 'nothing, or shape = "bar"')


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


def test_sizes_are_automatic_unless_both_are_stated() -> None:
    assert Specimen().automatic and Specimen().cells is None and Specimen().refined is None
    stated = Specimen(mesh_size_um=1.6, fine_mesh_size_um=1.1)
    assert not stated.automatic and stated.refined is None
    assert stated.cells == stated.cell_kind == "tet10"
    assert Specimen(cells="hex20").automatic
    expected = ("mesh_size_um", 'a number, or fine_mesh_size_um = "auto" as well')
    with_one = refused(Specimen, mesh_size_um=1.6)
    assert with_one == ("fine_mesh_size_um", 'a number, or mesh_size_um = "auto" as well')
    assert refused(Specimen, fine_mesh_size_um=1.1) == expected


def test_a_level_puts_numbers_in_place_of_automatic_sizes() -> None:
    chosen = Specimen(width_um=6.0).at_level("hex20", 1)
    assert (chosen.cell_kind, chosen.refined, chosen.automatic) == ("hex20", 1, False)
    assert (chosen.mesh_size, chosen.fine_mesh_size) == (3.0, 1.0)
    # What is written of it is a case with stated sizes.
    assert Specimen(**chosen.model_dump()).refined is None


@pytest.mark.parametrize("depth", [1.0, 3.464, 12.0])
@pytest.mark.parametrize("level", range(5))
def test_sizes_of_every_level_can_be_stated(level: int, depth: float) -> None:
    for kind in ("hex20", "tet10"):
        specimen = Specimen(width_um=3.7, depth_um=depth).at_level(kind, level)
        Specimen(**specimen.model_dump())
