"""The crystal law in the words of Code_Aster: families of systems, and their hardening.

Read in its public sources (`lcmmsg`, `lcmmfi`, `lcmaei`, `rccoma` of 2017, `op5901` of 2012; in
2025 `lcmmfi` is the same):

- BCC24 is one family with one τ0. Where {112} has a τ0 of its own, {110} is the family CUBIQUE1 and
  {112} is CUBIQUE2. CUBIQUE1 counts the {110} systems in another order than BCC24, and some with
  the opposite sense of slip.
- With two families each hardens by its own systems alone, and both read the first 12 rows and
  columns of MATR_INTER. Only a matrix without latent hardening means the same there.
- OCTAEDRIQUE is the family of FCC, its twelve systems in the order and with the signs of
  `crystal.FCC`.
- MATR_INTER has to be symmetric, is as large as its family has systems, and is obligatory with two
  families.
- The materials of a grain may hold one elasticity between them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from meshes.arrays import FloatArray, IntArray
from solver_adapters.constants import isotropic_hardening
from solver_adapters.crystal import BCC, FCC, N_110, slip_systems
from solver_adapters.interaction import bcc24_classes, self_and_latent
from solver_adapters.material import Material

# Plane normal and slip direction of the systems of CUBIQUE1 (lcmmsg).
_CUBIQUE1 = (
    ((1, 1, 0), (1, -1, 1)),
    ((-1, 0, 1), (1, -1, 1)),
    ((0, -1, -1), (1, -1, 1)),
    ((0, -1, 1), (1, 1, 1)),
    ((1, 0, -1), (1, 1, 1)),
    ((-1, 1, 0), (1, 1, 1)),
    ((-1, -1, 0), (-1, 1, 1)),
    ((1, 0, 1), (-1, 1, 1)),
    ((0, 1, -1), (-1, 1, 1)),
    ((1, -1, 0), (1, 1, -1)),
    ((-1, 0, -1), (1, 1, -1)),
    ((0, 1, 1), (1, 1, -1)),
)


@dataclass(frozen=True, eq=False)
class Hardening:
    """How the interaction of systems is said.

    Attributes:
        Q: saturated isotropic hardening [MPa].
        classes: H, or H1 to H4, of MONO_ISOT1.
        matrix: MATR_INTER, shape (24, 24), of FCC (12, 12), or None where the classes say it all.
    """

    Q: float
    classes: Mapping[str, float]
    matrix: FloatArray | None


def has_two_families(material: Material) -> bool:
    """Whether {112} has a τ0 of its own."""
    return material.tau0_112 != 1.0


def is_fcc(material: Material) -> bool:
    """Whether the systems are those of FCC, and not of BCC."""
    return material.slip_systems == FCC


def system_order(material: Material) -> tuple[IntArray, FloatArray]:
    """Where Code_Aster keeps each system of `crystal.BCC` or `crystal.FCC`, and its sense there.

    Returns:
        place of each system among Code_Aster's n, 24 or 12, shape (n,), and +1 or −1, shape (n,).
    """
    n_systems = len(material.slip_systems)
    places, senses = np.arange(n_systems), np.ones(n_systems)
    if has_two_families(material):
        table = np.array(_CUBIQUE1, dtype=np.float64)
        table /= np.linalg.norm(table, axis=2, keepdims=True)
        directions, normals = slip_systems(BCC)
        products = (normals[:N_110] @ table[:, 0].T) * (directions[:N_110] @ table[:, 1].T)
        places[:N_110] = abs(products).argmax(axis=1)
        senses[:N_110] = np.sign(products[np.arange(N_110), places[:N_110]])
    return places, senses


def hardening(material: Material) -> Hardening:
    """Return interaction of systems as Code_Aster takes it, of a material that `limits` accepts."""
    Q, matrix = isotropic_hardening(material)
    if has_two_families(material):
        # MATR_INTER is obligatory with two families.
        return Hardening(Q, {"H": 0.0}, matrix)
    latent = float(matrix[0, 1])
    if is_fcc(material):
        block = matrix[: len(FCC), : len(FCC)]
        if np.array_equal(block, self_and_latent(1.0, latent)[: len(FCC), : len(FCC)]):
            return Hardening(Q, {"H": latent}, None)
        return Hardening(Q, {"H": 0.0}, block)
    if np.array_equal(matrix, self_and_latent(1.0, latent)):
        return Hardening(Q, {"H": latent}, None)
    classes = [float(matrix[pair]) for pair in ((0, 4), (0, 0), (12, 15), (12, 12))]
    if np.array_equal(matrix, bcc24_classes(*classes)):
        return Hardening(Q, {f"H{i}": value for i, value in enumerate(classes, start=1)}, None)
    return Hardening(Q, {"H": 0.0}, matrix)
