"""A series without repeats, its noise stated, beside the same series with ten of them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from driver.case.model import Case, load_case, write_case
from driver.common.progress import progress_to
from driver.forward import build
from driver.results.files import IDENTIFY, IDENTIFY_CSV, MEASURE
from driver.results.hdf5 import read_hdf5
from driver.workflow import pipeline
from driver.workflow.engine import StageContext, run_stages
from driver.workflow.measure_stage import measure_numbers
from solver_adapters.profile import Profile
from tools import closed_form


def solver(name: str, profile: Profile) -> closed_form.ClosedFormSolver:
    return closed_form.ClosedFormSolver(0.001)


Results = tuple[dict[str, np.ndarray], dict[str, np.ndarray], str]


def written(folder: Path, **images: object) -> Case:
    """A truth whose noise is known, as a case without regularisation."""
    closed_form.write_files(folder, {})
    case = load_case(folder / "case.toml")
    dic = case.dic.model_copy(update={"roughness_px": "none"})
    table = case.images.model_copy(update=images)
    write_case(case.model_copy(update={"dic": dic, "images": table}), folder / "case.toml")
    return load_case(folder / "case.toml")


def identified(folder: Path, **images: object) -> Results:
    """Measurement, identification and log of it."""
    case = written(folder, **images)
    lines: list[str] = []
    with pytest.MonkeyPatch.context() as patch, progress_to(lines.append):
        patch.setattr(build, "find_adapter", solver)
        run_stages(case, pipeline.stages(case), "identify")
    results = folder / "results"
    fitted = read_hdf5(results / IDENTIFY)
    with (results / IDENTIFY_CSV).open(newline="", encoding="utf-8") as rows:
        for row in csv.DictReader(rows):
            fitted[row["parameter"]] = np.array([float(row["value"]), float(row["sigma"])])
    return read_hdf5(results / MEASURE), fitted, "\n".join(lines)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Results, Results]:
    with_repeats = identified(tmp_path_factory.mktemp("repeats"))
    stated = {"repeats": None, "noise_nm": 1e3 * closed_form.SIGMA}
    return with_repeats, identified(tmp_path_factory.mktemp("stated"), **stated)


def test_the_elongation_is_as_sure_but_for_the_noise_of_a_reference_of_one_image(
    both: tuple[Results, Results],
) -> None:
    (repeats, _, _), (stated, _, log) = both
    assert stated["n_reference"] == 1 and stated["noise_dof"] == 0
    # σ² of repeats is known to 2/√(2 dof).
    known = 4 * 2 / np.sqrt(2 * repeats["noise_dof"]) + 0.01
    own, alike = [], []
    for results, n in ((repeats, closed_form.N_REPEATS), (stated, 1)):
        covariance = results["elongation_covariance"][1:, 1:]
        shared = np.median(covariance[~np.eye(len(covariance), dtype=bool)])
        own.append(np.median(np.diag(covariance)) - shared)
        alike.append(n * shared)
    assert own[1] == pytest.approx(own[0], rel=known)
    assert alike[1] == pytest.approx(alike[0], rel=known)
    assert "noise 2.00 nm as stated, no repeats" in log
    assert "without repeats image 0 is the reference" in log and "images.noise_nm: found" not in log


def test_image_0_stands_still_and_the_others_move_as_they_do_with_repeats(
    both: tuple[Results, Results],
) -> None:
    (repeats, _, _), (stated, _, _) = both
    assert list(np.flatnonzero(stated["left_out"])) == [0]
    assert not stated["motion"][0].any() and stated["chi"][0] == 0.0
    # Image 0 may be off by its own noise, and the mean of the repeats by a tenth of it.
    off = stated["elongation"][1:] - (repeats["elongation"] - repeats["elongation"][0])[1:]
    sigma = stated["elongation_sigma"]
    assert np.abs(off).max() < 4 * np.sqrt(2) * sigma


def test_the_noise_budget_and_the_law_agree(both: tuple[Results, Results]) -> None:
    (measured, repeats, _), (_, stated, _) = both
    error = 1 / np.sqrt(2 * measured["noise_later_dof"])
    for fitted, sigma in ((repeats, float(measured["sigma"])), (stated, closed_form.SIGMA)):
        # Half of the spectrum tells the factor, of the numbers of the mesh, not of all pixels.
        numbers = len(measured["stage"]) * measured["coefficients"].shape[1] / 2
        assert fitted["noise_factor"] * sigma == pytest.approx(
            closed_form.SIGMA, rel=4 / np.sqrt(2 * numbers) + 4 * error
        )
    for name in closed_form.LAW:
        (first, spread), (second, other) = repeats[name], stated[name]
        assert abs(second - first) < 4 * spread
        assert other == pytest.approx(spread, rel=0.1)


@pytest.mark.parametrize(("noise_nm", "left"), [(0.67, "3"), (6.0, "0.33")])
def test_a_noise_that_is_not_that_of_the_images_is_told(
    tmp_path: Path, noise_nm: float, left: str
) -> None:
    case = written(tmp_path, repeats=None, noise_nm=noise_nm)
    lines: list[str] = []
    (tmp_path / "work").mkdir()
    with progress_to(lines.append):
        measure_numbers(StageContext(case, tmp_path, tmp_path / "work"))
    told = (
        f"WARNING: images.noise_nm: found {noise_nm:g}, but free correlation leaves χ {left}, and "
        "its residuals scatter as a noise of 2 nm does: state that, or give images.repeats"
    )
    assert told in "\n".join(lines)
