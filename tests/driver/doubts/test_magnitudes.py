"""Sizes of a test against values by hand and of textbooks."""

from __future__ import annotations

import numpy as np
import pytest

from driver.doubts.magnitudes import largest_schmid_factor, magnitudes, youngs_modulus
from driver.experiment.history import History
from meshes.arrays import FloatArray
from solver_adapters.crystal import BCC

IRON = 231.4, 134.7, 116.4  # GPa, Rayne and Chandrasekhar (1961)


def turned(along_y: tuple[int, int, int]) -> FloatArray:
    """A rotation whose loading axis is a direction of the crystal."""
    axis = np.array(along_y) / np.linalg.norm(along_y)
    other = np.cross(axis, [0.3, -0.5, 0.81])
    other /= np.linalg.norm(other)
    return np.array([other, axis, np.cross(other, axis)])


@pytest.mark.parametrize(
    ("along_y", "factor"),
    [
        # By hand: the larger of {110}⟨111⟩ and {112}⟨111⟩.
        ((0, 0, 1), np.sqrt(2.0) / 3.0),  # (112)[-1-11]: 2/√6 · 1/√3
        ((1, 1, 1), 2.0 * np.sqrt(2.0) / 9.0),  # (-211)... on [-111]: 4/√18 · 1/3
        ((0, 1, 1), np.sqrt(2.0) / 3.0),  # (-211)[111]: 2/√12 · 2/√6
    ],
)
def test_the_largest_schmid_factor_is_that_of_the_stereographic_triangle(
    along_y: tuple[int, int, int], factor: float
) -> None:
    assert largest_schmid_factor(turned(along_y), BCC) == pytest.approx(factor)


@pytest.mark.parametrize(
    ("direction", "modulus"), [((1, 0, 0), 132.0), ((1, 1, 0), 221.0), ((1, 1, 1), 283.0)]
)
def test_youngs_moduli_of_iron_are_those_of_textbooks(
    direction: tuple[int, int, int], modulus: float
) -> None:
    # Hosford, The Mechanics of Crystals and Textured Polycrystals: 132, 220 and 283 GPa or so.
    axis = np.array(direction) / np.linalg.norm(direction)
    assert youngs_modulus(axis, *IRON) == pytest.approx(modulus, rel=0.01)


def test_an_isotropic_crystal_has_one_modulus() -> None:
    for direction in ((1, 0, 0), (1, 1, 1), (3, -2, 1)):
        axis = np.array(direction) / np.linalg.norm(direction)
        # λ = 100, µ = 80: E = µ (3λ + 2µ)/(λ + µ)
        assert youngs_modulus(axis, 260.0, 100.0, 80.0) == pytest.approx(80.0 * 460.0 / 180.0)


def test_sizes_of_a_small_test_are_those_by_hand() -> None:
    # 10 µm in 10 s, a hold of 10 s, 4 µm back in 8 s; images at the stops.
    history = History(
        time=np.array([0.0, 10.0, 20.0, 28.0]),
        stage=np.array([0.0, 10.0, 10.0, 6.0]),
        image_row=np.array([0, 2, 3]),
        force=np.zeros(3),
        turning=np.array([0, 2, 3]),
        cycle=np.ones(3, dtype=np.int64),
    )
    of = magnitudes(
        history, np.array([0.0, 600.0, np.nan]), 6.0, 1e-3,
        np.array([turned((0, 0, 1)), turned((1, 1, 1))]), BCC, np.array([40.0, 20.0]),
        (260e3, 100e3, 80e3),
    )  # fmt: skip
    assert of.travel == 10.0 and of.strain == pytest.approx(0.01)
    assert of.rate == pytest.approx(1e-3 * 14.0 / 18.0)
    assert of.interval == 14.0
    assert of.stress == 100.0
    assert of.schmid == pytest.approx((0.4714, 0.3143), abs=1e-4)
    assert of.shear_ratio == pytest.approx(100.0 * 0.3143 / 20.0, rel=1e-3)
    assert of.elastic == pytest.approx(100.0 / (80e3 * 460.0 / 180.0))
