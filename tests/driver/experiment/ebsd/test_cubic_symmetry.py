"""Disorientations and means of cubic crystals, against orix and against what was put in."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from driver.diagnosis.causes.ebsd_flips import disorientation
from driver.experiment.ebsd.cubic_symmetry import (
    disorientations,
    mean_orientation,
    nearest_equivalents,
)
from driver.experiment.ebsd.orix_library import compiled_apart
from meshes.arrays import FloatArray
from tests.driver.ebsd_files import FIRST

with compiled_apart():
    from orix.quaternion import Orientation
    from orix.quaternion.symmetry import O, Oh

CENTRE = Rotation.from_euler("ZXZ", FIRST, degrees=True)


def quaternions(rotations: Rotation) -> FloatArray:
    return np.asarray(rotations.as_quat(scalar_first=True))


def any_equivalents(rotations: Rotation, seed: int) -> Rotation:
    """Each rotation times a cubic one of chance, drawn from the group of orix."""
    chosen = np.random.default_rng(seed).integers(O.size, size=len(rotations))
    # orix turns the sample to the crystal, and so do its symmetries.
    return rotations * Rotation.from_quat(O.data[chosen], scalar_first=True)


@pytest.mark.parametrize("symmetry", [O, Oh], ids=["432", "m-3m"])
def test_disorientations_are_those_of_orix(symmetry: object) -> None:
    rng = np.random.default_rng(1)
    first, second = Rotation.random(200, rng=rng), Rotation.random(200, rng=rng)
    to_crystal, other = (
        Orientation(quaternions(turn.inv()), symmetry=symmetry) for turn in (first, second)
    )
    expected = to_crystal.angle_with(other)
    found = disorientations(quaternions(first), quaternions(second))
    np.testing.assert_allclose(found, expected, atol=1e-7)
    assert np.rad2deg(found.max()) < 62.8 + 1e-6  # the largest there is, Mackenzie (1958)


def test_they_are_those_of_the_half_turns() -> None:
    rng = np.random.default_rng(2)
    first, second = Rotation.random(20, rng=rng), Rotation.random(20, rng=rng)
    one_by_one = [
        disorientation((b * a.inv()).as_matrix(), a.as_matrix())
        for a, b in zip(first, second, strict=True)
    ]
    found = np.rad2deg(disorientations(quaternions(first), quaternions(second)))
    np.testing.assert_allclose(found, one_by_one, atol=1e-6)


def test_equivalents_are_the_same_crystal_and_near() -> None:
    scattered = Rotation.from_rotvec(np.random.default_rng(3).normal(0, 0.02, (50, 3))) * CENTRE
    other = quaternions(any_equivalents(scattered, 4))
    found = nearest_equivalents(other, quaternions(CENTRE))
    np.testing.assert_allclose(found, quaternions(scattered), atol=1e-12)


def test_the_mean_of_a_grain_does_not_hang_on_how_its_points_are_written() -> None:
    # Turns of ±4° about each axis about a centre: their mean is the centre.
    turns = np.concatenate([np.eye(3), -np.eye(3)]) * np.deg2rad(4.0)
    scattered = any_equivalents(Rotation.from_rotvec(turns) * CENTRE, 5)
    points = quaternions(scattered)
    for start in points:
        mean = mean_orientation(points, start)
        angle = disorientations(mean[None], quaternions(CENTRE)[None])
        assert angle < 1e-7
