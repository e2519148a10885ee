"""The cells of examples/notebook.ipynb in their order, on a third of its images."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot

from driver.case.model import Case
from driver.experiment.orientations import orientations_of

NOTEBOOK = Path(__file__).resolve().parents[2] / "examples" / "notebook.ipynb"
CELLS = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]


def modulus_along_Y(case: Case, grain: int) -> float:
    """Nye, Physical Properties of Crystals: 1/E = s11 − 2 (s11 − s12 − s44/2) Σ l²m² [MPa]."""
    m = case.material.to_material()
    inverse = np.linalg.inv([[m.C11, m.C12, m.C12], [m.C12, m.C11, m.C12], [m.C12, m.C12, m.C11]])
    a, b, c = orientations_of(case)[grain][1] ** 2
    less = 2 * (inverse[0, 0] - inverse[0, 1] - 0.5 / m.C44) * (a * b + b * c + c * a)
    return float(1 / (inverse[0, 0] - less))


def test_the_notebook_is_kept_without_what_it_shows() -> None:
    code = [cell for cell in CELLS if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    assert len({cell["id"] for cell in CELLS}) == len(CELLS)


@pytest.mark.usefixtures("alpha")
def test_the_notebook_finds_the_truth_that_others_made() -> None:
    names: dict[str, Any] = {}
    pyplot.switch_backend("agg")
    try:
        for cell in CELLS:
            if cell["cell_type"] == "code":
                exec("".join(cell["source"]), names)
    finally:
        pyplot.close("all")
    # Code_Aster's loads: the truth of the README meets them, the law without its effect does not.
    simulated, without = (names["miss"](names[name]) for name in ("simulated", "without"))
    assert simulated < 1.8 and without > 1.5 * simulated
    # The elongation by the images is that with which the specimen was pulled (README.md).
    images, truth = names["images"], names["simulated"].motion.sel(component="v")
    length = names["case"].specimen.length
    ends = [truth.values[:, np.isclose(truth.Y, y)].mean(axis=1) for y in (0.0, length)]
    off = (images.elongation.values - (ends[1] - ends[0])) / images.elongation.sigma
    assert np.sqrt(np.mean(off**2)) < 1.5
    for grain, curve in enumerate(names["curves"]):
        slope = curve.stress_along_Y[1] / curve.strain_along_Y[1]
        assert slope == pytest.approx(modulus_along_Y(names["case"], grain), rel=1e-6)
