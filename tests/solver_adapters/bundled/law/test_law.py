from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from solver_adapters.bundled.fem.fields import acts_at_rest
from solver_adapters.bundled.law.law import (
    P_ASYMMETRY,
    P_K,
    P_N,
    P_TAU110,
    P_TAU112,
    P_TAU123,
    SLIP_MODES,
    local_parameters,
    local_tangent,
    longer_step_tangent,
    system_modes,
)
from solver_adapters.crystal import BCC, BCC48, schmid_tensors, slip_systems
from solver_adapters.material import MATERIAL_PARAMETERS, Material

MODES = system_modes(BCC)
MATERIAL = Material(
    Q=12.0,
    tau0_112=1.1,
    tau0_123=0.8,
    tau0_grain2=0.9,
    tau0_grains=(1.3,),
    tau0_antitwinning=1.2,
    a1=0.1,
    h_latent=0.5,
    Q_latent=3.0,
    c2=900.0,
    elastic_scale=1.02,
    C44_scale=0.95,
)
LOCAL = [name for name in MATERIAL_PARAMETERS if not acts_at_rest(name)]


def test_the_modes_carry_every_schmid_tensor() -> None:
    np.testing.assert_allclose(
        np.einsum("ijk,ljk->il", SLIP_MODES, SLIP_MODES), np.eye(8), atol=1e-15
    )
    rebuilt = np.einsum("ks,kij->sij", MODES.schmid, SLIP_MODES)
    np.testing.assert_allclose(rebuilt, schmid_tensors(BCC), atol=1e-15)


def test_the_ratios_of_tau0_act_on_their_family_and_on_their_grain() -> None:
    table = local_parameters(replace(MATERIAL, tau0_antitwinning=1.0), 4)
    np.testing.assert_allclose(table[:, P_TAU110], [40.0, 36.0, 52.0, 40.0])
    np.testing.assert_allclose(table[:, P_TAU112], [44.0, 39.6, 57.2, 44.0])
    np.testing.assert_allclose(table[:, P_TAU123], [32.0, 28.8, 41.6, 32.0])


def test_the_ratio_of_the_senses_leaves_the_twinning_sense_as_it_is() -> None:
    table = local_parameters(MATERIAL, 1)[0]
    np.testing.assert_allclose(table[P_TAU112] - table[P_ASYMMETRY], 44.0)
    np.testing.assert_allclose(table[P_TAU112] + table[P_ASYMMETRY], 44.0 * 1.2)


def test_the_twinning_system_of_the_textbooks_shears_in_the_twinning_sense() -> None:
    """(112)[-1 -1 1], K1 and η1 of Christian & Mahajan, Prog. Mater. Sci. 39 (1995) 1."""
    m, n = slip_systems(BCC)
    plane, shear = np.array([1, 1, 2]) / np.sqrt(6), np.array([-1, -1, 1]) / np.sqrt(3)
    s = int(np.argmax(abs(n @ plane) + abs(m @ shear)))
    sense = np.sign((n[s] @ plane) * (m[s] @ shear))
    assert MODES.sense[s] == sense
    assert not MODES.sense[:12].any() and MODES.sense[12:].all()
    np.testing.assert_array_equal(system_modes(BCC48).sense, np.append(MODES.sense, np.zeros(24)))


def test_the_conjugate_planes_are_those_of_the_literature() -> None:
    """(01-1)[111] has (-110), Gröger, Bailey & Vitek, Acta Mater. 56 (2008) 5401, table 1."""
    m, n = slip_systems(BCC)
    direction, normal = np.array([1, 1, 1]) / np.sqrt(3), np.array([0, 1, -1]) / np.sqrt(2)
    s = int(np.argmax(abs(n @ normal) + abs(m @ direction)))
    assert n[s] @ normal > 0.99 and m[s] @ direction > 0.99
    conjugate = np.array([-1, 1, 0]) / np.sqrt(2)
    tensor = np.outer(direction, conjugate - 0.5 * normal)
    modes = np.einsum("kij,ij->k", SLIP_MODES, tensor)
    np.testing.assert_allclose(MODES.conjugate[:, s], modes, atol=1e-15)


@pytest.mark.parametrize("name", LOCAL)
def test_the_tangent_of_the_local_constants_is_their_difference_quotient(name: str) -> None:
    value = getattr(MATERIAL, name)
    step = 1e-3 * value
    high, low = (
        local_parameters(replace(MATERIAL, **{name: value + sign * step}), 3) for sign in (1, -1)
    )
    expected = (high - low) / (2 * step)
    assert abs(expected).max() > 0
    np.testing.assert_allclose(local_tangent(MATERIAL, 3, name), expected, rtol=1e-9, atol=1e-9)


def test_a_longer_step_keeps_its_product_with_the_power_of_K() -> None:
    """Δt K⁻ⁿ of a step that is longer by 1e-6 is that of K changed by the tangent."""
    table = local_parameters(MATERIAL, 3)
    tangent = longer_step_tangent(table)
    K, n = table[:, P_K], table[:, P_N]
    step = 1e-6
    longer = np.log1p(step) - n * np.log(K)
    softer = -n * np.log(K + step * tangent[:, P_K])
    np.testing.assert_allclose(longer, softer, rtol=0, atol=n.max() * step**2)
    tangent[:, P_K] = 0.0
    assert not tangent.any()
