from __future__ import annotations

import numpy as np
import pytest

from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.ebsd_flips import (
    ACROSS,
    FLIPS,
    HALF_TURNS,
    disorientation,
    flips_of,
    frame_turn,
)
from driver.experiment.orientations import orientations_of
from meshes.arrays import FloatArray
from solver_adapters.crystal import BCC, bunge_matrix, rotation_vector_matrix, schmid_tensors
from tools import closed_form

X, Y, Z = HALF_TURNS
MIRRORS = {X: [-1.0, 1.0, 1.0], Y: [1.0, -1.0, 1.0], Z: [1.0, 1.0, -1.0]}


def grain(*degrees: float) -> FloatArray:
    return bunge_matrix(*degrees)


def schmid_set(orientation: FloatArray) -> set[tuple[float, ...]]:
    """The Schmid tensors of a crystal in the specimen, whichever system each belongs to."""
    turned = orientation @ schmid_tensors(BCC) @ orientation.T
    both = np.concatenate([turned, -turned]).reshape(-1, 9)
    return {tuple(row) for row in (np.round(both, 6) + 0.0).tolist()}


@pytest.mark.parametrize("flip", HALF_TURNS, ids=lambda flip: flip.name)
def test_a_flip_is_a_half_turn_and_a_mirrored_frame_slips_on_the_same_systems(
    flip: Cause,
) -> None:
    turn = frame_turn((flip,))
    np.testing.assert_array_equal(turn @ turn, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0) and np.trace(turn) == -1.0
    orientation = grain(281.0, 8.0, 47.0)
    mirrored = np.diag(MIRRORS[flip]) @ orientation
    assert schmid_set(mirrored) == schmid_set(turn @ orientation)
    assert schmid_set(mirrored) != schmid_set(orientation)


def test_two_flips_are_the_third() -> None:
    np.testing.assert_array_equal(frame_turn((X, Y)), frame_turn((Z,)))
    np.testing.assert_array_equal(frame_turn(()), np.eye(3))


@pytest.mark.parametrize("angle", [0.0, 1.0, 17.0, 44.0])
def test_the_disorientation_of_a_small_turn_is_its_angle(angle: float) -> None:
    """About ⟨100⟩, where the cube comes back after 90°."""
    orientation = grain(20.0, 30.0, 40.0)
    turn = rotation_vector_matrix(np.deg2rad(angle) * orientation[:, 2])
    assert disorientation(turn, orientation) == pytest.approx(angle, abs=1e-5)
    quarter = rotation_vector_matrix(0.5 * np.pi * orientation[:, 2])
    assert disorientation(quarter @ turn, orientation) == pytest.approx(angle, abs=1e-5)


def test_flips_are_all_turns_that_keep_the_normal_and_the_axes_of_the_face_up_to_their_names() -> (
    None
):
    turns = [frame_turn((flip,)) for flip in FLIPS]
    every = {tuple(turn.ravel()) for turn in (*turns, np.eye(3))}
    assert len(every) == 8
    for one in turns:
        assert np.linalg.det(one) == pytest.approx(1.0) and abs(one[2, 2]) == 1.0
        assert all(tuple((one @ other + 0.0).ravel()) in every for other in turns)


def test_turns_across_are_about_the_axes_that_they_name() -> None:
    quarter, back, diagonal, other = (frame_turn((flip,)) for flip in ACROSS)
    about_z = rotation_vector_matrix(np.array([0.0, 0.0, 0.5 * np.pi]))
    np.testing.assert_allclose(quarter, about_z, atol=1e-15)
    np.testing.assert_allclose(back, about_z.T, atol=1e-15)
    for turn, sign in ((diagonal, 1.0), (other, -1.0)):
        axis = np.pi * np.array([1.0, sign, 0.0]) / np.sqrt(2.0)
        np.testing.assert_allclose(turn, rotation_vector_matrix(axis), atol=1e-15)


def test_grains_of_no_special_orientation_tell_all_flips_apart() -> None:
    kept, left = flips_of(orientations_of(closed_form.small_case()), None)
    assert kept == FLIPS and not left


def test_a_lattice_along_the_specimen_has_no_flip() -> None:
    names = tuple(flip.name for flip in HALF_TURNS)
    kept, left = flips_of(np.stack([np.eye(3), grain(0.0, 45.0, 0.0)]), names)
    # The second grain is turned about X by 45°: half turns about Y and Z come to the same there.
    assert not kept and {one.cause for one in left} == set(names)
    assert all("changes no lattice" in one.why for one in left)


def test_flips_that_make_the_same_lattices_are_tried_once() -> None:
    """Both crystals keep a cube axis along Y: Y is no flip of theirs, X and Z are the same."""
    about_Y = [rotation_vector_matrix(np.array([0.0, angle, 0.0])) for angle in (0.3, 1.0)]
    kept, left = flips_of(np.stack(about_Y), tuple(flip.name for flip in HALF_TURNS))
    assert kept == (X,)
    assert {one.cause: one.why for one in left} == {
        Y.name: "it changes no lattice of this specimen",
        Z.name: "it makes the same lattices as EBSD frame turned by half a turn about X",
    }


def test_only_wanted_flips_are_tried() -> None:
    orientations = orientations_of(closed_form.small_case())
    assert flips_of(orientations, (Y.name, "load_gain")) == ((Y,), ())
    assert flips_of(orientations, ("load_gain",)) == ((), ())
