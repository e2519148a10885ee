"""Numbers behind the pictures of free correlation."""

from dataclasses import replace

import numpy as np
import pytest

from driver.report.measured import MeasuredMotion, peaks, phases
from tests.driver.invented_results import CYCLE, NODAL_SIGMA, PEAKS, STAGE


def test_images_at_the_ends_of_loading_are_shown(measured: MeasuredMotion) -> None:
    assert tuple(measured.shown) == PEAKS
    many = replace(measured, stage=np.tile([0.0, 1.0], 9), cycle=np.repeat(np.arange(1, 10), 2))
    assert many.shown.tolist() == [1, 7, 11, 17]


def test_phases_follow_each_other_without_a_gap() -> None:
    found = phases(np.array(STAGE), np.array(CYCLE))
    assert [(loading, images.tolist()) for loading, images in found] == [
        (True, [0, 1, 2, 3]), (False, [3, 4, 5]), (True, [5, 6, 7, 8]), (False, [8, 9, 10]),
    ]  # fmt: skip


def test_a_test_that_ends_at_its_largest_travel_has_no_last_unloading() -> None:
    stage, cycle = np.array([0.0, 1.0, 0.5, 2.0]), np.array([1, 1, 1, 2])
    assert peaks(stage, cycle).tolist() == [1, 3]
    assert [loading for loading, _ in phases(stage, cycle)] == [True, False, True]


def test_a_shift_of_the_stage_is_not_shown_as_motion(measured: MeasuredMotion) -> None:
    assert measured.motion.mean(axis=1) == pytest.approx(np.zeros((len(PEAKS), 3)), abs=1e-15)
    # Nodes and pixels are freed of the same shift: v is linear in Y for both.
    face = measured.face
    y = (face.cols - face.origin[1]) * face.pixel
    slope, offset = np.polyfit(y, measured.motion[-1, :, 1], 1)
    nodal = measured.nodal_uv[-1, :, 1]
    assert nodal == pytest.approx(slope * measured.nodes_uv[:, 1] + offset, abs=1e-12)


def test_the_mesh_is_enlarged_by_a_round_factor_that_keeps_it_in_the_picture(
    measured: MeasuredMotion,
) -> None:
    # ± 30 nm over 104 pixels of 110 nm: 8 % of them is 30 times that.
    assert measured.exaggeration == 20.0
    assert replace(measured, motion=10 * measured.motion).exaggeration == 2.0
    assert replace(measured, motion=0 * measured.motion).exaggeration == 1.0


def test_the_deviation_of_a_node_holds_the_noise_of_the_reference(measured: MeasuredMotion) -> None:
    assert measured.nodal_sigma == pytest.approx(NODAL_SIGMA)
