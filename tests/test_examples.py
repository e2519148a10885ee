"""The examples, in a size that tests can afford."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from driver.case.model import load_case, write_case
from driver.diagnosis.causes.all_causes import NAMES
from driver.results.hdf5 import read_hdf5
from driver.virtual.command import true_case
from driver.virtual.settings import read_virtual
from driver.virtual.truth import knots, pull, stage_program
from driver.virtual.writing import record
from driver.workflow import pipeline

ALPHA = Path(__file__).parents[1] / "examples" / "alpha"
IF_STEEL = Path(__file__).parents[1] / "examples" / "if_steel"
CYCLES = ((8, 3), (8, 3), (9, 3))  # of 320 images 35
SEED = 1


@pytest.mark.long
def test_the_demo_whose_data_others_made_is_diagnosed_to_its_hidden_effect(tmp_path: Path) -> None:
    """Simulated by Code_Aster, imaged by other programs: τ0 of grain 2 is 1.15 that of grain 1.

    Of all causes non-Schmid stress is not asked for: without symmetry its tangent takes longest.
    """
    folder = tmp_path / "alpha"
    shutil.copytree(ALPHA, folder, ignore=shutil.ignore_patterns("results"))
    asked = tuple(name for name in NAMES if name != "non_schmid")
    case = load_case(folder / "case.toml").with_values_at({"diagnosis.causes": asked})
    write_case(case, folder / "case.toml")
    pipeline.run(folder / "case.toml", "diagnose", False)
    found = json.loads((folder / "results" / "diagnosis.json").read_text("utf-8"))
    assert (found["verdict"], found["causes"]) == ("named", ["grain_contrast"])
    ratio, numerics = found["added"]["tau0_grain2"], found["numerics"]
    assert abs(ratio["value"] - 1.15) < 3 * ratio["sigma"] < 0.05
    assert numerics["passed"] and numerics["off_by_mesh"]["tau0_grain2"] < ratio["sigma"]
    held_out = found["gain"]["held_out"]
    assert held_out["chi_load_after"] < held_out["chi_load_before"] < 1.3


@pytest.mark.long
def test_the_paper_size_study_finds_its_truth_within_three_sigma(tmp_path: Path) -> None:
    """Fewer images and coarser meshes; the truth as in `virtual.toml`, tables 4 and 5."""
    case, settings = load_case(IF_STEEL / "case.toml"), read_virtual(IF_STEEL / "virtual.toml")
    coarse = {"mesh_size_um": 2.0, "fine_mesh_size_um": 1.4}
    case = case.model_copy(update={"specimen": case.specimen.model_copy(update=coarse)})
    finer = {"mesh_size_um": 1.1, "steps_per_interval": 3}
    few = {"flats": 40}
    settings = settings.model_copy(
        update={
            "discretisation": settings.discretisation.model_copy(update=finer),
            "microscope": settings.microscope.model_copy(update=few),
        }
    )
    history = stage_program(CYCLES)
    truth = knots(history, settings.program, case.specimen.length) | settings.truth
    course = pull(true_case(case, settings), history, truth)
    path = record(tmp_path, case, course, SEED, settings)

    pipeline.run(path, "identify", False)

    found = read_hdf5(tmp_path / "results" / "identify.h5")
    csv = (tmp_path / "results" / "identify.csv").read_text("utf-8").splitlines()[1:]
    names = [line.split(",")[0] for line in csv]
    displaced = json.loads((tmp_path / "truth.json").read_text("utf-8"))["origin_error_um"]
    truth |= dict(zip(("origin_X", "origin_Y"), displaced, strict=True))
    assert set(names) == set(truth)
    off = (found["values"] - [truth[name] for name in names]) / found["sigma"]
    assert np.abs(off).max() < 3, dict(zip(names, off.round(1), strict=True))
    # The intervals are worth something: the law is known to a few per cent.
    for name in ("tau0", "c", "d"):
        assert found["sigma"][names.index(name)] < 0.1 * truth[name]
    assert float(found["budget/load"]) == pytest.approx(1.0, abs=0.3)
