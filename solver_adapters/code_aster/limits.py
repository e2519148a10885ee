"""What Code_Aster and its law MONOCRISTAL have, and values that they refuse."""

from __future__ import annotations

import numpy as np

from solver_adapters.code_aster.law import has_two_families, is_fcc
from solver_adapters.constants import isotropic_hardening
from solver_adapters.crystal import BCC, FCC
from solver_adapters.interface import Capabilities, Simulation, UnsupportedError

FINITE_CAUTION = (
    "Code_Aster's crystal law in finite strain (SIMO_MIEHE) has no tangent of its own and is "
    "fragile: 60 steps of one element became 4852, a prism stopped at 0.3 s of 28 s. Small strain, "
    "or the bundled solver in finite strain, reaches the end."
)
FCC_CAUTION = (
    "No run of Code_Aster has judged this deck with the octahedral systems of FCC: hold its first "
    "results against the bundled solver or CalculiX."
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
    conditional=frozenset(("slip_systems",)),
    cautions={"finite": FINITE_CAUTION},
)


def check_supported(simulation: Simulation) -> None:
    """Raise where systems are none, or harden each other in a way, that Code_Aster can say.

    Raises:
        UnsupportedError: the systems are neither of BCC nor of FCC, the matrix is not symmetric, or
            the two families interact.
    """
    material = simulation.material
    if material.slip_systems not in (BCC, FCC):
        raise UnsupportedError(
            "slip_systems other than those of BCC or FCC, which the solver code_aster cannot "
            "honour; expected those of BCC or FCC, or a solver that can: bundled"
        )
    if is_fcc(material) and material.strain_measure == "finite" and simulation.cell_fields:
        raise UnsupportedError(
            "fields of the cells of FCC in finite strain, whose place in the results of the solver "
            "code_aster is not known; expected small strain, no fields of the cells, or a solver "
            "that can: bundled"
        )
    matrix = isotropic_hardening(material)[1]
    if not np.array_equal(matrix, matrix.T):
        raise UnsupportedError(
            "interaction is not symmetric, which the solver code_aster cannot honour (MATR_INTER); "
            "expected a symmetric matrix, or a solver that can: bundled"
        )
    alone = matrix[0, 0] * np.eye(len(matrix))
    if has_two_families(material) and not np.array_equal(matrix, alone):
        raise UnsupportedError(
            f"tau0_112 is {material.tau0_112:g} and systems harden each other (h_latent, "
            "Q_latent or interaction), which the solver code_aster cannot honour together: it then "
            "lets each family harden by itself alone; expected one of the two, or a solver that "
            "can: bundled"
        )
