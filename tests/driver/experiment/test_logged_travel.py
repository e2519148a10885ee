"""Logs of a known stage travel with noise: what is found is what was put in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from driver.experiment.history import History, read_history, travel_told, turning_points
from driver.experiment.logged_travel import instants, noise_of_travel
from meshes.arrays import FloatArray

EXAMPLES = Path(__file__).parents[3] / "examples"
# Ten stops of 10 s of move and 30 s of hold, with an image at the end of each.
STOPS = [0, 5, 10, 15, 20, 15, 10, 20, 25, 20, 15]
TIME = np.r_[0.0, np.ravel([(40.0 * k + 10.0, 40.0 * k + 40.0) for k in range(10)])]
STAGE = np.array([0.0, *np.repeat(STOPS[1:], 2)], dtype=np.float64)
IMAGES = [0, *range(2, 21, 2)]
TURNING = [0, 8, 12, 16, 20]


def logged(rows: int, noise: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """Times and travel of a log; the beginning of a hold is not one of its rows."""
    rng = np.random.default_rng(seed)
    time = np.unique(np.r_[np.linspace(0.0, 400.0, rows), TIME[IMAGES]])
    return time, np.interp(time, TIME, STAGE) + rng.normal(0.0, noise, time.size)


def read(path: Path, time: FloatArray, stage: FloatArray) -> History:
    image = {instant: number for number, instant in enumerate(TIME[IMAGES])}
    lines = [
        f"{t:.5f},{s:.6f},{image.get(t, '')},{10.0 * s:.3f}"
        for t, s in zip(time, stage, strict=True)
    ]
    path.write_text("\n".join(["time_s,stage_um,image,force_N", *lines]))
    return read_history(path)


@pytest.mark.parametrize("rows", [400, 4000])
@pytest.mark.parametrize("noise", [0.005, 0.02, 0.1])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_log_with_noise_has_the_instants_and_cycles_of_the_test(
    tmp_path: Path, rows: int, noise: float, seed: int
) -> None:
    history = read(tmp_path / "history.csv", *logged(rows, noise, seed))
    assert history.stage_noise == pytest.approx(noise, rel=0.2)
    assert history.time.size == TIME.size
    # A move begins and ends between two rows.
    np.testing.assert_allclose(history.time, TIME, atol=400.0 / rows + 2.0 * noise)
    np.testing.assert_allclose(history.stage, STAGE, atol=2.0 * noise + 5.0 / rows)
    assert history.turning.tolist() == TURNING
    assert history.cycle.tolist() == [1] * 7 + [2] * 4
    # A hold is one, to the last digit: ten of the intervals.
    np.testing.assert_array_equal(np.diff(history.stage) == 0.0, np.diff(STAGE) == 0.0)


def test_of_a_hold_of_few_rows_the_bend_is_found_by_all_rows_about_it() -> None:
    # A hold of 5 s behind 20 s of move: off the chord by 1 µm, ten σ.
    time_of_stops = np.array([0.0, 20.0, 25.0, 45.0, 50.0])
    time = np.linspace(0.0, 50.0, 101)
    stage = np.interp(time, time_of_stops, [0.0, 5.0, 5.0, 10.0, 10.0])
    stage += np.random.default_rng(4).normal(0.0, 0.1, time.size)
    rows, travel = instants(time, stage, np.isin(time, [0.0, 25.0, 50.0]), 0.1)
    np.testing.assert_allclose(time[rows], time_of_stops, atol=1.0)
    np.testing.assert_allclose(travel, [0.0, 5.0, 5.0, 10.0, 10.0], atol=0.15)


@pytest.mark.parametrize("rows", [41, 400, 4000])
def test_a_log_without_noise_has_none(rows: int) -> None:
    time, stage = logged(rows, 0.0, 0)
    everywhere = np.ones(time.size, dtype=bool)
    assert noise_of_travel(time, np.round(stage, 6), everywhere) == 0.0
    smooth = 20.0 * np.sin(np.linspace(0.0, 7.0, time.size))
    assert noise_of_travel(time, smooth, everywhere) == 0.0


def test_a_history_of_stops_alone_has_no_noise() -> None:
    # Each row begins or ends a move: nothing in it is as straight as to tell noise.
    stops = np.random.default_rng(5).uniform(1.0, 6.0, 100).cumsum()
    time = np.r_[0.0, np.ravel([(40.0 * k + 10.0, 40.0 * k + 40.0) for k in range(100)])]
    stage = np.r_[0.0, np.repeat(stops, 2)]
    assert noise_of_travel(time, stage, np.ones(time.size, dtype=bool)) == 0.0


def test_the_example_is_read_as_it_stands() -> None:
    path = EXAMPLES / "alpha" / "history.csv"
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    history = read_history(path)
    assert history.stage_noise == 0.0
    np.testing.assert_array_equal(history.time, table[:, 0])
    np.testing.assert_array_equal(history.stage, table[:, 1])
    loads = read_history(path, with_images=False)
    assert loads.stage_noise == 0.0 and loads.turning.tolist() == history.turning.tolist()


@pytest.mark.parametrize("noise", [0.005, 0.1])
def test_reversals_of_the_noise_are_none_where_every_row_is_an_instant(noise: float) -> None:
    time, stage = logged(4000, noise, 6)
    found = noise_of_travel(time, stage, np.ones(time.size, dtype=bool))
    turning = turning_points(stage, found)
    np.testing.assert_allclose(stage[turning], STAGE[TURNING], atol=5.0 * noise)


def test_what_was_found_is_told(tmp_path: Path) -> None:
    history = read(tmp_path / "history.csv", *logged(4000, 0.02, 7))
    said = travel_told(history)
    assert said.startswith("the stage turns at ")
    assert said.endswith(
        "noise of 0.02 µm, so that it turns where it goes back by more than 0.2 µm"
    )
