"""Logs as load frames and people write them; the texts are written out, or by the csv module."""

from __future__ import annotations

import csv
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from driver.case.history import HistoryTable
from driver.experiment.history import History, read_history
from driver.experiment.log_file import HistoryError

# What every log below says: s, µm, N.
TIME, STAGE, FORCE = [0.0, 90.0, 180.0, 270.0], [0.0, 5.0, 10.0, 7.5], [500.0, 100.0, 0.0, 200.0]
FRAME = """Sample 12, tensile
Operator: N. N.; 3 mm²

Time;Displ.;Image;Load
min;mm;;kN
0,0;0,000;0;0,5
1,5;0,005;1;0,1

3,0;1,0E-2;2;0
4,5;0,0075;3;0,2
"""
PLAIN = "time_s,stage_um,image,force_N\n0,0,0,500\n90,5,1,100\n180,10,2,0\n270,7.5,3,200\n"
COLUMNS = {
    "time": {"name": "Time", "unit": "min"},
    "stage": {"name": "Displ.", "unit": "mm"},
    "image": {"name": "Image"},
    "force": {"name": "Load", "unit": "kN"},
}


def read(path: Path, text: str | bytes, **keys: Any) -> History:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_history(path, stated=HistoryTable.model_validate({"file": "log.csv", **keys}))


def assert_as_said(history: History) -> None:
    np.testing.assert_allclose(history.time, TIME)
    np.testing.assert_allclose(history.stage, STAGE)
    np.testing.assert_allclose(history.force, FORCE)
    assert history.image_row.tolist() == [0, 1, 2, 3]


def in_order(error: HistoryError) -> dict[str, Any]:
    """The keys that a refusal says to write."""
    said = str(error).split(", expected ")[1]
    keys: dict[str, Any] = {"columns": {}}
    for entry in re.findall(r"\w+ = (?:\"[^\"]*\"|\{[^}]*\}|\d+)(?! *\))", said):
        ((key, value),) = tomllib.loads(entry).items()
        (keys["columns"] if key in COLUMNS else keys)[key] = value
    return keys


def test_a_log_of_a_load_frame_is_read_as_it_is_stated(tmp_path: Path) -> None:
    keys = {"separator": ";", "decimal": ",", "header_row": 4, "first_row": 6, "columns": COLUMNS}
    assert_as_said(read(tmp_path / "log.csv", FRAME, **keys))


@pytest.mark.parametrize(
    "log",
    [
        FRAME,
        PLAIN.replace(",", ";"),
        PLAIN.replace(",", "\t"),
        PLAIN.replace(",", "|").replace(".", ","),
        PLAIN.replace(",", "   "),
        PLAIN.replace("time_s", "Time [s]").replace("force_N", "Load cell (N)"),
        PLAIN.replace("time_s,stage_um", "t/s,crosshead / µm"),
        PLAIN.replace("force_N\n", "force_N\ns,µm,,N\n"),
        PLAIN.replace("N\n0,0,0,500", "N\n00:00:00,0,0,500").replace("\n90,", "\n0:01:30,")
        .replace("\n180,", "\n0:03:00.0,").replace("\n270,", "\n00:04:30,"),
        PLAIN.replace("time_s,stage_um", "Time (h),Stroke (nm)").replace("\n90,5,", "\n0.025,5e3,")
        .replace("\n180,10,", "\n.05,10000,").replace("\n270,7.5,", "\n0.075,7500,"),
        "# a log\n" + PLAIN,
        PLAIN.encode("utf-16"),
        PLAIN.replace("stage_um", "stage_µm").encode("latin-1"),
    ],
)  # fmt: skip
def test_what_a_refusal_says_to_write_has_the_log_read(tmp_path: Path, log: str | bytes) -> None:
    keys: dict[str, Any] = {"columns": {}}
    for attempt in range(5):
        try:
            assert_as_said(read(tmp_path / "log.csv", log, **keys))
        except HistoryError as error:
            new = in_order(error)
            assert new.pop("columns") or new, error
            columns = keys["columns"] | in_order(error)["columns"]
            keys |= {**new, "columns": columns}
        else:
            assert attempt > 0
            return
    pytest.fail("the refusals do not end")


@pytest.mark.parametrize(
    "text",
    [
        PLAIN,
        "\ufeff" + PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        PLAIN.replace("\n90,", "\n\n , , ,\n90,"),
        PLAIN.replace(",0,500", ",0.0,500").replace(",1,1", ",1.0,1").replace(",2,", ",2.,"),
        PLAIN.replace("force_N", '"force_N"').replace("100", ' "100"'),
        PLAIN.replace("time_s", "note,time_s").replace("\n0", "\n,0").replace("\n90", '\n"a,b",90')
        .replace("\n180", "\n,180").replace("\n270", "\n,270"),
    ],
)  # fmt: skip
def test_what_can_be_read_in_one_way_alone_needs_no_word(tmp_path: Path, text: str) -> None:
    assert_as_said(read(tmp_path / "log.csv", text))


@pytest.mark.parametrize(
    ("unit", "kind", "value"),
    [
        ("s", "time", "90"), ("ms", "time", "90000"), ("min", "time", "1.5"), ("h", "time", ".025"),
        ("hh:mm:ss", "time", "00:01:30.00"), ("um", "stage", "5"), ("µm", "stage", "5.0"),
        ("nm", "stage", "5000"), ("mm", "stage", "5e-3"), ("m", "stage", "5E-06"),
        ("N", "force", "100"), ("mN", "force", "100000"), ("uN", "force", "1e8"),
        ("µN", "force", "1e8"), ("kN", "force", "+0.1"),
    ],
)  # fmt: skip
def test_every_unit_of_a_column_is_that_of_its_name(
    tmp_path: Path, unit: str, kind: str, value: str
) -> None:
    row = {"time": "90", "stage": "5", "image": "1", "force": "100", kind: value}
    zero = "0:00:00" if unit == "hh:mm:ss" else "0"
    path = tmp_path / "log.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["a", "b", "c", "d"])
        writer.writerow([zero if kind == "time" else "0", 0, 0, 0])
        writer.writerow(row.values())
    units = {"time": "s", "stage": "um", "force": "N", kind: unit}
    columns: dict[str, Any] = {
        key: {"name": name, "unit": units[key]} if key in units else {"name": name}
        for name, key in zip("abcd", row, strict=True)
    }
    stated = HistoryTable.model_validate({"columns": columns})
    history = read_history(path, stated=stated)
    assert history.time[1] == pytest.approx(90.0)
    assert history.stage[1] == pytest.approx(5.0)
    assert history.force[1] == pytest.approx(100.0)


def test_a_table_without_names_is_read_by_the_numbers_of_its_columns(tmp_path: Path) -> None:
    text = "# made by a script\n500 0 0 0\n100  1\t5 90\n0 2 10 180\n200 nan 9 200\n200 3 7.5 270\n"
    columns = {
        "time": {"name": 4, "unit": "s"}, "stage": {"name": 3, "unit": "um"},
        "image": {"name": 2}, "force": {"name": 1, "unit": "N"},
    }  # fmt: skip
    keys = {"header_row": 0, "first_row": 2, "separator": " ", "empty": "nan", "columns": columns}
    history = read(tmp_path / "log.csv", text, **keys)
    assert history.image_row.size == 4
    np.testing.assert_array_equal(history.force, FORCE)
    np.testing.assert_array_equal(history.time[history.image_row], TIME)
    with pytest.raises(HistoryError, match='the name "time_s", expected a number with header_row'):
        read(tmp_path / "log.csv", text, **(keys | {"columns": {}}))
    beyond = keys | {"columns": columns | {"force": {"name": 5, "unit": "N"}}}
    with pytest.raises(HistoryError, match="columns.force: found 4 columns, expected a column 5$"):
        read(tmp_path / "log.csv", text, **beyond)


@pytest.mark.parametrize(
    ("text", "keys", "said"),
    [
        (FRAME.replace("0,0;", "0.0;"), {"decimal": ","}, 'row 6, Time: found "0.0", expected a '
         'number without a point, for decimal = "," under [history]'),
        (FRAME, {}, 'row 6, Time: found "0,0", expected a number, or decimal = "," under [hist'),
        (FRAME.replace("min;mm", "s;mm"), {"decimal": ","}, 'row 5: found the column Time in "s", '
         'expected "min", or time = {name = "Time", unit = "s"} under [history.columns]'),
        (FRAME.replace(";1;", ";eins;"), {"decimal": ","}, 'row 7, Image: found "eins", expected '
         'a number or nothing, or empty = "eins" under [history]'),
        (FRAME.replace(";1;", ";1,5;"), {"decimal": ","}, 'row 7, Image: found 1,5, expected 1, '),
        (FRAME.replace("Image;", "Time;"), {"decimal": ","}, "row 4: found the column Time 2 times,"
         " expected each column once, or its number, as time = {name = 1, unit"),
        (FRAME.replace("0,1\n", '"0,1\n'), {"decimal": ","}, "row 7: found a quote that stays open"
         ", expected each quote closed in its row"),
        (FRAME.replace("0,1\n", "0,1;3\n"), {"decimal": ","}, "row 7: found 5 cells, expected 4, "),
        (FRAME, {"first_row": 10**15}, "file: found no rows of numbers, expected one for each"),
        ("a" * 5000 + ";b\n" + PLAIN, {"header_row": 1, "columns": {}},
         f"row 1: found {'a' * 200}…, expected "
         'the column time_s, or separator = ",", header_row = 2, first_row = 3 under [history]'),
        ("", {}, "row 4: found no columns, expected the names of the columns"),
        (FRAME[:FRAME.index("0,0")], {}, "file: found no rows of numbers, expected one for each"),
        (PLAIN.replace("0,500", "0,1_0"), {"header_row": 1, "first_row": 2, "separator": ",",
         "columns": {}}, 'row 2, force_N: found "1_0", expected a number'),
        (PLAIN.replace("0,500", "0,1e999"), {"header_row": 1, "first_row": 2, "separator": ",",
         "columns": {}}, 'row 2, force_N: found "1e999", expected a number'),
        (PLAIN.replace(",", " ").replace("1 100", "100"), {"header_row": 1, "first_row": 2,
         "separator": " ", "columns": {}}, "row 3: found 3 cells, expected 4, as the columns"),
    ],
)  # fmt: skip
def test_what_is_not_as_stated_is_refused_with_its_row_and_what_to_write(
    tmp_path: Path, text: str, keys: dict[str, Any], said: str
) -> None:
    stated = {"separator": ";", "header_row": 4, "first_row": 6, "columns": COLUMNS, **keys}
    with pytest.raises(HistoryError) as error:
        read(tmp_path / "log.csv", text, **stated)
    assert str(error.value).startswith(f"{tmp_path / 'log.csv'}: {said}")


def test_a_column_that_tells_its_unit_wrongly_is_stated_by_its_number(tmp_path: Path) -> None:
    text = PLAIN.replace("stage_um", "stage_mm")
    columns = {"stage": {"name": "stage_mm", "unit": "um"}}
    with pytest.raises(HistoryError, match='the column stage_mm in "mm", .* name = 2'):
        read(tmp_path / "log.csv", text, columns=columns)
    assert_as_said(read(tmp_path / "log.csv", text, columns={"stage": {"name": 2, "unit": "um"}}))


def test_a_mark_before_the_text_is_no_part_of_the_first_name(tmp_path: Path) -> None:
    marked = PLAIN.encode("utf-16")
    assert_as_said(read(tmp_path / "log.csv", marked, encoding="utf-16"))
    little = b"\xff\xfe" + PLAIN.encode("utf-16-le")
    assert_as_said(read(tmp_path / "log.csv", little, encoding="utf-16-le"))


def test_a_log_of_loads_alone_needs_no_column_of_images(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time_s,stage_um,force_N\n0,0,500\n90,5,100\n180,10,0\n270,7.5,200\n")
    assert_as_said(read_history(path, with_images=False))
