from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot

import prismid
from tests.driver.invented_results import results, written
from tests.prismid.test_results import diagnosed as diagnosed
from tests.prismid.test_results import record

__all__ = ["results", "written"]  # fixtures


def test_a_measurement_has_its_figures_and_none_is_shown_or_written(alpha: Path) -> None:
    before = sorted((alpha / "results").iterdir())
    drawn = prismid.figures(alpha)
    assert set(drawn) == {path.stem for path in before if path.suffix == ".png"}
    assert pyplot.get_fignums() == []
    assert sorted((alpha / "results").iterdir()) == before
    # What is shown are the measured values.
    images = prismid.read_results(alpha)["images"]
    lines = drawn["measure_travel"].axes[0].get_lines()
    shown = np.concatenate([np.asarray(line.get_xydata()) for line in lines])
    expected = np.column_stack([images["stage"], 1e3 * images["elongation"]])
    assert all(np.isclose(shown, row).all(axis=1).any() for row in expected)


def test_a_case_that_is_diagnosed_and_advised_has_all_figures_of_the_report(
    diagnosed: Path,
) -> None:
    before = prismid.figures(diagnosed)
    assert not [name for name in before if name.startswith("report_")]
    record(diagnosed, "mesh", "measure", "identify", "diagnose", "advise")
    after = prismid.figures(diagnosed)
    of_report = {name for name in after if name.startswith("report_")}
    # As docs/results.md lists them.
    assert {"report_sensitivity", "report_correlation", "report_convergence", "report_loads"} <= (
        of_report
    )
    assert set(before) == set(after) - of_report
