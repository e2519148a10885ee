"""The law in Code_Aster's words; facts of its sources are named in the module."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.code_aster.law import (
    hardening,
    has_two_families,
    system_order,
)
from solver_adapters.crystal import FCC
from solver_adapters.interaction import bcc24_classes, self_and_latent
from solver_adapters.material import Material

HARD = Material(Q=10.0)


def rows(matrix: FloatArray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())


def test_self_hardening_is_H_of_zero() -> None:
    said = hardening(HARD)
    assert (said.classes, said.matrix) == ({"H": 0.0}, None)


def test_even_latent_hardening_is_H() -> None:
    for material in (
        replace(HARD, h_latent=1.4),
        replace(HARD, interaction=rows(self_and_latent(1.0, 1.0)), h_latent=0.4),
    ):
        said = hardening(material)
        assert (said.classes, said.matrix) == ({"H": 1.4}, None)


def test_latent_hardening_of_its_own_is_H_over_Q() -> None:
    said = hardening(replace(HARD, Q_latent=4.0))
    assert (said.Q, said.classes, said.matrix) == (10.0, {"H": 0.4}, None)


def test_latent_hardening_without_Q_is_a_table_without_a_diagonal() -> None:
    said = hardening(Material(Q_latent=4.0, h_latent=0.3))
    assert said.Q == 4.0 and said.matrix is not None
    np.testing.assert_array_equal(said.matrix, self_and_latent(0.0, 1.0))


def test_the_four_classes_are_recognised() -> None:
    said = hardening(replace(HARD, interaction=rows(bcc24_classes(0.5, 1.0, 0.25, 2.0))))
    assert said.classes == {"H1": 0.5, "H2": 1.0, "H3": 0.25, "H4": 2.0}
    assert said.matrix is None


def test_any_other_symmetric_matrix_is_a_table() -> None:
    matrix = self_and_latent(1.0, 0.2)
    matrix[3, 7] = matrix[7, 3] = 0.9
    said = hardening(replace(HARD, interaction=rows(matrix), h_latent=0.5))
    assert said.matrix is not None
    np.testing.assert_array_equal(said.matrix, matrix + self_and_latent(0.0, 0.5))


def test_a_matrix_that_does_not_act_is_not_said() -> None:
    matrix = self_and_latent(1.0, 0.2)
    matrix[3, 7] = 0.9
    assert hardening(Material(interaction=rows(matrix))).matrix is None


def test_families_with_a_tau0_of_their_own_get_the_obligatory_table() -> None:
    said = hardening(replace(HARD, tau0_112=1.1))
    np.testing.assert_array_equal(said.matrix, np.eye(24))
    assert not has_two_families(HARD)


def test_one_family_keeps_the_order_of_bcc24() -> None:
    places, senses = system_order(Material())
    np.testing.assert_array_equal(places, np.arange(24))
    np.testing.assert_array_equal(senses, 1.0)


def test_each_system_of_110_has_one_place_in_cubique1() -> None:
    places, senses = system_order(Material(tau0_112=1.1))
    np.testing.assert_array_equal(np.sort(places), np.arange(24))
    np.testing.assert_array_equal(places[12:], np.arange(12, 24))
    # The first of BCC24, (011)[11-1], is the last of CUBIQUE1; the second, (101)[11-1], is the
    # one before it as (-10-1)[11-1].
    assert (places[0], senses[0], places[1], senses[1]) == (11, 1.0, 10, -1.0)


def test_octahedral_systems_are_those_of_lcmmsg() -> None:
    """Its normals, and its slip directions, which it lists in three numbers each."""
    normals = ["111", "111", "111", "1-11", "1-11", "1-11", "-111", "-111", "-111",
               "-1-11", "-1-11", "-1-11"]  # fmt: skip
    directions = ["-101", "0-11", "-110", "-101", "011", "110", "0-11", "110", "101",
                  "-110", "101", "011"]  # fmt: skip
    table = tuple(zip(map(indices, normals), map(indices, directions), strict=True))
    assert table == FCC
    places, senses = system_order(Material(slip_systems=FCC))
    np.testing.assert_array_equal(places, np.arange(12))
    np.testing.assert_array_equal(senses, 1.0)


def indices(text: str) -> tuple[int, ...]:
    """Return the numbers of a plane or direction, such as 1-11."""
    return tuple(int(sign + digit) for sign, digit in re.findall(r"(-?)(\d)", text))


def test_hardening_of_fcc_is_H_or_a_table_of_twelve() -> None:
    copper = replace(HARD, slip_systems=FCC)
    said = hardening(replace(copper, h_latent=1.4))
    assert (said.classes, said.matrix) == ({"H": 1.4}, None)
    matrix = self_and_latent(1.0, 0.2)[:12, :12]
    matrix[3, 7] = matrix[7, 3] = 0.9
    said = hardening(replace(copper, interaction=rows(matrix)))
    assert said.matrix is not None
    np.testing.assert_array_equal(said.matrix, matrix)
