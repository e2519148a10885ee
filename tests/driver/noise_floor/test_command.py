"""`prismid noise-floor` on a virtual experiment, files and words."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from driver.common.errors import InputError
from driver.common.progress import progress_to
from driver.forward import build
from driver.noise_floor import command
from driver.noise_floor.command import noise_floor
from driver.virtual.settings import Face, Microscope, Virtual
from driver.virtual.truth import pull, stage_program
from driver.virtual.writing import record
from tools import closed_form

NOISE = 3.0  # nm


def experiment(folder: Path, repeats: int) -> Path:
    settings = Virtual(
        face=Face(dots_per_um2=2.0, roughness_nm=8.0),
        microscope=Microscope(bits=16, noise_nm=NOISE, repeats=repeats, flats=30),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "find_adapter", lambda name, profile: closed_form.ClosedFormSolver())
        course = pull(closed_form.small_case(), stage_program([(1, 1)]), {})
    return record(folder, closed_form.small_case(), course, 1, settings)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], list[str]]:
    """The folder of the results, the record and what was said, of two meshes."""
    folder = tmp_path_factory.mktemp("floor")
    lines: list[str] = []
    case = experiment(folder, 12)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "sizes", lambda images, ratio: (12, 24))
        with progress_to(lines.append):
            noise_floor(case)
    results = folder / "results"
    return results, json.loads((results / "noise_floor.json").read_text(encoding="utf-8")), lines


def test_the_noise_of_the_repeats_is_found_and_its_elongation_predicted(
    found: tuple[Path, dict[str, Any], list[str]],
) -> None:
    _, record, _ = found
    # 16-bit levels add nothing; the flat pattern of 30 images adds none that repeats differ by.
    assert record["noise_nm"] == pytest.approx(NOISE, rel=0.03)
    assert record["n_reference"] == 12 and record["gamma_u_measured_freedom"] == 11
    for mesh in record["meshes"]:
        predicted, measured = mesh["gamma_u_predicted_nm"], mesh["gamma_u_measured_nm"]
        # Known to 1/√22 = 21 %: three standard deviations.
        assert abs(measured / predicted - 1) < 0.64
        # Between pixels interpolation lowers the noise; 72 images know it to 9 %.
        assert 0.65 < mesh["gamma_u_laboratory_nm"] / predicted < 1.2
        assert mesh["converged"] == 1.0


def test_the_reference_is_moved_ten_times_more_accurately_than_correlation_sees(
    found: tuple[Path, dict[str, Any], list[str]],
) -> None:
    assert found[1]["interpolation_error_nm"] < 1e-3 * NOISE


def test_the_files_hold_every_motion_and_mesh_and_the_mesh_to_take(
    found: tuple[Path, dict[str, Any], list[str]],
) -> None:
    folder, record, lines = found
    assert record["element_px"] in (12, 24)
    assert record["height_element_px"] == pytest.approx(record["element_px"] * 8 / 12)
    for mesh in record["meshes"]:
        for name in ("u_nm", "v_nm", "w_nm", "strain", "elongation_nm"):
            values = mesh[name]
            assert len(values["bias"]) == len(values["scatter"]) == len(record["motions"])
            squares = np.square(values["bias"]) + np.square(values["scatter"])
            assert values["total"] == pytest.approx(np.sqrt(squares.mean()))
    with (folder / "noise_floor.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["element_px"]) for row in rows] == [12, 24]
    assert float(rows[1]["gamma_u_predicted_nm"]) == pytest.approx(
        record["meshes"][1]["gamma_u_predicted_nm"], rel=1e-5
    )
    picture = matplotlib.image.imread(folder / "noise_floor.png")
    assert picture.shape[1] > 1000 and picture.std() > 0.05
    assert any(f"take dic.element_px = {record['element_px']:g}, " in line for line in lines)


def test_the_time_is_told_before_and_the_way_while_it_runs(
    found: tuple[Path, dict[str, Any], list[str]],
) -> None:
    assert re.search(r"2 meshes: about [\d.]+ s on free cores and 0\.\d GB of memory", found[2][0])
    assert [line.split(",")[0].strip() for line in found[2] if "to go" in line] == [
        "mesh 1 of 2",
        "mesh 2 of 2",
    ]


def test_too_few_repeats_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="images.repeats: found 2 images, expected at least 3"):
        noise_floor(experiment(tmp_path, 2))


def test_a_stated_noise_has_no_floor(tmp_path: Path) -> None:
    path = experiment(tmp_path, 3)
    text = path.read_text("utf-8")
    path.write_text(text.replace('repeats = "repeats.tif"', ""), encoding="utf-8")
    with pytest.raises(InputError, match="images.repeats: found nothing, expected at least 3"):
        noise_floor(path)
