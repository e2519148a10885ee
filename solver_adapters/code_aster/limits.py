"""What Code_Aster and its law MONOCRISTAL have, and values that they refuse."""

from __future__ import annotations

import numpy as np

from solver_adapters.code_aster.law import has_two_families
from solver_adapters.constants import isotropic_hardening
from solver_adapters.crystal import N_SYSTEMS
from solver_adapters.interface import Capabilities, Simulation, UnsupportedError

FINITE_CAUTION = (
    "Code_Aster's crystal law in finite strain (SIMO_MIEHE) has no tangent of its own and is "
    "fragile: 60 steps of one element became 4852, a prism stopped at 0.3 s of 28 s. Small strain, "
    "or the bundled solver in finite strain, reaches the end."
)
CAPABILITIES = Capabilities(
    material=frozenset(
        ("C11", "C12", "C44", "K", "n", "tau0", "c", "d", "Q", "b", "h_latent", "tau0_112")
        + ("Q_latent", "tau0_grain2", "elastic_scale", "C44_scale")
    ),
    strain_measures=frozenset(("small", "finite")),
    derivatives=False,
    cell_fields=True,
    # Results are whole doubles: what scatters is the iteration, to its tolerance of 1e-7.
    noise=1e-6,
    # About 1 ms a Gauss point and iteration.
    cost=500.0,
    start=4.0,
    tet10_points=frozenset((5,)),
    cautions={"finite": FINITE_CAUTION},
)


def check_supported(simulation: Simulation) -> None:
    """Raise where systems harden each other in a way that Code_Aster cannot say.

    Raises:
        UnsupportedError: the matrix is not symmetric, or the two families interact.
    """
    material = simulation.material
    matrix = isotropic_hardening(material)[1]
    if not np.array_equal(matrix, matrix.T):
        raise UnsupportedError(
            "interaction is not symmetric, which the solver code_aster cannot honour (MATR_INTER); "
            "expected a symmetric matrix, or a solver that can: bundled"
        )
    alone = matrix[0, 0] * np.eye(N_SYSTEMS)
    if has_two_families(material) and not np.array_equal(matrix, alone):
        raise UnsupportedError(
            f"tau0_112 is {material.tau0_112:g} and systems harden each other (h_latent, "
            "Q_latent or interaction), which the solver code_aster cannot honour together: it then "
            "lets each family harden by itself alone; expected one of the two, or a solver that "
            "can: bundled"
        )
