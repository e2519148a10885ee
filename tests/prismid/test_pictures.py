from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib import pyplot

import prismid
from tests.driver.invented_results import Results, results, written
from tests.prismid.test_results import diagnosed as diagnosed
from tests.prismid.test_results import record

__all__ = ["results", "written"]  # fixtures


def test_a_measurement_has_its_figures_and_none_is_shown(alpha: Path) -> None:
    before = sorted((alpha / "results").iterdir())
    drawn = prismid.figures(alpha)
    assert set(drawn) == {path.stem for path in before if path.suffix == ".png"}
    assert pyplot.get_fignums() == []
    assert sorted((alpha / "results").iterdir()) == before


def test_what_a_figure_shows_are_the_measured_values(alpha: Path) -> None:
    images = prismid.read_results(alpha)["images"]
    axes = prismid.figures(alpha)["measure_travel"].axes[0]
    shown = np.concatenate([line.get_xydata() for line in axes.get_lines()])
    expected = np.column_stack([images["stage"], 1e3 * images["elongation"]])
    for row in expected:
        assert np.isclose(shown, row, rtol=1e-9, atol=1e-9).all(axis=1).any()


def test_a_finished_diagnosis_has_all_figures_of_the_report(
    diagnosed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    del monkeypatch
    record(diagnosed, "mesh", "measure", "identify", "diagnose")
    without = prismid.figures(diagnosed)
    assert not [name for name in without if name.startswith("report_")]
