from __future__ import annotations

import numpy as np
import pytest

from driver.diagnosis.answer.moved_by_second_mesh import moved_by_second_mesh, moved_told
from tools import closed_form
from tools.closed_form_diagnosis import identified

BENCH = closed_form.problem()


def test_values_that_differ_by_more_than_their_sigma_are_told_with_what_to_write() -> None:
    objective, fitted = identified(BENCH, closed_form.objective(BENCH, BENCH.truth))
    best, parameters = fitted.best, objective.parameters
    sigma = {
        name: float(s) * parameters[name].slope(fitted.values[name])
        for name, s in zip(best.free, np.sqrt(np.diag(fitted.covariance)), strict=True)
    }
    before = fitted.values | {
        "tau0": fitted.values["tau0"] - 1.5 * sigma["tau0"],
        "c": fitted.values["c"] + 0.8 * sigma["c"],
        "elongation_1": fitted.values["elongation_1"] + 9.0 * sigma["elongation_1"],
    }
    moved = moved_by_second_mesh(before, fitted, parameters, ("tau0", "c", "d"))
    assert moved == {"tau0": pytest.approx(1.5)}
    (told,) = moved_told(moved, (2.0, 2 / 3))
    assert "of 0.667 µm, moves τ₀ by +1.5 σ" in told
    keys = (
        'specimen.cells = "hex20", specimen.mesh_size_um = 2 and specimen.fine_mesh_size_um = 0.667'
    )
    assert keys in told


def test_where_nothing_moves_nothing_is_told() -> None:
    assert moved_told({}, (2.0, 1.0)) == ()
