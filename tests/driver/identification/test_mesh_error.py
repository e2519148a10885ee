"""What two meshes tell of a third one."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from driver.forward.mesh_extrapolation import lacking_share
from driver.identification.mesh_error import load_left, patterns_left, share_left
from meshes.arrays import FloatArray
from meshes.grain_boundary import GrainBoundary
from meshes.prism import CellKind, PrismGeometry, generate
from meshes.prism_mesh import PrismMesh
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.interface import Simulation
from solver_adapters.material import Material
from tools.boxes import ORIENTATIONS

CHANGE = np.array([0.0, -2.0, 1.0])
LOAD = np.array([0.0, 700.0, -300.0])
MOTION = np.linspace(-1.0, 1.0, 12).reshape(3, 2, 2)
PRISM = PrismGeometry(length=6.0, boundaries=(GrainBoundary((0.0, 3.2, 0.0), (0.15, 1.0, 0.3)),))


@cache
def mesh(kind: CellKind, size: float) -> PrismMesh:
    return generate(PRISM, size, kind)


def forces(specimen: PrismMesh) -> FloatArray:
    """Load [µN] of a prism that is pulled far beyond its yield."""
    ends = np.concatenate([specimen.nodes["S_MINUS"], specimen.nodes["S_PLUS"]])
    strains = np.array([0.0, 0.002, 0.004, 0.008, 0.012])
    stretched = specimen.points[ends] * [0.0, 1.0, 0.0] * (specimen.points[ends, 1:2] > 3.0)
    simulation = Simulation(
        mesh=specimen,
        material=Material(strain_measure="small"),
        orientations=ORIENTATIONS,
        times=np.arange(strains.size) * np.float64(20.0),
        motion_nodes=ends,
        motion_mask=np.ones((ends.size, 3), dtype=np.bool_),
        motion=strains[:, None, None] * stretched,
        output=np.arange(strains.size),
        output_nodes=np.arange(1),
        mean_dilatation=True,
    )
    return BundledAdapter().solve(simulation).force


@pytest.mark.slow
def test_the_extrapolated_load_is_that_of_tetrahedra_in_the_limit() -> None:
    """Cells of another kind judge: their loads fall with the first power of their size."""
    working, finer = mesh("hex20", 2.0), mesh("hex20", 1.0)
    coarse, fine, larger, smaller = (
        forces(specimen) for specimen in (working, finer, mesh("tet10", 0.8), mesh("tet10", 0.42))
    )
    limit = smaller - (larger - smaller) * 0.42 / (0.8 - 0.42)
    extrapolated = fine + lacking_share(working, finer).load * (fine - coarse)
    off = [float(np.linalg.norm(load - limit)) for load in (coarse, fine, extrapolated)]
    assert off[1] < 0.5 * off[0]
    assert off[2] < 0.5 * off[1]


def test_of_tetrahedra_as_much_is_left_as_was_corrected_where_the_size_is_halved() -> None:
    """First order: e(h) − e(h/2) = e(h/2). Of independent errors the finer one keeps a fifth."""
    tetrahedra = mesh("tet10", 2.0)
    assert share_left(tetrahedra, (2.0, 1.0)) == pytest.approx(1.0)
    ((motion, load),) = patterns_left(tetrahedra, (2.0, 1.0), (MOTION, CHANGE), LOAD)
    np.testing.assert_allclose(motion**2, 0.25 / 1.25 * MOTION**2)
    np.testing.assert_allclose(load**2, 0.25 / 1.25 * CHANGE**2)
    np.testing.assert_allclose(load_left(tetrahedra, (2.0, 1.0), CHANGE, LOAD), CHANGE)


@pytest.mark.parametrize(("finer", "measured"), [(1.0, 0.42), (0.667, 0.16), (0.5, 0.075)])
def test_of_hexahedra_is_left_what_ten_specimens_left_in_the_mean(
    finer: float, measured: float
) -> None:
    """Of a working mesh of one cell on half of a side; two cells err by half as much."""
    share = share_left(mesh("hex20", 2.0), (2.0, finer))
    assert share == pytest.approx(measured, rel=0.06)
    assert share_left(mesh("hex20", 1.0), (1.0, 0.5)) == pytest.approx(0.15795, rel=1e-3)


def test_of_five_cells_no_less_is_stated_than_one_specimen_left() -> None:
    """0.03, against a reference that these very cells have a part in."""
    assert 0.03 <= share_left(mesh("hex20", 2.0), (2.0, 0.4)) <= 0.05


def test_of_a_load_on_hexahedra_a_share_of_itself_is_left_whatever_the_correction() -> None:
    """Of ten specimens 0.13 to 0.42 % with two cells on half of a side, 0.05 to 0.15 with 3."""
    hexahedra = mesh("hex20", 2.0)
    left = load_left(hexahedra, (2.0, 1.0), CHANGE, LOAD)
    np.testing.assert_allclose(left, left[1] / LOAD[1] * LOAD)
    assert 0.0013 < left[1] / LOAD[1] < 0.0042
    finer = load_left(hexahedra, (2.0, 0.667), CHANGE, LOAD)
    assert 0.0005 < finer[1] / LOAD[1] < 0.0015
    np.testing.assert_array_equal(load_left(hexahedra, (2.0, 1.0), 0 * CHANGE, LOAD), left)


def test_scores_and_covariance_count_the_same_of_hexahedra() -> None:
    hexahedra = mesh("hex20", 2.0)
    images, loads = patterns_left(hexahedra, (2.0, 1.0), (MOTION, CHANGE), LOAD)
    np.testing.assert_allclose(images[0], share_left(hexahedra, (2.0, 1.0)) * MOTION)
    np.testing.assert_allclose(loads[1], load_left(hexahedra, (2.0, 1.0), CHANGE, LOAD))
    assert not np.any(images[1]) and not np.any(loads[0])
