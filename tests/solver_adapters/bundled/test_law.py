from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from solver_adapters.bundled.law import (
    P_TAU110,
    P_TAU112,
    SCHMID_MODES,
    SLIP_MODES,
    local_parameters,
    local_tangent,
)
from solver_adapters.crystal import schmid_tensors
from solver_adapters.material import MATERIAL_PARAMETERS, Material

MATERIAL = Material(Q=12.0, tau0_112=1.1, tau0_grain2=0.9, elastic_scale=1.02, C44_scale=0.95)


def test_the_modes_carry_every_schmid_tensor() -> None:
    np.testing.assert_allclose(
        np.einsum("ijk,ljk->il", SLIP_MODES, SLIP_MODES), np.eye(8), atol=1e-15
    )
    rebuilt = np.einsum("ks,kij->sij", SCHMID_MODES, SLIP_MODES)
    np.testing.assert_allclose(rebuilt, schmid_tensors(), atol=1e-15)


def test_the_ratios_of_tau0_act_on_their_family_and_on_the_second_grain() -> None:
    table = local_parameters(MATERIAL, 2)
    np.testing.assert_allclose(table[:, P_TAU110], [40.0, 36.0])
    np.testing.assert_allclose(table[:, P_TAU112], [44.0, 39.6])


@pytest.mark.parametrize("name", MATERIAL_PARAMETERS)
def test_the_tangent_of_the_local_constants_is_their_difference_quotient(name: str) -> None:
    value = getattr(MATERIAL, name)
    step = 1e-3 * value
    high, low = (
        local_parameters(replace(MATERIAL, **{name: value + sign * step}), 2) for sign in (1, -1)
    )
    expected = (high - low) / (2 * step)
    assert abs(expected).max() > 0
    np.testing.assert_allclose(local_tangent(MATERIAL, 2, name), expected, rtol=1e-9, atol=1e-9)
