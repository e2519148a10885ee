from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from driver.virtual.microscope.face_motion import Face
from driver.virtual.microscope.slip_steps import SlipSteps, cells_below, slip_steps
from meshes.arrays import FloatArray
from meshes.grain_boundary import GrainBoundary
from meshes.prism import CellKind, PrismGeometry, generate
from meshes.prism_mesh import PrismMesh
from meshes.surface import trace
from solver_adapters.crystal import BCC, bunge_matrix, slip_systems

SYSTEM, SPACING = 3, 0.5
SLIP = 0.01


@pytest.fixture(scope="module", params=get_args(CellKind))
def mesh(request: pytest.FixtureRequest) -> PrismMesh:
    geometry = PrismGeometry(4.0, 2.0, 1.7, (GrainBoundary((0.0, 2.0, 0.0), (0.1, 1.0, 0.2)),))
    return generate(geometry, 0.8, request.param)


@pytest.fixture(scope="module")
def face(mesh: PrismMesh) -> Face:
    return Face(trace(mesh))


ORIENTATIONS = np.array([bunge_matrix(281.0, 8.0, 47.0), bunge_matrix(211.0, 45.0, 150.0)])


def steps(mesh: PrismMesh, face: Face, amount: FloatArray, resolution: float) -> SlipSteps:
    """The steps where only one system slips, by an amount in each cell."""
    slip = np.zeros((1, len(mesh.cells), 24))
    slip[0, :, SYSTEM] = amount
    rng = np.random.default_rng(0)
    return slip_steps(mesh, face, slip, ORIENTATIONS, BCC, SPACING, resolution, rng)


def test_a_cell_of_the_face_belongs_to_the_cell_below_it(mesh: PrismMesh, face: Face) -> None:
    below = cells_below(mesh, face)
    for side, cell in zip(face.mesh.cells, below, strict=True):
        assert set(face.mesh.nodes[side]) <= set(mesh.cells[cell])


def test_uniform_slip_on_planes_makes_sharp_steps_of_the_burgers_height(
    mesh: PrismMesh, face: Face
) -> None:
    """With its smooth part γ m_Z ξ the height is a staircase: flat, with jumps of γ m_Z h."""
    directions, normals = slip_systems(BCC)
    n, rise = ORIENTATIONS[0] @ normals[SYSTEM], (ORIENTATIONS[0] @ directions[SYSTEM])[2]
    y = np.linspace(0.2, 1.4, 4001)
    x = np.zeros_like(y)
    found = steps(mesh, face, np.full(len(mesh.cells), SLIP), 0.002)(0, x, y)
    stairs = found + SLIP * rise * n[1] * y
    jump = SLIP * rise * SPACING * np.sign(n[1])
    slope = np.gradient(stairs, y)
    flat = np.abs(slope) < 1e-4 * abs(jump) / 0.002
    assert flat.mean() > 0.9
    # Over the range the staircase rises by a whole number of jumps.
    levels = (stairs[flat] - stairs[flat][0]) / jump
    np.testing.assert_allclose(levels, np.round(levels), atol=1e-3)
    assert round(levels[-1]) in (int(1.2 * abs(n[1]) / SPACING), int(1.2 * abs(n[1]) / SPACING) + 1)


def test_steps_have_no_mean_and_leave_a_grain_without_slip_alone(
    mesh: PrismMesh, face: Face
) -> None:
    made = steps(mesh, face, np.where(mesh.grain == 0, SLIP, 0.0), 0.05)
    x, y = np.random.default_rng(1).uniform((-1, 0), (1, 4), (20000, 2)).T
    height = made(0, x, y)
    grain = made.grain[face.locate(x, y)[0]]
    assert np.all(height[grain == 1] == 0.0)
    largest = np.abs(height).max()
    assert 2e-4 < largest < SLIP * SPACING / 2
    assert abs(height[grain == 0].mean()) < 0.05 * largest


def test_an_image_without_slip_has_no_steps(mesh: PrismMesh, face: Face) -> None:
    x, y = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(0, 4, 17))
    assert not steps(mesh, face, np.zeros(len(mesh.cells)), 0.05)(0, x, y).any()
