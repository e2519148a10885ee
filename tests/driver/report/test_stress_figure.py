"""Picture of the critical stress along the grains."""

from __future__ import annotations

import numpy as np

from driver.report.stress_figure import critical_stress


def test_each_grain_has_its_curve_and_twice_its_uncertainty_to_either_side() -> None:
    y, ratio = np.array([6.0, 8.0, 10.0]), np.array([1.0, 0.7, 1.0])
    grain = {"grain": 2, "y_um": y.tolist(), "ratio": ratio.tolist(), "sigma": [0.0, 0.05, 0.1]}
    (axes,) = critical_stress([grain], ["left", "right"]).axes
    curve = axes.lines[0]
    assert curve.get_label() == "right"
    np.testing.assert_array_equal(curve.get_xydata(), np.column_stack([y, ratio]))
    outline = np.asarray(axes.collections[0].get_paths()[0].vertices)
    of_middle = outline[outline[:, 0] == 8.0, 1]
    np.testing.assert_allclose([of_middle.min(), of_middle.max()], [0.6, 0.8])
