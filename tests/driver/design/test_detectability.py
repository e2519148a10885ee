from __future__ import annotations

import numpy as np
import pytest

from driver.design.detectability import NAMED_AT, outlooks
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.statistics.score_test import SEEN_AT
from driver.results.design import Outlook
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter
from tests.driver.analytic import evaluation

N_LOAD, N = 10, 50
RNG = np.random.default_rng(6)
FITTED = ("tau0", "elongation_1")
SCALES = {"load_gain": 0.03, "elastic_scale": 0.05, "Q": 10.0, "height_scale": 0.03}
PARAMETERS = {name: Parameter(name, "", 0.0, scale) for name, scale in SCALES.items()} | {
    name: Parameter(name, "", 1.0, 1.0) for name in FITTED
}
CAUSES = tuple(Cause(name, "material", (name,), "", "") for name in SCALES)


def found(rows: FloatArray) -> dict[str, Outlook]:
    """Outlooks of the four causes; rows are the two fitted parameters, then the causes."""
    values, weight = dict.fromkeys(PARAMETERS, 1.0), np.full(2, 1e-6)
    fitted = evaluation(np.zeros(N), rows[:2], weight, n_load=N_LOAD, free=FITTED, values=values)
    wide = evaluation(
        np.zeros(N), rows, np.zeros(6), n_load=N_LOAD, free=(*FITTED, *SCALES), values=values
    )
    return {o.cause.name: o for o in outlooks(CAUSES, wide, fitted, PARAMETERS)}


def random_rows() -> FloatArray:
    return RNG.standard_normal((6, N))


def test_the_smallest_magnitude_leaves_the_stated_misfit_once_all_is_fitted() -> None:
    rows = random_rows()
    for cause, outlook in found(rows).items():
        (visible,) = outlook.parameters
        row = rows[2 + list(SCALES).index(cause)]
        for magnitude, misfit in ((visible.seen, SEEN_AT), (visible.named, NAMED_AT)):
            data = magnitude / SCALES[cause] * row
            rest = data - rows[:2].T @ np.linalg.lstsq(rows[:2].T, data, rcond=None)[0]
            assert np.linalg.norm(rest) == pytest.approx(misfit, rel=1e-5)
        assert visible.sigma * SEEN_AT == pytest.approx(visible.seen)


def test_parallel_causes_are_alike_also_where_a_fitted_parameter_lies_between() -> None:
    rows = random_rows()
    rows[3] = 2.0 * rows[2] + 30.0 * rows[0]
    alike = {name: set(outlook.alike) for name, outlook in found(rows).items()}
    assert alike == {
        "load_gain": {"elastic_scale"}, "elastic_scale": {"load_gain"}, "Q": set(),
        "height_scale": set(),
    }  # fmt: skip


def test_a_cause_that_data_do_not_depend_on_is_undetectable() -> None:
    rows = random_rows()
    rows[2] = 0.0
    (visible,) = found(rows)["load_gain"].parameters
    assert visible.seen == np.inf and visible.left == 0.0 and visible.sigma == np.inf


def test_a_cause_that_a_fitted_parameter_takes_is_told_with_it() -> None:
    rows = random_rows()
    rows[2] = 20.0 * rows[1] + rows[2]
    (visible,) = found(rows)["load_gain"].parameters
    assert visible.hidden_by == "the knots" and visible.left < 0.1 and visible.factor < 0.2


def test_the_share_in_the_loads_is_what_is_left_there() -> None:
    rows = random_rows()
    rows[:2, :N_LOAD] = 0.0  # nothing that is fitted shows in the loads
    rows[2, N_LOAD:] = 0.0
    rows[3, :N_LOAD] = 0.0
    outlook = found(rows)
    assert outlook["load_gain"].parameters[0].loads == pytest.approx(1.0)
    assert outlook["elastic_scale"].parameters[0].loads == pytest.approx(0.0)
    assert 0.0 < outlook["Q"].parameters[0].loads < 1.0
