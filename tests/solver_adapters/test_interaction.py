"""Interaction matrices against what Code_Aster's documentation and reference systems say."""

from __future__ import annotations

import numpy as np

from solver_adapters.crystal import BCC, slip_systems
from solver_adapters.interaction import bcc24_classes, self_and_latent


def test_the_classes_of_bcc24_are_symmetric_and_follow_direction_and_family() -> None:
    matrix = bcc24_classes(1.0, 2.0, 3.0, 4.0)
    np.testing.assert_array_equal(matrix, matrix.T)
    m, _ = slip_systems(BCC)
    same = abs(abs(m @ m.T) - 1) < 1e-12
    family = np.arange(24) >= 12
    both, none = family[:, None] & family, ~family[:, None] & ~family
    assert (matrix[both & same] == 4).all()
    assert (matrix[both & ~same] == 3).all()
    assert (matrix[~both & same] == 2).all()
    assert (matrix[~both & ~none & ~same] == 1).all()
    # Six pairs of {110} systems of different directions count as those of one direction.
    assert np.count_nonzero(matrix[none & ~same] == 2) == 12
    assert np.count_nonzero(matrix[none & ~same] == 1) == 144 - 36 - 12


def test_equal_classes_are_a_matrix_of_ones() -> None:
    np.testing.assert_array_equal(bcc24_classes(1, 1, 1, 1), np.ones((24, 24)))


def test_latent_hardening_stands_beside_the_diagonal_alone() -> None:
    """MONO_ISOT1 with H: a system hardens itself by 1, all others by H."""
    matrix = self_and_latent(1.0, 1.4)
    assert matrix.shape == (24, 24)
    assert np.diagonal(matrix).tolist() == [1.0] * 24
    assert (matrix[~np.eye(24, dtype=bool)] == 1.4).all()
    # Slip on one system alone: what it hardens is its column.
    assert (matrix @ np.eye(24)[3]).tolist() == [1.4] * 3 + [1.0] + [1.4] * 20
