from __future__ import annotations

from pathlib import Path

import pytest

from driver.case.history import HistoryColumns, HistoryTable, ImageColumn, StageColumn, TimeColumn
from driver.case.model import case_text, default_case, load_case
from tests.driver.case.tables import refused


def test_the_distance_of_the_grips_is_micrometres_inside() -> None:
    assert HistoryTable(grip_distance_mm=32.0).grip_distance == pytest.approx(32e3)


def test_a_log_of_another_form_is_written_and_read_back_as_it_is(tmp_path: Path) -> None:
    columns = HistoryColumns(time=TimeColumn(name="t [min]", unit="min"), image=ImageColumn(name=3))
    history = HistoryTable(
        file="a.txt", separator="\t", decimal=",", encoding="utf-16", header_row=4, first_row=6,
        empty="NaN", columns=columns,
    )  # fmt: skip
    path = tmp_path / "case.toml"
    path.write_text(case_text(default_case().model_copy(update={"history": history})), "utf-8")
    assert load_case(path).history == history


def test_a_decimal_comma_does_not_part_the_cells_as_well() -> None:
    assert HistoryTable(decimal=",", separator=";").decimal == ","
    assert refused(HistoryTable, decimal=",") == (
        "separator",
        'another one with decimal = ",", as ";"',
    )


def test_a_column_is_of_one_quantity() -> None:
    columns = {"time": {"name": 1, "unit": "s"}, "stage": {"name": 1, "unit": "mm"}}
    said = ("columns", "a column of its own for each")
    assert refused(HistoryTable, columns=columns) == said
    assert refused(HistoryTable, columns={"image": {"name": "force_N"}}) == said


def test_the_greek_letter_is_the_sign_of_micro() -> None:
    assert StageColumn.model_validate({"name": "s", "unit": "\u03bcm"}).unit == "\u00b5m"


def test_numbers_stand_below_the_names_of_their_columns() -> None:
    assert HistoryTable(header_row=2).first_data_row == 3
    assert HistoryTable(header_row=0).first_data_row == 1
    said = "a row below the names of the columns, which stand in row 4"
    assert refused(HistoryTable, header_row=4, first_row=4) == ("first_row", said)


@pytest.mark.parametrize("name", ["utf8", "UTF-16", "latin-1", "cp1252", "shift_jis"])
def test_an_encoding_is_one_of_texts(name: str) -> None:
    assert HistoryTable(encoding=name).encoding == name


@pytest.mark.parametrize("name", ["utf-7-bit", "hex", "undefined", "a\0b", ""])
def test_what_encodes_no_text_is_no_encoding(name: str) -> None:
    expected = 'an encoding, as "utf-8", "utf-16", "cp1252" or "latin-1"'
    assert refused(HistoryTable, encoding=name) == ("encoding", expected)
