from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from driver.experiment.history import knot_weights, read_history, turning_points
from driver.experiment.log_file import HistoryError

ALPHA = Path(__file__).parents[3] / "examples" / "alpha" / "history.csv"
# Two cycles with a hold before each image; the last cycle ends unloaded.
ROWS = [
    "0,0,0,0.5",
    "10,5,,", "40,5,1,100",
    "50,10,,", "80,10,2,150",
    "90,5,,", "120,5,3,20",
    "130,10,,", "160,10,4,120",
    "170,20,,", "200,20,5,180",
    "210,15,,", "240,15,6,30",
]  # fmt: skip


def write(
    tmp_path: Path, rows: Sequence[str] = ROWS, header: str = "time_s,stage_um,image,force_N"
) -> Path:
    path = tmp_path / "history.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_turning_points_stand_at_the_end_of_their_holds(tmp_path: Path) -> None:
    history = read_history(write(tmp_path))
    assert history.turning.tolist() == [0, 4, 6, 10, 12]
    assert history.stage[history.turning].tolist() == [0, 10, 5, 20, 15]


def test_a_cycle_is_a_loading_and_the_unloading_after_it(tmp_path: Path) -> None:
    history = read_history(write(tmp_path))
    assert history.cycle.tolist() == [1, 1, 1, 1, 2, 2, 2]
    assert history.image_row.tolist() == [0, 2, 4, 6, 8, 10, 12]
    assert history.force.tolist() == [0.5, 100, 150, 20, 120, 180, 30]


def test_the_example_has_three_cycles_and_seven_knots() -> None:
    history = read_history(ALPHA)
    assert history.stage[history.turning].tolist() == [0, 130, 100, 230, 200, 330, 300]
    assert np.bincount(history.cycle).tolist() == [0, 33, 32, 32]


def test_knot_weights_sum_to_one_and_reproduce_what_is_linear_in_stage_travel(
    tmp_path: Path,
) -> None:
    history = read_history(write(tmp_path))
    weights = knot_weights(history)
    assert weights.shape == (13, 5)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-15)
    np.testing.assert_allclose(weights @ history.stage[history.turning], history.stage)
    # Each knot is the value at its own turning point.
    np.testing.assert_array_equal(weights[history.turning], np.eye(5))


def test_a_motion_of_knots_is_constant_in_holds_and_halfway_at_half_the_travel(
    tmp_path: Path,
) -> None:
    history = read_history(write(tmp_path))
    motion = knot_weights(history) @ np.array([0.0, 8.0, 7.0, 16.0, 15.0])
    np.testing.assert_allclose(motion[[1, 2]], 4.0)
    np.testing.assert_array_equal(motion[1::2], motion[2::2])


def logged(rows: Sequence[int] | None, images_have_loads: bool) -> list[str]:
    """A test logged once a second: load 10 N/µm of travel and 0.1 N/s beside it."""
    knots = np.array([[float(cell) for cell in row.split(",")[:2]] for row in ROWS])
    image = {int(float(row.split(",")[0])): row.split(",")[2] for row in ROWS}
    lines = []
    for second in np.arange(0, 241):
        stage = np.interp(second, *knots.T)
        at_image = image.get(int(second), "") != ""
        force = f"{10 * stage + 0.1 * second:.6f}" if images_have_loads or not at_image else ""
        lines.append(f"{second},{stage:.6f},{image.get(int(second), '')},{force}")
    return lines if rows is None else [lines[k] for k in rows]


def test_of_a_log_of_loads_only_the_rows_at_which_the_travel_bends_are_instants(
    tmp_path: Path,
) -> None:
    history = read_history(write(tmp_path, logged(None, True)))
    plain = read_history(write(tmp_path))
    np.testing.assert_array_equal(history.time, plain.time)
    np.testing.assert_allclose(history.stage, plain.stage)
    np.testing.assert_array_equal(history.image_row, plain.image_row)
    np.testing.assert_array_equal(history.turning, plain.turning)
    rows = history.image_row
    np.testing.assert_allclose(history.force, 10 * history.stage[rows] + 0.1 * history.time[rows])


def test_an_image_without_a_load_has_that_of_the_log_around_it(tmp_path: Path) -> None:
    # Images 1 to 5 between two rows of the log, the first and the last with their own loads.
    lines = logged(None, False)
    lines[0], lines[-1] = "0,0,0,0", "240,15,6,174"
    history = read_history(write(tmp_path, lines))
    # A second before an image the stage holds, a second after it moves by 0.5 or 1 µm.
    hold = 10 * history.stage + 0.1 * history.time
    moved = 5 * np.array([0, 0.5, -0.5, 0.5, 1, -0.5, 0])
    np.testing.assert_allclose(history.force, hold[history.image_row] + moved, atol=1e-6)


def test_without_images_every_load_stands_for_itself(tmp_path: Path) -> None:
    rows = [",".join([*row.split(",")[:2], "", row.split(",")[3]]) for row in ROWS]
    history = read_history(write(tmp_path, rows), with_images=False)
    assert history.image_row.tolist() == [0, 2, 4, 6, 8, 10, 12]
    assert history.force.tolist() == [0.5, 100, 150, 20, 120, 180, 30]
    with pytest.raises(HistoryError, match="force_N: found 1 loads, expected at least two"):
        read_history(write(tmp_path, ["0,0,,1", "10,5,,"]), with_images=False)


def test_encoder_noise_in_a_hold_is_no_reversal() -> None:
    up_and_down = np.r_[np.linspace(0, 100, 41), np.linspace(97.5, 50, 20)]
    clean = turning_points(up_and_down)
    assert clean.tolist() == [0, 40, 60]
    noisy = up_and_down + 0.3 * (-1.0) ** np.arange(up_and_down.size)
    np.testing.assert_array_equal(turning_points(noisy), clean)


def test_numbers_of_images_may_be_written_as_floats(tmp_path: Path) -> None:
    """As pandas does where the column has gaps."""
    path = tmp_path / "history.csv"
    rows = "time_s,stage_um,image,force_N\n0.0,0.0,0.0,1.0\n1.0,2.0,,\n2.0,2.0,1.0,5.0\n"
    path.write_text(rows)
    assert read_history(path).image_row.tolist() == [0, 2]
    path.write_text(rows.replace("2.0,1.0,5.0", "2.0,1.5,5.0"))
    with pytest.raises(HistoryError, match="image: found 1.5, expected 1, for images"):
        read_history(path)


@pytest.mark.parametrize(
    ("row", "text", "place", "found", "expected"),
    [
        (4, "80,10,2,", "row 6, force_N", "nothing", "the load of image 2"),
        (4, "80,10,3,150", "row 6, image", "3", "2, for images are numbered 0, 1, 2"),
        (3, "40,10,,", "row 5, time_s", "40", "more than the 40 s before it"),
        (3, "50,ten,,", "row 5, stage_um", '"ten"', "a number"),
        (3, "nan,10,,", "row 5, time_s", '"nan"', "a number"),
        (3, "50", "row 5, stage_um", "nothing", "a number"),
    ],
)
def test_a_wrong_row_is_named_with_file_row_found_and_expected(
    tmp_path: Path, row: int, text: str, place: str, found: str, expected: str
) -> None:
    path = write(tmp_path, [*ROWS[:row], text, *ROWS[row + 1 :]])
    with pytest.raises(HistoryError) as error:
        read_history(path)
    assert str(error.value).startswith(f"{path}: {place}: found {found}, expected {expected}")


def test_a_missing_column_and_a_missing_file_are_named(tmp_path: Path) -> None:
    path = write(tmp_path, header="time_s,stage_mm,image,force_N")
    with pytest.raises(HistoryError) as error:
        read_history(path)
    assert str(error.value) == (
        f"{path}: row 1: found time_s,stage_mm,image,force_N, expected the column stage_um, or "
        'stage = {name = "stage_mm", unit = "mm"} under [history.columns]'
    )
    with pytest.raises(HistoryError, match="absent.csv: file: found nothing, expected a CSV"):
        read_history(tmp_path / "absent.csv")
    with pytest.raises(HistoryError, match="history.file: found “Is a directory”, expected a CSV"):
        read_history(tmp_path)
    with pytest.raises(HistoryError, match="history.file: found “File name too long”, expected"):
        read_history(tmp_path / ("a" * 300))


def test_decimal_commas_and_a_doubled_column_are_refused_rather_than_misread(
    tmp_path: Path,
) -> None:
    path = write(tmp_path, [*ROWS[:2], "40,5,1,100,25", *ROWS[3:]])
    with pytest.raises(HistoryError) as error:
        read_history(path)
    assert str(error.value) == (
        f'{path}: row 4: found 5 cells, expected 4, as the columns, parted by ",", with "." in the '
        "numbers (numbers with decimal commas need another separator)"
    )
    path = write(tmp_path, [row + ",1" for row in ROWS], "time_s,stage_um,image,force_N,force_N")
    with pytest.raises(HistoryError) as error:
        read_history(path)
    assert str(error.value) == (
        f"{path}: row 1: found the column force_N 2 times, expected each column once, or its "
        'number, as force = {name = 4, unit = "N"} under [history.columns]'
    )


def test_empty_cells_behind_the_last_column_are_no_data(tmp_path: Path) -> None:
    trailing = read_history(write(tmp_path, [row + ",," for row in ROWS]))
    np.testing.assert_array_equal(trailing.force, read_history(write(tmp_path)).force)


def test_a_stage_that_never_moves_and_a_lone_image_are_refused(tmp_path: Path) -> None:
    with pytest.raises(HistoryError, match="stage_um: found 5 in every row, expected a stage that"):
        read_history(write(tmp_path, ["0,5,0,1", "10,5,1,2"]))
    with pytest.raises(HistoryError, match="image: found 1 images, expected image 0 and at least"):
        read_history(write(tmp_path, ["0,0,0,1", "10,5,,"]))


def test_loads_may_be_absent_where_none_are_needed(tmp_path: Path) -> None:
    path = tmp_path / "history.csv"
    path.write_text("time_s,stage_um,image\n0,0,0\n10,5,\n40,5,1\n", encoding="utf-8")
    found = read_history(path, with_loads=False)
    assert found.n_images == 2
    np.testing.assert_array_equal(found.force, 0.0)
    with pytest.raises(HistoryError, match="force_N"):
        read_history(path)


def test_a_quote_that_is_not_closed_is_told_by_its_row_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "history.csv"
    path.write_text('time_s,stage_um,image,force_N\n0,0,0,0\n10,"5,1,1\n20,10,2,2\n30,0,3,0\n')
    with pytest.raises(HistoryError, match="expected each quote closed in its row$") as refused:
        read_history(path)
    assert len(str(refused.value).splitlines()) == 1


def test_what_has_no_end_is_no_history(tmp_path: Path) -> None:
    with pytest.raises(HistoryError, match="^/dev/zero: file: found no regular file, expected a"):
        read_history(Path("/dev/zero"))
    path = tmp_path / "history.csv"
    with path.open("wb") as file:
        file.truncate(60_000_000)
    with pytest.raises(HistoryError, match="found 60 MB, expected a CSV file of at most 50 MB"):
        read_history(path)
