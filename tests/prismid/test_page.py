"""The examples of docs/python.md, run in their order as they stand."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import prismid
from tests.driver.invented_results import results, written
from tests.prismid.test_results import diagnosed as diagnosed

__all__ = ["results", "written"]  # fixtures

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "python.md").read_text(encoding="utf-8")
RUN, RESULTS, DIAGNOSED, DRAWN, SIMULATION, POINT, CORRELATION = re.findall(
    r"```python\n(.*?)```", PAGE, re.DOTALL
)


def told(capsys: pytest.CaptureFixture[str], code: str, names: dict[str, Any]) -> str:
    exec(code, names)
    return capsys.readouterr().out


def test_the_examples_of_a_case_build_on_each_other(
    alpha: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names: dict[str, Any] = {}
    assert "measure: done and unchanged" in told(capsys, RUN, names)
    assert told(capsys, RESULTS, names) == "('image', 'point', 'component') True time\n"
    assert told(capsys, DRAWN, names) == ""
    assert (alpha.parent / "travel.pdf").read_bytes().startswith(b"%PDF")
    load = re.fullmatch(r"\('image', 'point', 'component'\) (\d+) µN\n",
                        told(capsys, SIMULATION, names))  # fmt: skip
    # Elastic: 6 nm on 12 µm of 6.93 µm², of a modulus between 130 and 290 GPa.
    assert load and 400 < int(load[1]) < 1100
    point = re.fullmatch(r"(\d+) MPa\n", told(capsys, POINT, names))
    # Between τ0 over 1/2, and τ0 + c/d + K γ̇^(1/n) over the least Schmid factor, that of [111].
    assert point and 80 < int(point[1]) < (40 + 27 + 12 * 3e-4**0.1) / 0.31


def test_the_run_that_the_page_shows_measures(measured_alpha: tuple[Path, list[str]]) -> None:
    folder, lines = measured_alpha
    assert "measure: started" in lines
    assert any(line.startswith("measure: finished in") for line in lines)
    assert (folder / "results" / "measure.h5").is_file()


def test_the_example_of_a_diagnosis_reads_parameters_and_causes(
    diagnosed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = told(capsys, DIAGNOSED, {"found": prismid.read_results(diagnosed)})
    assert re.search(r"^tau0 +21\.34 +\d+\.0 ", out, re.MULTILINE)
    verdict, *together = re.findall(r"\w+", out.splitlines()[-1])
    assert verdict == "named" and set(together) == {"grain_contrast", "family_112"}


def test_the_example_of_a_correlation_finds_the_motion_that_it_made(
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = told(capsys, CORRELATION, {})
    assert re.fullmatch(r"0\.60 px, residual (0\.9|1\.0)\d of its noise\n", out)


def test_the_page_names_all_that_the_package_offers() -> None:
    table = PAGE.split("| name | what |")[1].split("\n\n")[0]
    assert sorted(re.findall(r"`(\w+)`", table)) == sorted(prismid.__all__)
