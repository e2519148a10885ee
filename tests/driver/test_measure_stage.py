"""The stage on the specimen of the closed-form solver, whose motion is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from driver.images.region import Excluded
from driver.measure_stage import MEASURE
from driver.pipeline import run
from driver.results import read_hdf5
from tests.driver import closed_form

BAD, DUST = 20, (15, 25)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, np.ndarray], str]:
    """Results and log of a series with a spoilt frame and a grain of dust."""
    folder: Path = tmp_path_factory.mktemp("measure")
    closed_form.write_files(folder, {})
    frames = tifffile.imread(folder / "images.tif")
    frames[BAD, 14:20, 15:25] += 8.0  # 52 nm, as of a vibration during a few lines
    repeats = tifffile.imread(folder / "repeats.tif")
    repeats[:, *DUST] += 100.0
    tifffile.imwrite(folder / "images.tif", frames)
    tifffile.imwrite(folder / "repeats.tif", repeats)
    lines: list[str] = []
    run(folder / "case.toml", "measure", False, lines.append)
    return read_hdf5(folder / "results" / MEASURE), "\n".join(lines)


def test_the_spoilt_frame_is_named_left_out_and_nothing_else(
    measured: tuple[dict[str, np.ndarray], str],
) -> None:
    results, log = measured
    assert list(np.flatnonzero(results["left_out"])) == [BAD]
    assert f"frame {BAD} is unlike its neighbours: residual" in log
    assert "its image is not fitted, its load is" in log
    assert log.count("unlike its neighbours") == 1


def test_the_dust_is_left_out_and_told(measured: tuple[dict[str, np.ndarray], str]) -> None:
    results, log = measured
    assert results["codes"][DUST] == Excluded.DUST
    assert np.count_nonzero(results["codes"] == Excluded.DUST) == 13
    assert "13 pixels with dust" in log
    assert np.count_nonzero(results["codes"] == Excluded.USED) == len(results["xy"])


def test_both_estimates_of_the_noise_agree_with_what_was_put_in(
    measured: tuple[dict[str, np.ndarray], str],
) -> None:
    results, _ = measured
    for sigma, dof in (("sigma", "noise_dof"), ("noise_later", "noise_later_dof")):
        error = 1 / np.sqrt(2 * results[dof])
        # The motion between frames leaves a little of itself, below 1 %.
        assert results[sigma] == pytest.approx(closed_form.SIGMA, rel=4 * error + 0.01)
    assert not results["noise_larger"].any()


def test_the_rigid_motion_of_each_frame_is_kept(
    measured: tuple[dict[str, np.ndarray], str],
) -> None:
    results, _ = measured
    kept = results["left_out"] == 0
    stage = closed_form.stage_error(closed_form.bench())
    # The stage's random shift is seen beside the mean motion of the specimen, which is smooth.
    rest = (results["rigid"] - stage)[kept]
    roughness = np.std(np.diff(rest[:, 0], 2)) / np.sqrt(6)
    assert roughness < 0.02 * closed_form.PIXEL < 0.15 * np.std(stage[:, 0])
