"""The 24 scalar equations of a point at given stresses, against the law written in NumPy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from meshes.arrays import FloatArray
from solver_adapters.bundled.law import NS, slip
from solver_adapters.bundled.law import workspace_layout as rows
from solver_adapters.bundled.law.law import (
    FIRST_112,
    P_A1,
    P_C,
    P_C2,
    P_D,
    P_D2,
    P_LATENT,
    local_parameters,
    system_modes,
)
from solver_adapters.bundled.law.state_layout import N_STATE, S_ACC, S_OVER, S_X, S_X2
from solver_adapters.constants import interaction_matrix
from solver_adapters.crystal import BCC
from solver_adapters.interaction import bcc24_classes
from solver_adapters.material import Material
from tests.solver_adapters.bundled import reference_law as reference
from tests.solver_adapters.bundled.from_python import FromPython

kernels = FromPython(slip)

AnyArray = NDArray[Any]
BASELINE = Material(Q=15.0, b=40.0, tau0_112=1.07)
LAWS = {
    "baseline": BASELINE,
    "second back stress, asymmetry": replace(BASELINE, c2=4000.0, d2=120.0, tau0_antitwinning=1.2),
    "non-Schmid": replace(BASELINE, a1=0.3),
    "latent": replace(
        BASELINE, h_latent=1.4, interaction=tuple(map(tuple, bcc24_classes(1.0, 0.7, 0.4, 1.3)))
    ),
    "latent alone": Material(Q_latent=6.0, b=40.0),
}
DT = 1.5
EPS = 1e-30


@dataclass(frozen=True, eq=False)
class Point:
    """A point at given stresses: its law and history, resolved and conjugate shear stresses."""

    step: reference.Step
    tau: FloatArray
    other: FloatArray

    @property
    def coupled(self) -> bool:
        """Whether slip on one system hardens others."""
        alone = np.array_equal(self.step.interaction, np.eye(NS))
        return not alone or self.step.constants[P_LATENT].real != 0.0

    def workspace(self, slips: FloatArray, solved: bool) -> FloatArray:
        """The workspace with slips S Δp to begin with."""
        w, s = np.zeros(rows.N_SLIP_ROWS), self.step
        kernels.prepare_slip(w, s.interaction, system_modes(BCC).sense)
        end = np.zeros(N_STATE)
        end[S_OVER:S_ACC] = np.sign(slips) * reference.overstress(s, slips).real
        kernels.load_point(w, s.state, s.constants, 1.0, DT, s.exponential, slips, solved, end)
        return w

    def evaluate(self, w: FloatArray) -> float:
        """The kernel's residuals; the sum of their sizes."""
        w[rows.TAU : rows.TAU + NS] = self.tau
        w[rows.OTHER : rows.OTHER + NS] = self.other
        s = self.step
        error: float = kernels.evaluate_systems(w, DT, s.constants, s.exponential, self.coupled)
        return error

    def residuals(self, slips: AnyArray) -> AnyArray:
        """S (τ − c x − c2 x2) + a1 τ' − r − v of the systems that slip, else 0."""
        s, p, sign = self.step, self.step.constants, np.sign(slips.real)
        factor = np.where(np.arange(NS) < FIRST_112, 1.0 + 0.5 * p[P_A1], 1.0)
        back = p[P_C] * reference.recalled(s, s.state[S_X:S_OVER], slips, p[P_D])
        back = back + p[P_C2] * reference.recalled(s, s.state[S_X2:], slips, p[P_D2])
        total = s.state[S_ACC:S_X2] + slips * sign
        found = sign * (factor * self.tau - back) + p[P_A1] * self.other
        found = found - reference.threshold(s, sign, total) - reference.overstress(s, slips)
        return np.where(sign != 0, found, 0.0)


def _point(law: str, exponential: bool, seed: int = 0) -> Point:
    rng = np.random.default_rng(seed)
    material = LAWS[law]
    state = np.zeros(N_STATE)
    state[S_X:S_OVER] = rng.uniform(-0.5, 0.5, NS) / material.d
    state[S_OVER:S_ACC] = rng.uniform(-8.0, 8.0, NS)
    state[S_ACC:S_X2] = rng.uniform(0.0, 5e-3, NS)
    state[S_X2:] = rng.uniform(-0.5, 0.5, NS) / material.d2
    step = reference.Step(
        "small",
        np.zeros((3, 3)),
        np.eye(3),
        local_parameters(material, 1)[0],
        state,
        DT,
        exponential,
        interaction=interaction_matrix(material),
    )
    # Half of the systems are pushed, the others stay below their threshold.
    pushed = rng.permutation(NS) < 12
    tau = np.where(pushed, rng.choice([-1.0, 1.0], NS) * rng.uniform(70.0, 110.0, NS), 0.5)
    other = rng.uniform(-20.0, 20.0, NS) * (np.arange(NS) < FIRST_112)
    return Point(step, tau, other * pushed)


def _some_slips(point: Point) -> FloatArray:
    """Signed slips of any size on the pushed systems."""
    sizes = 10.0 ** np.random.default_rng(3).uniform(-9.0, -3.0, NS)
    return np.where(abs(point.tau) > 1.0, np.sign(point.tau) * sizes, 0.0)


@pytest.fixture(params=[True, False], ids=["exponential", "backward Euler"])
def exponential(request: pytest.FixtureRequest) -> bool:
    choice: bool = request.param
    return choice


@pytest.fixture(params=list(LAWS))
def law(request: pytest.FixtureRequest) -> str:
    name: str = request.param
    return name


def test_residuals_are_those_of_the_law_for_any_slips(law: str, exponential: bool) -> None:
    point = _point(law, exponential)
    slips = _some_slips(point)
    w = point.workspace(slips, solved=True)
    point.evaluate(w)
    expected = point.residuals(slips)
    assert np.count_nonzero(expected) == 12
    found = w[rows.RESIDUAL : rows.RESIDUAL + NS]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(w[rows.SLIP : rows.SLIP + NS], abs(slips))


def test_weights_are_the_inverse_of_the_jacobian_of_the_residuals(
    law: str, exponential: bool
) -> None:
    """By the complex step; between systems only where one hardens another."""
    point = _point(law, exponential)
    slips = _some_slips(point)
    w = point.workspace(slips, solved=True)
    point.evaluate(w)
    active = np.flatnonzero(slips)
    jacobian = np.empty((active.size, active.size))
    for column, s in enumerate(active):
        bumped = slips.astype(complex)
        bumped[s] += 1j * EPS * np.sign(slips[s])
        jacobian[:, column] = point.residuals(bumped).imag[active] / EPS
    if point.coupled:
        weights = w[rows.WEIGHTS : rows.WEIGHTS + NS * NS].reshape(NS, NS)[np.ix_(active, active)]
    else:
        weights = np.diag(w[rows.WEIGHT : rows.WEIGHT + NS][active])
    np.testing.assert_allclose(-weights @ jacobian, np.eye(active.size), atol=1e-8)


def test_newtons_method_at_fixed_stress_finds_the_root_of_each_system(exponential: bool) -> None:
    """From rest, beside a bracketing search on the equation of each system alone."""
    point = _point("second back stress, asymmetry", exponential, seed=5)
    w = point.workspace(np.zeros(NS), solved=False)
    iterations = 0
    while point.evaluate(w) > 1e-13:
        kernels.advance_slips(w, point.step.constants, DT, exponential, False)
        iterations += 1
        assert iterations < 40
    found = w[rows.SIGNED : rows.SIGNED + NS]
    for s in range(NS):
        sense = np.sign(point.tau[s])

        def residual(log_slip: float, s: int = s, sense: float = sense) -> float:
            slips = np.zeros(NS)
            slips[s] = sense * np.exp(log_slip)
            return float(point.residuals(slips)[s])

        if abs(point.tau[s]) < 1.0:
            assert found[s] == 0.0
        else:
            root = sense * np.exp(brentq(residual, np.log(1e-14), np.log(0.5), xtol=1e-13))
            np.testing.assert_allclose(found[s], root, rtol=1e-7, atol=1e-13)


@pytest.mark.parametrize("share", [0.1, 0.9])
def test_a_relaxing_system_rests_where_its_own_step_would_empty_it(share: float) -> None:
    """It slips by 5e-6: times 0.1¹⁰ that does not count, times 0.1⁹, as it relaxes, it does.

    One that went on would leave the relaxation with the next step that raises it.
    """
    point = _point("baseline", True)
    onward = np.sign(point.step.state[S_OVER:S_ACC])
    w = point.workspace(5e-6 * onward, solved=False)
    point.evaluate(w)
    fall, slip, step, slope = (
        slice(row, row + NS) for row in (rows.FALL, rows.SLIP, rows.STEP, rows.FALL_SLOPE)
    )
    falls, before = w[fall] > 0.0, w.copy()
    assert np.count_nonzero(falls) == 8
    w[step] = (share - 1.0) * w[slip] * w[slope]
    kernels.advance_slips(w, point.step.constants, DT, True, False)
    if share == 0.1:
        assert not w[slip][falls].any() and not w[fall][falls].any()
    else:
        end = before[fall][falls] - np.log(share)
        np.testing.assert_allclose(w[fall][falls], end, rtol=1e-12)
        assert (w[slip][falls] > 0.0).all()
        assert (w[slip][falls] < before[slip][falls]).all()


def test_the_stored_state_is_that_of_the_law(law: str, exponential: bool) -> None:
    point = _point(law, exponential)
    slips = _some_slips(point)
    w = point.workspace(slips, solved=True)
    point.evaluate(w)
    state, stored = np.zeros(N_STATE), np.empty(NS)
    kernels.store_slips(w, state, stored)
    np.testing.assert_array_equal(stored, slips)
    rows = (S_X, S_OVER, S_ACC, S_X2, N_STATE)
    # Back strains are of the size of 1e-3, overstresses of 10 MPa.
    for k, (expected, atol) in enumerate(
        zip(reference.hardening(point.step, slips), (1e-15, 1e-9, 1e-15, 1e-15), strict=True)
    ):
        if k == 3 and point.step.constants[P_C2] == 0.0:
            continue
        np.testing.assert_allclose(state[rows[k] : rows[k + 1]], expected, rtol=1e-11, atol=atol)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 64.0, 1e300])
def test_neither_an_error_nor_a_slip_beyond_measure_is_sound(bad: float) -> None:
    point = _point("baseline", True)
    w = point.workspace(np.full(NS, 1e-3), solved=True)
    assert kernels.is_sound(w, 0.0)
    assert kernels.is_sound(w, 24.0)
    assert not kernels.is_sound(w, bad)
    w[rows.SLIP + 7] = bad
    assert not kernels.is_sound(w, 0.0)
