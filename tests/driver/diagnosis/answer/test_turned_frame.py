"""Rotations of the grains that are one turn of the frame are told as that."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from driver.diagnosis.answer.turned_frame import common_turn
from driver.diagnosis.answer.verdict import Verdict, with_turned_frame
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.ebsd_flips import FLIPS, frame_turn
from meshes.arrays import FloatArray

MEASURED = Rotation.from_euler("ZXZ", [[281, 8, 47], [211, 45, 150]], degrees=True).as_matrix()
CUBE = Rotation.create_group("O").as_matrix()
SIGMA = np.deg2rad(0.5)
COVARIANCE = SIGMA**2 * np.eye(6)


def nearest(turn: FloatArray, orientation: FloatArray) -> FloatArray:
    """Smallest rotation vector onto the lattice that a turn of the frame makes."""
    every = Rotation.from_matrix(turn @ orientation @ CUBE @ orientation.T)
    vectors = every.as_rotvec()
    return np.asarray(vectors[np.linalg.norm(vectors, axis=1).argmin()])


@pytest.mark.parametrize("flip", FLIPS, ids=lambda flip: flip.name)
@pytest.mark.parametrize("off", [0.0, 2.5])
def test_a_flip_is_known_by_the_lattices_that_it_makes(flip: Cause, off: float) -> None:
    """Also where the rotations ended some degrees away, as those of a run did by 1.9 and 3.0°."""
    turn = frame_turn((flip,))
    turns = np.array([nearest(turn, measured) for measured in MEASURED])
    away = np.deg2rad(off) * np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0]])
    told = common_turn(turns + away, COVARIANCE, MEASURED)
    assert flip.sentence in told
    if not off:
        assert told.startswith("The rotations of the grains end 0.0° and 0.0° from the lattices")


def test_a_small_turn_that_all_grains_share_is_told_with_axis_and_angle() -> None:
    shared = np.deg2rad(4.0) * np.array([0.0, 0.6, 0.8])
    noise = SIGMA * np.random.default_rng(3).normal(size=(2, 3))
    told = common_turn(shared + noise, COVARIANCE, MEASURED)
    assert told.startswith("The rotations of the grains agree within their σ (χ² ")
    assert "of 3) with one turn of the EBSD frame by 3." in told or "by 4." in told


def test_rotations_of_their_own_are_no_turn_of_the_frame() -> None:
    rng = np.random.default_rng(4)
    every = np.deg2rad(6.0) * rng.normal(size=(200, 2, 3))
    told = [common_turn(turns, COVARIANCE, MEASURED) for turns in every]
    # Of 200 pairs one or two are nearly the same by chance.
    assert sum(map(bool, told)) <= 2


def test_rotations_as_small_as_what_a_flip_leaves_of_them_are_no_flip() -> None:
    """A flip hardly turns lattices whose axes lie along those of the specimen."""
    along = Rotation.from_rotvec(np.deg2rad([[0.5, 0.0, 0.0], [0.0, 0.5, 0.0]])).as_matrix()
    turns = np.deg2rad([[0.0, 3.0, 0.0], [0.0, 0.0, -3.0]])
    assert common_turn(turns, COVARIANCE, along) == ""


def test_noise_is_no_turn() -> None:
    rng = np.random.default_rng(5)
    told = [common_turn(SIGMA * rng.normal(size=(2, 3)), COVARIANCE, MEASURED) for _ in range(200)]
    assert sum(map(bool, told)) <= 2


def test_only_a_verdict_without_a_name_tells_it() -> None:
    for kind, changed in (("unexplained", True), ("named", False)):
        verdict = Verdict(kind, (), "Text.", "Next.")  # type: ignore[arg-type]
        said = with_turned_frame(verdict, "The frame.")
        assert (said.text == "Text. The frame.") == changed
        assert ("orientation.ebsd_to_specimen" in said.next) == changed
    unexplained = Verdict("unexplained", (), "Text.", "Next.")
    assert with_turned_frame(unexplained, "") is unexplained
