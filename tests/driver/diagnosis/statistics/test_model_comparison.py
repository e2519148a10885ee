from __future__ import annotations

import numpy as np
import pytest

from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.search.refit import as_wide_as_found, with_prior
from driver.diagnosis.statistics.model_comparison import (
    is_excess,
    log_evidence,
    share_described,
    share_explained,
)
from driver.diagnosis.statistics.score_test import score
from driver.identification.fit import fit
from driver.identification.objective import Evaluation, Objective
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter
from tests.driver.analytic import evaluation, formula

RNG = np.random.default_rng(19)
N_LOAD, N = 60, 5060
PARAMETERS = [Parameter("a", "", 0.0, 1.0), Parameter("Q", "MPa", 0.0, 10.0)]
A = RNG.standard_normal((2, N)) * [[1.0], [0.002]]
CAUSE = Cause("x", "material", ("Q",), "", "")


def of(residual: FloatArray) -> Evaluation:
    return evaluation(residual, np.eye(1, N), n_load=N_LOAD)


def test_the_excess_of_the_loads_is_not_lost_among_the_images() -> None:
    noise = RNG.standard_normal(N)
    load = np.arange(N) < N_LOAD
    before, half = of(noise + 2.0 * load), of(noise + np.sqrt(2.0) * load)
    assert share_explained(before, of(noise)) > 0.85
    assert share_explained(before, half) == pytest.approx(0.5, abs=0.2)
    assert share_explained(before, before) == 0.0


def test_noise_is_no_excess_and_loads_off_by_two_sigma_are() -> None:
    noise = RNG.standard_normal(N)
    assert not is_excess(of(noise)) and is_excess(of(noise + 2.0 * (np.arange(N) < N_LOAD)))


def test_a_share_of_what_tests_tell_from_noise_knows_no_scatter() -> None:
    """An excess of 40 among five thousand numbers is within their scatter of 100."""
    noise = RNG.standard_normal(N)
    noise[N_LOAD] = 0.0
    before = of(noise + np.sqrt(40.0) * np.eye(1, N, N_LOAD)[0])
    assert np.isnan(share_explained(before, of(noise)))
    assert share_described(before, of(noise), 0.0) == pytest.approx(1.0)
    assert share_described(before, of(noise), 10.0) == pytest.approx(0.8)
    assert share_described(of(noise), before, 10.0) == 0.0


def test_of_noise_nothing_can_be_explained() -> None:
    assert np.isnan(share_explained(of(RNG.standard_normal(N)), of(RNG.standard_normal(N))))


def _fit(objective: Objective, free: tuple[str, ...]) -> Evaluation:
    zero = {"a": 0.0, "Q": 0.0}
    return fit(objective, zero, free, 9, tolerance=1e-9).best


def test_the_evidence_takes_the_prior_that_was_stated_before_the_data_were_seen() -> None:
    """The fit itself has a prior as wide as the effect, ten scales; the score has that of one."""
    measured = np.array([0.3, 100.0]) @ A + RNG.standard_normal(N)
    bare = formula(lambda p: (p @ A, A), measured, PARAMETERS)
    stated = with_prior(bare, CAUSE)
    augmented = as_wide_as_found(stated, CAUSE, {"Q": 100.0})
    before, after = _fit(bare, ("a",)), _fit(augmented, ("a", "Q"))
    assert after.values["Q"] > _fit(stated, ("a", "Q")).values["Q"] + 0.1
    effect = bare.evaluate(before.values, ("Q",)).jacobian
    found = log_evidence(before, after, augmented, [CAUSE])
    assert found == pytest.approx(score(CAUSE, effect, before, 1).log_evidence, rel=1e-6)


def test_without_a_cause_there_is_no_evidence() -> None:
    here = of(RNG.standard_normal(N))
    assert log_evidence(here, here, formula(lambda p: (p @ A, A), A[0], PARAMETERS), []) == 0.0
