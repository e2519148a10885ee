"""What a design predicts, against the identification of a virtual experiment that was made."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import pytest

from driver.design.command import design
from driver.results.files import DESIGN, IDENTIFY
from driver.virtual.writing import record
from driver.workflow.pipeline import run
from tools.converged_truth import known_case, pulled


@pytest.mark.slow
def test_the_predicted_sigma_is_that_of_the_fit_though_no_image_is_looked_at(
    tmp_path: Path,
) -> None:
    """Two grains, images and loads of a converged simulation, with the bundled solver.

    Within 12 %: the fit also estimates the noise of the images (to 2 %), and its gradient holds
    what 31 images leave of noise.
    """
    case = record(tmp_path, known_case(), pulled({}), 1)
    run(case, "identify", False)
    with h5py.File(tmp_path / "results" / IDENTIFY) as file:
        names, values = (json.loads(file.attrs[key]) for key in ("names", "all_values"))
        fitted = dict(zip(names, file["sigma"][()], strict=True))
    assumed = "\n".join(["[truth]", *(f"{name} = {values[name]!r}" for name in names)])
    (tmp_path / "settings.toml").write_text(assumed, encoding="utf-8")
    (tmp_path / "images.tif").unlink()
    design(case, tmp_path / "settings.toml", [], False)
    found = json.loads((tmp_path / "results" / DESIGN).read_text(encoding="utf-8"))
    predicted = {p["parameter"]: p["sigma"] for p in found["experiment"]["parameters"]}
    assert set(predicted) == set(fitted)
    for name, sigma in fitted.items():
        assert predicted[name] == pytest.approx(sigma, rel=0.12), name
