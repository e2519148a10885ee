"""The law at one point against closed forms of elasticity and of single slip."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solver_adapters.bundled.material_point import (
    MaterialPointCurve,
    loaded_along,
    strain_path,
    uniaxial_stress,
)
from solver_adapters.crystal import bunge_matrix
from solver_adapters.interface import BadSimulationError, Integration, SolverError
from solver_adapters.material import Material, StrainMeasure

IRON = Material(strain_measure="small")
ONE_SLIP = (1.0, 6.0, 3.0)  # inside the standard triangle


def pulled(material: Material, direction: tuple[float, float, float], strain: float, n: int = 3,
           rate: float = 1e-4, **how: Any) -> MaterialPointCurve:  # fmt: skip
    course = np.linspace(0.0, strain, n)
    return uniaxial_stress(material, loaded_along(direction), course, abs(course) / rate, **how)


def schmid_factors_110(direction: tuple[float, float, float]) -> NDArray[np.float64]:
    """Of the twelve {110}⟨111⟩ systems, from their definition, the largest first."""
    axis = np.array(direction) / np.linalg.norm(direction)
    along = [np.array(m) for m in product((1, -1), repeat=3) if m[0] > 0]
    normals = [np.array(n) for n in product((0, 1, -1), repeat=3) if np.abs(n).sum() == 2]
    factors = [
        abs(axis @ m) * abs(axis @ n) / np.sqrt(6.0)
        for m in along
        for n in normals
        if m @ n == 0 and n[np.flatnonzero(n)[0]] > 0
    ]
    assert len(factors) == 12
    return np.sort(factors)[::-1]


@pytest.mark.parametrize("measure", ["small", "finite"])
@pytest.mark.parametrize(("direction", "share"), [
    ((1, 0, 0), 0.0), ((1, 1, 0), 1 / 4), ((1, 1, 1), 1 / 3),
])  # fmt: skip
def test_the_elastic_slope_is_youngs_modulus_of_a_cubic_crystal(
    direction: tuple[float, float, float], share: float, measure: StrainMeasure
) -> None:
    """Nye, Physical Properties of Crystals: 1/E = s11 − 2 (s11 − s12 − s44/2) Σ l²m²."""
    m = replace(IRON, strain_measure=measure)
    s11 = (m.C11 + m.C12) / ((m.C11 - m.C12) * (m.C11 + 2 * m.C12))
    s12 = -m.C12 / ((m.C11 - m.C12) * (m.C11 + 2 * m.C12))
    modulus = 1 / (s11 - 2 * (s11 - s12 - 0.5 / m.C44) * share)
    strain = 1e-6
    curve = pulled(m, direction, strain)
    # In finite strain the slope changes by some strains, and so does the section.
    tolerance = 1e-9 if measure == "small" else 10 * strain
    assert curve.stress_along_Y[-1] / strain == pytest.approx(modulus, rel=tolerance)
    assert not curve.accumulated_slip.any()


@pytest.mark.parametrize("integration", ["exponential", "backward_euler"])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_single_slip_saturates_at_friction_back_stress_and_viscous_stress(
    integration: Integration, sense: float
) -> None:
    """σ = (τ0 + c/d + K γ̇^(1/n)) / m at the rate γ̇ = ε̇/m."""
    law = replace(IRON, tau0=40.0, c=2000.0, d=1000.0, K=3.0, n=10.0, tau0_112=3.0)
    first, second = schmid_factors_110(ONE_SLIP)[:2]
    rate = 1e-4
    curve = pulled(law, ONE_SLIP, sense * 0.02, n=81, rate=rate, integration=integration)
    saturated = law.tau0 + law.c / law.d + law.K * (rate / first) ** (1 / law.n)
    assert second * saturated / first < law.tau0  # no other system slips
    assert curve.stress_along_Y[-1] == pytest.approx(sense * saturated / first, rel=1e-6)
    assert np.count_nonzero(curve.accumulated_slip[-1]) == 1


def test_the_back_stress_of_single_slip_follows_its_slip() -> None:
    """dx = dγ − d x dp has the solution (1 − exp(−d p))/d under monotonic slip."""
    law = replace(IRON, tau0=40.0, c=2000.0, d=1000.0, K=3.0, tau0_112=3.0)
    curve = pulled(law, ONE_SLIP, 0.004, n=9)
    system = int(np.argmax(curve.accumulated_slip[-1]))
    p = curve.accumulated_slip[:, system]
    assert p[-1] > 1 / law.d
    expected = law.c / law.d * (1 - np.exp(-law.d * p))
    np.testing.assert_allclose(abs(curve.back_stress[:, system]), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(abs(curve.slip), curve.accumulated_slip, rtol=0, atol=1e-15)


@pytest.mark.parametrize("measure", ["small", "finite"])
def test_all_stress_but_that_along_the_axis_vanishes_in_multiple_slip(
    measure: StrainMeasure,
) -> None:
    rotation = bunge_matrix(211, 45, 150)
    law = replace(IRON, strain_measure=measure, a1=0.2, h_latent=0.3, Q=20.0)
    course = np.array([0.0, 0.002, 0.01, 0.008, 0.03])
    curve = uniaxial_stress(law, rotation, course, np.arange(5.0) * 50)
    along = curve.stress_along_Y[1:]
    others = curve.stress[1:].copy()
    others[:, 1, 1] = 0.0
    assert abs(along).min() > 60 and abs(others).max() < 1e-6
    np.testing.assert_array_equal(curve.strain_along_Y, course)
    # The line along Y keeps its direction.
    assert not curve.gradient[:, [0, 2], 1].any()


def test_a_turned_crystal_bears_no_stress_in_finite_strain() -> None:
    angle = np.linspace(0.0, 1.0, 6)
    cos, sin, none = np.cos(angle), np.sin(angle), np.zeros(6)
    turned = np.array([[cos, -sin, none], [sin, cos, none], [none, none, none + 1]])
    gradient = np.moveaxis(turned, 2, 0) - np.eye(3)
    curve = strain_path(Material(), bunge_matrix(10, 20, 30), gradient, np.arange(6.0),
                        steps_per_interval=1)  # fmt: skip
    assert abs(curve.stress).max() < 1e-8
    assert not curve.accumulated_slip.any()


def test_the_strain_that_uniaxial_stress_took_gives_that_stress_back() -> None:
    law, rotation, time = Material(), loaded_along(ONE_SLIP), np.linspace(0.0, 40.0, 41)
    pull = uniaxial_stress(law, rotation, 1e-4 * time, time, steps_per_interval=1)
    again = strain_path(law, rotation, pull.gradient, time, steps_per_interval=1)
    np.testing.assert_allclose(again.stress, pull.stress, atol=1e-5)
    np.testing.assert_allclose(again.slip, pull.slip, atol=1e-12)


def test_a_pull_in_one_coarse_step_is_cut_and_ends_where_small_steps_end() -> None:
    law, time = replace(IRON, K=1.0), np.array([0.0, 1000.0])
    ends = [
        uniaxial_stress(law, loaded_along((1, 2, 5)), np.array([0.0, 0.05]), time,
                        steps_per_interval=steps).stress_along_Y[-1]
        for steps in (1, 100)
    ]  # fmt: skip
    assert ends[0] == pytest.approx(ends[1], rel=2e-2)


def test_the_second_grain_slips_at_its_own_critical_stress() -> None:
    law = replace(IRON, c=0.0, K=0.1, tau0_grain2=1.5)
    one, two = (pulled(law, ONE_SLIP, 0.01, n=21, grain=grain) for grain in (1, 2))
    assert two.stress_along_Y[-1] / one.stress_along_Y[-1] == pytest.approx(1.5, rel=2e-3)


TIME = np.array([0.0, 1.0])


@pytest.mark.parametrize(("call", "said"), [
    (lambda: uniaxial_stress(IRON, np.eye(3), np.array([0.0, 1e-3, 2e-3]), TIME),
     r"^strain has shape \(3,\); expected \(2,\)$"),
    (lambda: uniaxial_stress(IRON, np.eye(3), np.array([1e-3, 2e-3]), TIME),
     "^strain is not 0 at the first instant; expected 0"),
    (lambda: uniaxial_stress(IRON, np.eye(3), 1e-3 * TIME, TIME[::-1]),
     "^time goes from 1 to 0 at place 1; expected increasing values$"),
    (lambda: uniaxial_stress(IRON, np.eye(3), np.array([0.0, np.nan]), TIME),
     "^strain holds 1 values that are not finite"),
    (lambda: uniaxial_stress(IRON, 2 * np.eye(3), 1e-3 * TIME, TIME), "^rotation is no rotation"),
    (lambda: uniaxial_stress(IRON, -np.eye(3), 1e-3 * TIME, TIME), "^rotation is a reflection"),
    (lambda: uniaxial_stress(IRON, np.eye(3), 1e-3 * TIME, TIME, grain=3),
     "^grain is 3; expected a whole number from 1 to 2"),
    (lambda: uniaxial_stress(IRON, np.eye(3), 1e-3 * TIME, TIME, steps_per_interval=0),
     "^steps_per_interval is 0; expected a whole number, 1 or more$"),
    (lambda: uniaxial_stress(replace(IRON, tau0=-1.0), np.eye(3), 1e-3 * TIME, TIME),
     "^tau0 is -1; expected a positive number$"),
    (lambda: uniaxial_stress(replace(IRON, n=1.0), np.eye(3), 1e-3 * TIME, TIME),
     "^n is 1; expected 1.5 or more with exponential integration"),
    (lambda: strain_path(IRON, np.eye(3), np.zeros((2, 3)), TIME),
     r"^gradient has shape \(2, 3\); expected \(2, 3, 3\)$"),
    (lambda: loaded_along((0, 0, 0)), r"^direction is \(0, 0, 0\); expected Miller indices"),
])  # fmt: skip
def test_what_no_point_can_follow_is_refused_in_one_sentence(call: Any, said: str) -> None:
    with pytest.raises(SolverError, match=said):
        call()


@pytest.mark.parametrize("n", [0, 1, 2])
def test_a_bad_course_is_a_bad_simulation(n: int) -> None:
    with pytest.raises(BadSimulationError, match="^time "):
        uniaxial_stress(IRON, np.eye(3), np.zeros(n), np.zeros(n))


def test_a_crystal_that_is_turned_inside_out_has_no_solution() -> None:
    inside_out = np.stack([np.zeros((3, 3)), np.diag([0.0, -2.0, 0.0])])
    with pytest.raises(SolverError, match="^no solution between t = 0 s and 1 s; expected a sm"):
        strain_path(Material(), np.eye(3), inside_out, TIME)
    with pytest.raises(SolverError, match="^no solution between t = 0 s and 1 s; expected a sm"):
        uniaxial_stress(Material(), np.eye(3), inside_out[:, 1, 1], TIME)
