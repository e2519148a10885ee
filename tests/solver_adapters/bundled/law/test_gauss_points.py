"""One step of the law at a Gauss point against its equations and their complex step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solver_adapters.bundled.fem.initial import initial_state
from solver_adapters.bundled.law.gauss_points import (
    PointDerivatives,
    Points,
    PointTangents,
    points_of_grains,
)
from solver_adapters.bundled.law.law import N_LOCAL
from solver_adapters.bundled.law.point_kernels import SLIP_TOLERANCE
from solver_adapters.crystal import BCC48, bunge_matrix
from solver_adapters.interaction import bcc24_classes
from solver_adapters.interface import Integration
from solver_adapters.material import Material, StrainMeasure
from tests.solver_adapters.bundled import reference_law as reference
from tests.solver_adapters.bundled.rest import state_at_rest

AnyArray = NDArray[Any]
ROTATIONS = np.stack([bunge_matrix(281, 8, 47), bunge_matrix(211, 45, 150)])
N_POINTS = 4
GRAIN = np.arange(N_POINTS) % 2
DT = 1.5
TIGHT = 1e-12


@dataclass(frozen=True, eq=False)
class Solved:
    """The last of a few steps, at a few points, as the kernel solved it."""

    law: Material
    points: Points
    H: AnyArray
    state: AnyArray
    slips: AnyArray
    P: AnyArray
    tangent: AnyArray
    end: AnyArray

    @property
    def over(self) -> AnyArray:
        """Where the overstresses stand in the state."""
        rows = self.points.layout
        return np.arange(rows.over, rows.accumulated)

    @property
    def beside_over(self) -> AnyArray:
        """Where all else stands."""
        return np.setdiff1d(np.arange(self.points.layout.size), self.over)

    def step(self, i: int) -> reference.Step:
        R = self.points.rotation[GRAIN[i]]
        constants = self.points.local[GRAIN[i]]
        return reference.Step(
            self.points.strain_measure,
            self.H[i].reshape(3, 3) @ R.T,
            R,
            constants,
            self.state[i],
            DT,
            self.points.exponential,
            self.points.skin[i],
            self.points.interaction,
            self.law.slip_systems,
        )


BASELINE = Material(Q=15.0, b=40.0, tau0_112=1.07, tau0_grain2=0.9)
UNSYMMETRIC = np.eye(24) + 0.3 * np.random.default_rng(7).random((24, 24))
LAWS = {
    "baseline": BASELINE,
    "second back stress, asymmetry": replace(BASELINE, c2=4000.0, d2=120.0, tau0_antitwinning=1.2),
    "non-Schmid": replace(BASELINE, a1=0.3),
    "latent": replace(
        BASELINE, h_latent=1.4, interaction=tuple(map(tuple, bcc24_classes(1.0, 0.7, 0.4, 1.3)))
    ),
    "latent alone": Material(Q_latent=6.0, b=40.0),
    "everything": replace(
        BASELINE,
        c2=4000.0,
        d2=120.0,
        tau0_antitwinning=0.85,
        a1=-0.2,
        h_latent=0.2,
        Q_latent=2.0,
        interaction=tuple(map(tuple, UNSYMMETRIC)),
    ),
    "48 systems": Material(slip_systems=BCC48, tau0_grain2=0.9),
    "48 systems, families, asymmetry, non-Schmid": Material(
        slip_systems=BCC48, tau0_112=1.07, tau0_123=0.93, tau0_antitwinning=1.2, a1=0.3
    ),
    "48 systems, latent, second back stress": Material(
        slip_systems=BCC48, Q=15.0, b=40.0, h_latent=0.4, c2=4000.0, d2=120.0
    ),
}


def _solve(
    measure: StrainMeasure,
    loading: tuple[float, ...],
    law: str = "baseline",
    exponential: bool = True,
    seed: int = 0,
) -> Solved:
    """Strain by the multiples in `loading` of about 0.3 %, different at each point."""
    material = replace(LAWS[law], strain_measure=measure)
    skin = np.linspace(0.9, 1.1, N_POINTS) if law == "everything" else np.ones(N_POINTS)
    integration: Integration = "exponential" if exponential else "backward_euler"
    points = replace(points_of_grains(material, integration, GRAIN, ROTATIONS), skin=skin)
    noise = np.random.default_rng(seed).normal(size=(N_POINTS, 3, 3))
    pull = 0.003 * (np.diag([-0.4, 1.0, -0.4]) + 0.2 * noise)
    identity = np.broadcast_to(np.eye(3), (N_POINTS, 3, 3))
    end = initial_state(
        measure,
        material.slip_systems,
        1e-5,
        1e-4,
        identity @ ROTATIONS[GRAIN],
        np.ones(N_POINTS),
    )
    slips = np.zeros((N_POINTS, points.n_systems))
    for multiple in loading:
        H = (multiple * pull @ ROTATIONS[GRAIN]).reshape(N_POINTS, 9)
        state = end
        found = points.update(H, state, slips, DT)
        assert found.iterations.min() >= 0
        end, slips = found.state, found.slips
    return Solved(material, points, H, state, slips, found.P, found.C, end)


LOADINGS = {
    "elastic": (0.1,),
    "plastic": (0.5, 1.0, 2.0),
    "reversed": (1.0, 3.0, 2.4),
    "held": (1.0, 2.0, 2.0),
}


@pytest.fixture(scope="module", params=["small", "finite"])
def measure(request: pytest.FixtureRequest) -> StrainMeasure:
    name: StrainMeasure = request.param
    return name


@pytest.fixture(scope="module", params=[True, False], ids=["exponential", "backward Euler"])
def exponential(request: pytest.FixtureRequest) -> bool:
    choice: bool = request.param
    return choice


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=[pytest.mark.slow] if law.slip_systems == BCC48 else [])
        for name, law in LAWS.items()
    ],
)
def law(request: pytest.FixtureRequest) -> str:
    name: str = request.param
    return name


@pytest.fixture(scope="module", params=list(LOADINGS))
def solved(
    request: pytest.FixtureRequest, measure: StrainMeasure, law: str, exponential: bool
) -> Solved:
    return _solve(measure, LOADINGS[request.param], law, exponential)


def test_the_slips_of_a_step_solve_the_equations_of_the_law(solved: Solved) -> None:
    for i in range(N_POINTS):
        step, slips = solved.step(i), solved.slips[i]
        assert reference.overstress_at_rest(step, slips).max() < 0.5  # K (1e-14/dt)^(1/n)
        exact = reference.corrected(step, slips)
        np.testing.assert_allclose(slips, exact, rtol=0, atol=SLIP_TOLERANCE)
        stress, state = reference.response(step, exact)
        np.testing.assert_allclose(solved.P[i], stress, rtol=0, atol=1e-8)
        tolerance = np.full(state.size, 1e-13)
        # The overstress [MPa] follows the logarithm of the slip.
        over, size = state[solved.over], np.maximum(abs(slips), 1e-15)
        tolerance[solved.over] = 1e-10 + abs(over) * SLIP_TOLERANCE / size
        assert (abs(solved.end[i] - state) <= tolerance).all()


def test_the_start_of_the_iteration_does_not_matter(solved: Solved) -> None:
    rest = np.zeros_like(solved.slips)
    found = solved.points.update(solved.H, solved.state, rest, DT)
    assert found.iterations.min() >= 0
    np.testing.assert_allclose(found.slips, solved.slips, rtol=0, atol=10 * SLIP_TOLERANCE)
    np.testing.assert_allclose(found.P, solved.P, rtol=0, atol=1e-8)
    rows = solved.beside_over
    np.testing.assert_allclose(found.state[:, rows], solved.end[:, rows], rtol=0, atol=1e-12)


def test_an_iteration_that_overflows_does_not_pass(measure: StrainMeasure) -> None:
    """Nearly without viscosity a strain of 0.3 % is solved from rest, one of 30 % is not."""
    points = points_of_grains(
        Material(K=0.1, strain_measure=measure), "exponential", GRAIN, ROTATIONS
    )
    rest = np.zeros((N_POINTS, 24))
    for strain, solvable in ((0.003, True), (0.3, False)):
        H = (strain * np.diag([-0.4, 1.0, -0.4]) @ ROTATIONS[GRAIN]).reshape(N_POINTS, 9)
        found = points.update(H, state_at_rest(points), rest, DT)
        valid = found.iterations >= 0
        assert valid.all() == solvable
        assert np.isfinite(found.P[valid]).all()


def test_many_systems_slip_in_the_plastic_step(measure: StrainMeasure) -> None:
    slips = _solve(measure, LOADINGS["plastic"]).slips
    assert (np.count_nonzero(slips, axis=1) >= 6).all()


def test_the_tangent_is_the_complex_step_of_the_equations(solved: Solved) -> None:
    for i in range(N_POINTS):
        step, slips = solved.step(i), solved.slips[i]
        matrix = reference.jacobian(step, slips)
        expected = np.empty((9, 9))
        for j in range(9):
            unit = np.zeros(9)
            unit[j] = 1.0
            # The kernel differentiates in ∂u/∂X·R.
            expected[:, j], _ = reference.derivative(
                step, slips, matrix, H=unit.reshape(3, 3) @ step.R.T
            )
        scale = abs(expected).max()
        np.testing.assert_allclose(solved.tangent[i], expected, rtol=0, atol=TIGHT * scale)


def test_the_tangent_is_symmetric_where_the_law_says_so(solved: Solved) -> None:
    difference = solved.tangent - solved.tangent.transpose(0, 2, 1)
    symmetric = abs(difference).max() < 1e-12 * abs(solved.tangent).max()
    assert symmetric == (not solved.points.unsymmetric or not solved.slips.any())


def test_directional_derivatives_are_the_complex_step_of_the_equations(solved: Solved) -> None:
    """Along every parameter, every number of the history, every motion and every rotation."""
    spins = np.array(
        [
            [[0, 0, 0], [0, 0, -1], [0, 1, 0]],
            [[0, 0, 1], [0, 0, 0], [-1, 0, 0]],
            [[0, -1, 0], [1, 0, 0], [0, 0, 0]],
        ]
    )
    n_state = solved.points.layout.size
    count = N_LOCAL + n_state + 9 + 3 + 1
    local, state = np.zeros((2, count, N_LOCAL)), np.zeros((N_POINTS, n_state, count))
    H, rotation = np.zeros((N_POINTS, 9, count)), np.zeros((2, count, 3, 3))
    local[:, np.arange(N_LOCAL), np.arange(N_LOCAL)] = 1.0
    state[:, np.arange(n_state), N_LOCAL + np.arange(n_state)] = 1.0
    H[:, np.arange(9), N_LOCAL + n_state + np.arange(9)] = 1.0
    for row, spin in enumerate(spins, start=N_LOCAL + n_state + 9):
        rotation[:, row] = spin @ ROTATIONS
        gradient = solved.H.reshape(-1, 3, 3) @ ROTATIONS[GRAIN].transpose(0, 2, 1)
        H[:, :, row] = (gradient @ rotation[GRAIN, row]).reshape(-1, 9)
    skin = np.zeros((2, N_POINTS))
    skin[1] = 1.0
    skinned = np.zeros(count, dtype=np.int64)
    skinned[-1] = 1
    tangents = PointTangents(
        local,
        np.tile(np.arange(1, count + 1), (2, 1)),
        solved.points.frame(
            np.concatenate([np.zeros((1, 2, 3, 3)), rotation.transpose(1, 0, 2, 3)])
        ),
        skinned,
        skin,
    )
    # No direction changes an overstress that is null: the system was at rest; nor the last four of
    # the kinematic numbers in small strain, which are null always.
    state[:, solved.over] *= (solved.state[:, solved.over] != 0.0)[:, :, None]
    if solved.points.strain_measure == "small":
        state[:, 5:9] = 0.0
    out = solved.points.memory(count, n_state)
    out.state[:] = state
    solved.points.derive(solved.H, solved.state, solved.end, solved.slips, DT, H, tangents, out)
    dP, dstate = out.stress, out.state
    for i in range(N_POINTS):
        step, slips = solved.step(i), solved.slips[i]
        matrix = reference.jacobian(step, slips)
        for k in range(count):
            turn = rotation[GRAIN[i], k]
            gradient = H[i, :, k].reshape(3, 3) - step.H @ turn
            stress, end = reference.derivative(
                step,
                slips,
                matrix,
                constants=local[GRAIN[i], k],
                state=state[i, :, k],
                H=gradient @ step.R.T,
                R=turn,
                skin=np.array(float(k == count - 1)),
            )
            for found, expected in ((dP[i, :, k], stress), (dstate[i, :, k], end)):
                # In an elastic step two changes of size dH cancel in the state, in a relaxation
                # two of the size of that of the overstress.
                size = max(abs(H[i, :, k]).max(), abs(state[i, solved.over, k]).max())
                tolerance = 20 * TIGHT * abs(expected).max() + 1e-15 * size
                np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


def test_what_follows_a_later_motion_completes_the_derivative(solved: Solved) -> None:
    """Derivatives along a motion, at once, or without it and then with what it adds."""
    rng = np.random.default_rng(4)
    k, n_state = 3, solved.points.layout.size
    dH = 1e-3 * rng.normal(size=(N_POINTS, 9, k))
    local = rng.normal(size=(2, k, N_LOCAL))
    start = 1e-4 * rng.normal(size=(N_POINTS, n_state, k))
    start[:, solved.over] *= (solved.state[:, solved.over] != 0.0)[:, :, None]
    none = np.zeros(k, dtype=np.int64)
    still = solved.points.frame(np.zeros((1, 2, 3, 3)))
    tangents = PointTangents(local, np.tile(none, (2, 1)), still, none, np.zeros((1, N_POINTS)))

    def derive(along: AnyArray) -> PointDerivatives:
        s, out = solved, solved.points.memory(k, n_state)
        out.state[:] = start
        s.points.derive(s.H, s.state, s.end, s.slips, DT, along, tangents, out)
        return out

    whole, following = derive(dH).state, derive(np.zeros_like(dH))
    parts = following.state
    assert (abs(whole - parts).max() > 1e-6) == solved.slips.any()
    following.follow(dH)
    for rows in (solved.beside_over, solved.over):
        scale = abs(whole[:, rows]).max()
        np.testing.assert_allclose(parts[:, rows], whole[:, rows], atol=1e-11 * scale)


def test_a_constant_has_the_derivative_alone_in_one_grain_that_it_has_beside_all_others(
    solved: Solved,
) -> None:
    """What a direction costs and where it is computed hangs on what others ask for."""
    n_state = solved.points.layout.size
    still = solved.points.frame(np.zeros((1, 2, 3, 3)))

    def derive(local: AnyArray) -> PointDerivatives:
        k = local.shape[1]
        none = np.zeros(k, dtype=np.int64)
        tangents = PointTangents(local, np.tile(none, (2, 1)), still, none, np.zeros((1, N_POINTS)))
        s, out = solved, solved.points.memory(k, n_state)
        out.state[:] = 0.0
        s.points.derive(s.H, s.state, s.end, s.slips, DT, np.zeros((N_POINTS, 9, k)), tangents, out)
        return out

    together = derive(np.tile(np.eye(N_LOCAL), (2, 1, 1)))
    for constant in range(N_LOCAL):
        alone = np.zeros((2, 1, N_LOCAL))
        alone[1, 0, constant] = 1.0
        found, in_it = derive(alone), solved.points.grain == 1
        for of_it, of_all in ((found.stress, together.stress), (found.state, together.state)):
            expected = np.where(in_it[:, None], of_all[:, :, constant], 0.0)
            scale = 1e-12 * abs(expected).max()
            np.testing.assert_allclose(of_it[:, :, 0], expected, rtol=0, atol=scale)


def test_a_point_has_the_derivatives_that_it_has_without_any_before_it(
    measure: StrainMeasure, law: str, exponential: bool
) -> None:
    """Points in turn share memory, of which each has to write what it reads."""
    parts = [_solve(measure, loading, law, exponential) for loading in LOADINGS.values()]
    rng = np.random.default_rng(5)
    order = rng.permutation(np.tile(np.arange(N_POINTS * len(parts)), 4))
    H, state, end, slips = (
        np.concatenate([getattr(part, name) for part in parts])[order]
        for name in ("H", "state", "end", "slips")
    )
    k, n, n_state = 3, order.size, state.shape[1]
    dH = 1e-3 * rng.normal(size=(n, 9, k))
    start = 1e-4 * rng.normal(size=(n, n_state, k))
    start[:, parts[0].over] *= (state[:, parts[0].over] != 0.0)[:, :, None]
    local, none = rng.normal(size=(2, k, N_LOCAL)), np.zeros(k, dtype=np.int64)

    def derive(which: AnyArray) -> PointDerivatives:
        rows = order[which] % N_POINTS
        one = parts[0].points
        points = replace(one, grain=GRAIN[rows], frame_of=GRAIN[rows], skin=one.skin[rows])
        still = points.frame(np.zeros((1, 2, 3, 3)))
        tangents = PointTangents(
            local, np.tile(none, (2, 1)), still, none, np.zeros((1, which.size))
        )
        out = points.memory(k, n_state)
        out.state[:], out.by_slip[:] = start[which], np.nan
        points.derive(
            H[which], state[which], end[which], slips[which], DT, dH[which], tangents, out
        )
        out.follow(dH[which])
        return out

    together = derive(np.arange(n))
    for first in range(0, n, 16):  # as many as have memory of their own
        which = np.arange(first, min(first + 16, n))
        alone = derive(which)
        np.testing.assert_array_equal(together.stress[which], alone.stress)
        np.testing.assert_array_equal(together.state[which], alone.state)
