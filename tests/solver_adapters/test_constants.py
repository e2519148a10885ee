"""The constants that every solver takes from a material, by numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.constants import (
    elastic_constants,
    grain_ratios,
    interaction_matrix,
    isotropic_hardening,
)
from solver_adapters.interaction import bcc24_classes, self_and_latent
from solver_adapters.material import Material


def test_one_factor_is_on_all_elastic_constants_and_one_on_c44() -> None:
    material = Material(C11=200.0, C12=100.0, C44=80.0, elastic_scale=1.5, C44_scale=0.5)
    assert elastic_constants(material) == (300.0, 150.0, 60.0)


@pytest.mark.parametrize(
    ("count", "expected"),
    [
        (1, [1.0]),
        (2, [1.0, 0.9]),
        (3, [1.0, 0.9, 1.2]),
        (4, [1.0, 0.9, 1.2, 1.0]),
        (5, [1.0, 0.9, 1.2, 1.0, 1.0]),
    ],
)
def test_grains_without_a_ratio_of_their_own_are_as_the_first(
    count: int, expected: list[float]
) -> None:
    material = Material(tau0_grain2=0.9, tau0_grains=(1.2,))
    np.testing.assert_array_equal(grain_ratios(material, count), expected)


def test_latent_hardening_adds_to_the_interaction_off_its_diagonal() -> None:
    material = Material(Q=10.0, h_latent=1.4)
    np.testing.assert_array_equal(interaction_matrix(material), np.eye(24))
    assert isotropic_hardening(material)[0] == 10.0
    np.testing.assert_array_equal(isotropic_hardening(material)[1], self_and_latent(1.0, 1.4))
    given = bcc24_classes(1.0, 0.75, 0.5, 1.25)
    material = Material(Q=10.0, h_latent=0.5, interaction=tuple(map(tuple, given)))
    np.testing.assert_array_equal(interaction_matrix(material), given)
    apart = ~np.eye(24, dtype=np.bool_)
    h = isotropic_hardening(material)[1]
    np.testing.assert_array_equal(h[apart], given[apart] + 0.5)
    np.testing.assert_array_equal(np.diag(h), np.diag(given))


@pytest.mark.parametrize(
    ("material", "expected"),
    [
        (Material(Q=10.0, Q_latent=4.0), self_and_latent(10.0, 4.0)),
        (Material(Q=10.0, h_latent=0.5, Q_latent=4.0), self_and_latent(10.0, 9.0)),
        (Material(Q=0.0, h_latent=0.5, Q_latent=4.0), self_and_latent(0.0, 4.0)),
        (Material(Q=0.0, h_latent=0.5), np.zeros((24, 24))),
    ],
)
def test_Q_and_its_matrix_together_hold_every_latent_hardening(
    material: Material, expected: FloatArray
) -> None:
    Q, h = isotropic_hardening(material)
    np.testing.assert_allclose(Q * h, expected, rtol=1e-15)
