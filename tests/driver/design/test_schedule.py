from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from driver.design.schedule import carried_on, changed, compressed, scale_dwells, with_stops
from driver.design.settings import Schedule
from driver.experiment.history import knot_weights
from driver.parameters.boundary import elongation_names, tilt_names
from driver.virtual.settings import Program
from driver.virtual.truth import knots, stage_program

# Two cycles: to 15 µm and back by 5, to 30 µm and back by 10; a hold of 30 s before each image.
HISTORY = stage_program([(3, 1), (4, 2)])


def test_a_leg_of_compression_goes_back_by_the_last_loading_with_its_stops_and_holds() -> None:
    longer = compressed(HISTORY)
    assert longer.stage[-1] == HISTORY.stage[-1] - 20.0
    assert longer.n_images == HISTORY.n_images + 4
    # The stage does not turn between unloading and compression: it is one phase.
    assert longer.n_knots == HISTORY.n_knots
    np.testing.assert_array_equal(longer.time[: HISTORY.time.size], HISTORY.time)
    added, steps = np.diff(longer.stage)[-8:], np.diff(longer.time)[-8:]
    np.testing.assert_allclose(added[::2], -5.0)
    np.testing.assert_allclose(steps, np.tile([10.0, 30.0], 4))
    np.testing.assert_array_equal(
        longer.image_row[-4:], longer.time.size - 1 - np.arange(0, 8, 2)[::-1]
    )


def test_the_motion_goes_on_at_the_pace_of_the_last_unloading() -> None:
    known = knots(HISTORY, Program(), 12.0)
    longer = compressed(HISTORY)
    found = carried_on(known, HISTORY, longer)
    for names in (elongation_names, tilt_names):
        before, after = (
            knot_weights(h) @ np.array([0.0, *(values[n] for n in names(h.n_knots))])
            for h, values in ((HISTORY, known), (longer, found))
        )
        # What was done before is unchanged, and the leg is the same straight line.
        np.testing.assert_allclose(after[: before.size], before, atol=1e-12)
        pace = (before[-1] - before[-5]) / (HISTORY.stage[-1] - HISTORY.stage[-5])
        assert after[-1] == pytest.approx(before[-1] - 20.0 * pace)


def test_a_history_that_ends_loaded_gets_a_knot_more() -> None:
    loaded = stage_program([(3, 1), (4, 1)])
    rows = slice(0, -2)  # without the last unloading
    loaded = replace(
        loaded, time=loaded.time[rows], stage=loaded.stage[rows], image_row=loaded.image_row[:-1],
        force=loaded.force[:-1], cycle=loaded.cycle[:-1],
        turning=np.array([*loaded.turning[:-2], loaded.time.size - 3]),
    )  # fmt: skip
    longer = compressed(loaded)
    assert longer.n_knots == loaded.n_knots + 1
    known = knots(loaded, Program(), 12.0)
    found = carried_on(known, loaded, longer)
    # The first cycle gave back 7.2 nm over 5 µm of travel; the leg is 20 µm long.
    last = elongation_names(longer.n_knots)[-1]
    assert found[last] == pytest.approx(known[elongation_names(loaded.n_knots)[-1]] - 4 * 7.2e-3)


def test_more_stops_part_the_moves_and_each_has_hold_and_image() -> None:
    finer = with_stops(HISTORY, 2)
    assert finer.n_images == 2 * HISTORY.n_images - 1
    moves = np.diff(finer.stage)
    np.testing.assert_allclose(np.abs(moves[moves != 0]), 2.5)
    holds = np.diff(finer.time)[moves == 0]
    np.testing.assert_allclose(holds, 30.0)
    assert set(HISTORY.stage[HISTORY.image_row]) <= set(finer.stage[finer.image_row])
    np.testing.assert_allclose(finer.stage[finer.turning], HISTORY.stage[HISTORY.turning])
    assert np.all(np.diff(finer.time) > 0)


def test_stops_without_holds_are_parted_too() -> None:
    rows = np.array([0, 2, 4, 6])  # images at the ends of holds, the holds left out
    moving = replace(
        HISTORY, time=np.array([0.0, 10, 20, 30]), stage=np.array([0.0, 5, 10, 5]),
        image_row=np.arange(4), turning=np.array([0, 2, 3]), force=np.zeros(4), cycle=rows * 0,
    )  # fmt: skip
    finer = with_stops(moving, 2)
    np.testing.assert_allclose(finer.time, np.arange(0, 31, 5))
    np.testing.assert_array_equal(finer.image_row, np.arange(7))


def test_longer_holds_leave_the_moves_as_they_are() -> None:
    longer = scale_dwells(HISTORY, 10.0)
    steps, before = np.diff(longer.time), np.diff(HISTORY.time)
    held = np.diff(HISTORY.stage) == 0
    np.testing.assert_allclose(steps[held], 10 * before[held])
    np.testing.assert_allclose(steps[~held], before[~held])


def test_no_change_is_no_change() -> None:
    same = changed(HISTORY, Schedule())
    np.testing.assert_array_equal(same.time, HISTORY.time)
    np.testing.assert_array_equal(same.image_row, HISTORY.image_row)
