"""What every solver needs of a `Material`: constants with their factors and ratios applied."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.crystal import system_count
from solver_adapters.material import Material


def elastic_constants(material: Material) -> tuple[float, float, float]:
    """C11, C12 and C44 with the factors on them [MPa]."""
    m = material
    return (
        m.C11 * m.elastic_scale,
        m.C12 * m.elastic_scale,
        m.C44 * m.elastic_scale * m.C44_scale,
    )


def grain_ratios(material: Material, n_grains: int) -> FloatArray:
    """Ratio of tau0 in each grain to that in the first, shape (n_grains,)."""
    given = (1.0, material.tau0_grain2, *material.tau0_grains)[:n_grains]
    return np.array((*given, *[1.0] * (n_grains - len(given))))


def interaction_matrix(material: Material) -> FloatArray:
    """Return the interaction matrix without h_latent, shape (n, n), n of `system_count`."""
    matrix = np.eye(system_count(material.slip_systems))
    if material.interaction is not None:
        n = len(material.interaction)
        matrix[:n, :n] = material.interaction
    return matrix


def isotropic_hardening(material: Material) -> tuple[float, FloatArray]:
    """Q [MPa] and h, shape (n, n) as of `interaction_matrix`, with Q_latent and h_latent in them.

    The law hardens by Q Σ_r h_sr (1 − exp(−b p_r)). Without Q of its own Q_latent is Q, and h has
    nothing on its diagonal; without any hardening h is the identity.
    """
    m, identity = material, np.eye(system_count(material.slip_systems))
    apart = 1.0 - identity
    if m.Q != 0.0:
        return m.Q, interaction_matrix(m) + (m.h_latent + m.Q_latent / m.Q) * apart
    return (m.Q_latent, apart) if m.Q_latent != 0.0 else (0.0, identity)
