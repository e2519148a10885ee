"""Cubic elasticity in plain NumPy, as a full tensor of fourth order."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.material import Material


def stiffness(material: Material, rotation: FloatArray) -> FloatArray:
    """Elastic stiffness [MPa] in the specimen frame, (3, 3, 3, 3)."""
    eye, cube = np.eye(3), np.einsum("ia,ja,ka,la->ijkl", *[rotation] * 4)
    volume = np.einsum("ij,kl->ijkl", eye, eye)
    shear = np.einsum("ik,jl->ijkl", eye, eye) + np.einsum("il,jk->ijkl", eye, eye)
    c11, c12, c44 = material.C11, material.C12, material.C44
    return np.asarray(c12 * volume + c44 * shear + (c11 - c12 - 2 * c44) * cube)
