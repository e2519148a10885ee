"""Tests in wrong units are told by what they would mean."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from driver.case.history import HistoryTable
from driver.case.model import Case, load_case
from driver.doubts.finding import Finding
from driver.doubts.plausible import in_figures
from driver.experiment.history import History
from driver.experiment.reading import history_of

ALPHA = Path(__file__).parents[3] / "examples" / "alpha" / "case.toml"


def found(case: Case, time: float = 1.0, stage: float = 1.0, force: float = 1.0) -> list[Finding]:
    """Findings on the example, its columns read in units that are wrong by some factors."""
    history = history_of(case)
    wrong = replace(history, time=time * history.time, stage=stage * history.stage)
    return list(in_figures(case, wrong, force * case.force_scale * history.force))


def test_the_example_is_told_in_one_line_and_not_warned_of() -> None:
    (line,) = found(load_case(ALPHA))
    assert line.level == "ok"
    # 330 µm over 32 mm, 5 µm in 10 s; 402 N over 3 mm².
    assert line.message.startswith(
        "strain 1.03 % by the stage, at 1.6·10⁻⁵ /s while it moves; an image every 40.0 s; "
        "stress up to 134 MPa; largest Schmid factor along Y grain 1 0.48, grain 2 0.49, "
    )


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ({"time": 1 / 60}, ("history.columns.time: found an image every 0.667 s", "is in min")),
        ({"time": 1 / 3600}, ("history.columns.time: found an image every 0.0111 s", "is in min")),
        ({"time": 1e3}, ("history.columns.time: found an image every 40000 s", "is in ms")),
        ({"stage": 1e-3}, ("history.columns.stage: found 0.330 µm of travel", 'unit = "mm"')),
        ({"stage": 1e3}, ("history.columns.stage: found 330000 µm of travel", 'unit = "nm"')),
        ({"stage": 0.015}, ("a strain of 0.0155 %", "the elastic strain at 134 MPa")),
        ({"force": 1e-3}, ("history.columns.force: found a stress of 0.134 MPa", 'unit = "kN"')),
        ({"force": 1e3}, ("history.columns.force: found a stress of 133", 'unit = "mN"')),
    ],
)
def test_a_wrong_unit_is_one_warning_with_its_key_and_the_unit_that_it_may_be(
    factors: dict[str, float], said: tuple[str, str]
) -> None:
    _, warning = found(load_case(ALPHA), **factors)
    assert warning.level == "warning"
    assert all(part in warning.message for part in said), warning.message


def in_minutes(folder: Path, header: str, time: str | int) -> tuple[Case, History]:
    """The example with an image every three minutes, and its log with the times in minutes."""
    _, *rows = (ALPHA.parent / "history.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    written = [",".join([f"{4.5 * float(time) / 60:g}", *rest]) for time, *rest in cells]
    log = folder / "log.csv"
    log.write_text("\n".join(filter(None, [header, *written])))
    columns = {"time": {"name": time, "unit": "s"}}
    if not header:
        columns |= {"stage": {"name": 2, "unit": "um"}, "force": {"name": 4, "unit": "N"}}
        columns |= {"image": {"name": 3}}
    stated = {"file": str(log), "header_row": 1 if header else 0, "columns": columns}
    table = HistoryTable.model_validate(stated)
    case = load_case(ALPHA).model_copy(update={"history": table})
    return case, history_of(case)


NAMED = "{},stage_um,image,force_N"


@pytest.mark.parametrize(("header", "time"), [("", 1), (NAMED.format("t"), "t")])
def test_minutes_of_a_file_that_tells_no_unit_are_asked_about_with_both_rates(
    tmp_path: Path, header: str, time: str | int
) -> None:
    case, history = in_minutes(tmp_path, header, time)
    _, warning = in_figures(case, history, case.force_scale * history.force)
    # 5 µm of 32 mm in 10 · 4.5 / 60 s.
    assert warning.message.startswith(
        "history.columns.time: found an image every 3.00 s and a strain rate of 2.1·10⁻⁴ /s, in a "
        "column whose unit the file does not tell; in min they would be 3.00 min and 3.5·10⁻⁶ /s; "
    )
    assert 'unit = "min"' in warning.message


def test_a_fast_test_is_no_doubt_where_the_file_tells_seconds(tmp_path: Path) -> None:
    case, history = in_minutes(tmp_path, NAMED.format("t [s]"), "t [s]")
    force = case.force_scale * history.force
    assert [finding.level for finding in in_figures(case, history, force)] == ["ok"]
    case, history = in_minutes(tmp_path, NAMED.format("t"), "t")
    slow = replace(history, time=60 * history.time)
    assert [finding.level for finding in in_figures(case, slow, force)] == ["ok"]


@pytest.mark.parametrize(("section", "times"), [(30.0, "0.16"), (0.3, "16")])
def test_a_section_that_is_ten_times_off_is_told_by_the_critical_stress(
    section: float, times: str
) -> None:
    case = load_case(ALPHA).with_values_at({"sections.macroscopic_mm2": section})
    _, warning = found(case)
    assert warning.message.startswith(f"sections.macroscopic_mm2 = {section:g}: found a stress of")
    assert f"is {times} times material.tau0_MPa = 40, expected 0.5 to 10" in warning.message


def test_a_strain_rate_of_no_machine_is_told_with_both_units() -> None:
    boundary = {"motion": "stage", "stage_ratio": 4e-4, "stage_ratio_uncertainty": 1e-4}
    changed = {f"boundary.{key}": value for key, value in boundary.items()}
    case = load_case(ALPHA).with_values_at(changed)
    _, warning = found(case, time=1e-6)
    assert warning.message.startswith("history.columns.time: found a strain rate of 17 /s")


def test_a_load_that_the_case_leaves_out_makes_no_stress() -> None:
    case = load_case(ALPHA)
    history, left_out = history_of(case), case.with_values_at({"loads.left_out": (7,)})
    force = case.force_scale * history.force
    force[7] *= 1e3
    assert [finding.level for finding in in_figures(case, history, force)] == ["ok", "warning"]
    assert [finding.level for finding in in_figures(left_out, history, force)] == ["ok"]
