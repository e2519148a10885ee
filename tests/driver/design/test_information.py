from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pytest

from driver.design.information import LOOSE, SOURCES, groups_of, knowledge
from driver.results.design import Knowledge
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter
from tests.driver.analytic import evaluation

N_LOAD, N = 12, 40
RNG = np.random.default_rng(3)
NAMES = ("a", "b", "c")
PARAMETERS = {name: Parameter(name, "", 0.0, 1.0) for name in NAMES}
JACOBIAN = RNG.standard_normal((3, N)) * np.array([[3.0], [1.0], [0.3]])
WEIGHT = np.array([LOOSE**-2, 1.0, 1.0])


@dataclass
class PlainData:
    """Data with a simulation error of variance `error` beside unit noise in every number."""

    error: float = 0.0

    def noise_part(self, rows: FloatArray) -> FloatArray:
        return np.asarray(rows / np.sqrt(1.0 + self.error))


def known(
    jacobian: FloatArray, weight: FloatArray = WEIGHT, error: float = 0.0
) -> dict[str, Knowledge]:
    here = evaluation(
        np.zeros(jacobian.shape[1]), jacobian, weight, n_load=N_LOAD, free=NAMES,
        values=dict.fromkeys(NAMES, 0.0),
    )  # fmt: skip
    return {k.name: k for k in knowledge(here, cast(Any, PlainData(error)), PARAMETERS)}


def with_noise(loads: float = 1.0, images: float = 1.0) -> FloatArray:
    """The sensitivities with noises times a factor."""
    return np.concatenate([JACOBIAN[:, :N_LOAD] / loads, JACOBIAN[:, N_LOAD:] / images], axis=1)


def test_sigma_is_the_scatter_of_estimates_from_random_data() -> None:
    draws = RNG.standard_normal((20000, N))
    truths = RNG.standard_normal((20000, 3)) * np.where(WEIGHT == 1, 1.0, 0.0)
    inverse = np.linalg.inv(JACOBIAN @ JACOBIAN.T + np.diag(WEIGHT))
    estimates = (draws + truths @ JACOBIAN) @ JACOBIAN.T @ inverse
    scatter = (estimates - truths).std(axis=0)
    found = known(JACOBIAN)
    np.testing.assert_allclose([found[n].theta for n in NAMES], scatter, rtol=0.03)


def test_the_parts_of_the_variance_are_one() -> None:
    for k in known(with_noise(2.0), error=0.5).values():
        assert sum(k.parts.values()) == pytest.approx(1.0)
        assert set(k.parts) == set(SOURCES)


@pytest.mark.parametrize("source", ["loads", "images"])
def test_the_part_of_a_noise_is_the_power_of_the_variance_in_it(source: str) -> None:
    step = 1e-4
    here, after = known(JACOBIAN), known(with_noise(**{source: np.exp(step)}))
    for name in NAMES:
        power = np.log(after[name].theta / here[name].theta) / step
        assert power == pytest.approx(here[name].parts[source], abs=1e-3)


def test_half_the_noise_of_loads_halves_what_they_alone_limit() -> None:
    only = JACOBIAN.copy()
    only[:, N_LOAD:] = 0.0
    loose = np.full(3, LOOSE**-2)
    before, after = (
        known(only, loose),
        known(np.hstack([2 * only[:, :N_LOAD], only[:, N_LOAD:]]), loose),
    )
    for name in NAMES:
        assert before[name].parts["loads"] == pytest.approx(1.0, abs=1e-4)
        assert before[name].limit.startswith("the noise of the loads 100%")
        assert after[name].theta == pytest.approx(before[name].theta / 2, rel=1e-4)


def test_the_simulations_error_has_its_share_of_what_the_data_leave() -> None:
    found = known(JACOBIAN, error=3.0)["a"]
    data = found.parts["images"] + found.parts["loads"] + found.parts["simulation"]
    assert found.parts["simulation"] / data == pytest.approx(3.0 / 4.0)


def test_a_parameter_that_data_do_not_depend_on_is_named_so() -> None:
    blind = JACOBIAN.copy()
    blind[1] = 0.0
    found = known(blind)["b"]
    assert found.limit.startswith("not seen")
    assert found.theta == pytest.approx(1.0) and found.parts["prior"] == pytest.approx(1.0)
    # Without a prior there is nothing to say of it.
    blind[0] = 0.0
    nothing = known(blind)["a"]
    assert nothing.sigma == np.inf and nothing.limit.startswith("not seen")


def test_what_another_parameter_hides_is_named_with_it() -> None:
    twins = JACOBIAN.copy()
    twins[1] = 5 * JACOBIAN[0] + 0.05 * RNG.standard_normal(N)
    found = known(twins)["b"]
    assert found.partner == "a" and "correlated with a" in found.limit
    # With a known, only b and c are left.
    across = known(twins[[1, 1, 2]] * np.array([[0.0], [1.0], [1.0]]))["b"]
    assert found.factor == pytest.approx(across.theta / found.theta, rel=1e-6)


def test_one_that_is_hidden_entirely_is_held_by_its_prior() -> None:
    twins = JACOBIAN.copy()
    twins[1] = JACOBIAN[0]
    found = known(twins)["b"]
    assert found.limit.startswith("not separated, the prior holds it")


def test_more_data_know_more() -> None:
    more = np.hstack([JACOBIAN, RNG.standard_normal((3, 5))])
    before, after = known(JACOBIAN), known(more)
    assert all(after[n].theta < before[n].theta for n in NAMES)


def test_what_moves_the_boundary_belongs_together() -> None:
    names = ("tau0", "elongation_1", "tilt_2", "tilt_drift", "lambda_plus_Y", "origin_X")
    assert groups_of(names) == {
        "tau0": ("tau0",),
        "the knots": ("elongation_1", "tilt_2"),
        "tilt_drift": ("tilt_drift",),
        "the apex amplitudes": ("lambda_plus_Y",),
        "the position in the images": ("origin_X",),
    }
