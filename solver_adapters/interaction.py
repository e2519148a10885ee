"""Interaction matrices of isotropic hardening: how slip on one system hardens the others.

The hardening of system s is Q Σ_r h_sr (1 − exp(−b p_r)); this module makes matrices h of
BCC, each (24, 24) in the order of `crystal.BCC`.
"""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.crystal import BCC

# Pairs of {110} systems that Code_Aster 15 counts with those of one direction (lcmhsr), from 1.
_PAIRS_AS_ONE_DIRECTION = ((4, 1), (7, 2), (10, 3), (8, 6), (12, 5), (11, 9))


def self_and_latent(own: float, latent: float) -> FloatArray:
    """`own` on the diagonal, `latent` beside it (MONO_ISOT1 with H: own is 1)."""
    matrix: FloatArray = np.full((len(BCC), len(BCC)), latent)
    np.fill_diagonal(matrix, own)
    return matrix


def bcc24_classes(h1: float, h2: float, h3: float, h4: float) -> FloatArray:
    """Code_Aster's four classes for BCC24 (MONO_ISOT1 with H1…H4).

    Systems of one slip direction form blocks of three in each family. h2: within a {110} block,
    between a {110} and a {112} block of one direction, and for six pairs of {110} systems that
    Code_Aster names; h4: within a {112} block; h3: between {112} blocks; h1: all other pairs.
    """
    direction = np.repeat(np.arange(8) % 4, 3)
    family = np.repeat([0, 1], 12)
    same = direction[:, None] == direction
    both = family[:, None] + family
    matrix: FloatArray = np.full((len(BCC), len(BCC)), h1)
    matrix[same & (both < 2)] = h2
    matrix[same & (both == 2)] = h4
    matrix[~same & (both == 2)] = h3
    for row, column in _PAIRS_AS_ONE_DIRECTION:
        matrix[row - 1, column - 1] = matrix[column - 1, row - 1] = h2
    return matrix
