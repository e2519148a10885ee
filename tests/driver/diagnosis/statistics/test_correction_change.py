from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from driver.diagnosis.statistics.correction_change import changed_on_the_way, whitened_difference
from driver.identification.correction import Correction, correction
from tools import closed_form
from tools.closed_form_diagnosis import finer, priors

BENCH = closed_form.problem()
OBJECTIVE = replace(closed_form.objective(BENCH, BENCH.truth), prior=priors(BENCH.truth))
FREE = ("tau0", "c")


def test_a_change_of_a_correction_counts_as_far_as_no_fitted_parameter_takes_it() -> None:
    """Least squares with one more row for the prior of each parameter, by SVD."""
    at = OBJECTIVE.evaluate(BENCH.truth, FREE)
    names = (*FREE, "d")
    begin = BENCH.truth | {"tau0": 1.2 * BENCH.truth["tau0"], "d": 0.9 * BENCH.truth["d"]}
    start = OBJECTIVE.evaluate(begin, names)
    taken = correction(
        BENCH.model, finer(BENCH, 0.05), start.prediction, begin, free=names, near=Correction()
    )
    objective = replace(OBJECTIVE, correction=taken)
    change = whitened_difference(objective, taken.at(BENCH.truth), taken.at(begin))
    rows = np.linalg.cholesky(at.hessian - at.jacobian @ at.jacobian.T).T
    whole = np.concatenate((at.jacobian.T, rows))
    wanted = np.concatenate((change, np.zeros(len(FREE))))
    step = np.linalg.lstsq(whole, wanted, rcond=None)[0]
    left = np.linalg.norm(change - at.jacobian.T @ step)
    assert 0.0 < left < 0.9 * np.linalg.norm(change)
    assert changed_on_the_way(objective, begin, at) == pytest.approx(left, rel=1e-9)


def test_a_constant_correction_changes_nowhere() -> None:
    at = OBJECTIVE.evaluate(BENCH.truth, FREE)
    assert changed_on_the_way(OBJECTIVE, BENCH.truth | {"tau0": 80.0}, at) == 0.0


def test_a_correction_without_derivatives_changes_along_the_parameter_of_which_it_knows() -> None:
    at = OBJECTIVE.evaluate(BENCH.truth, FREE)
    begin, end = (BENCH.truth | {"d": share * BENCH.truth["d"]} for share in (0.9, 1.1))
    there = correction(BENCH.model, finer(BENCH, 0.05), OBJECTIVE.model.predict(end), end)
    taken = Correction().through(there, end, begin["d"], BENCH.model.parameters["d"])
    assert changed_on_the_way(replace(OBJECTIVE, correction=taken), begin, at) > 0.1
