"""Code_Aster behind the common interface: its deck, its call, its results, its listing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from solver_adapters.code_aster import listing, result
from solver_adapters.code_aster.deck import CELLS, EXPORT, NODES, render_files
from solver_adapters.code_aster.law import HONOURED
from solver_adapters.external import ExternalAdapter, Status
from solver_adapters.interface import Capabilities, Response, Simulation
from solver_adapters.refusal import refuse_unsupported
from solver_adapters.registry import installed_capabilities

FINITE_CAUTION = (
    "Code_Aster's crystal law in finite strain (SIMO_MIEHE) has no tangent of its own and is "
    "fragile: 60 steps of one element became 4852, a prism stopped at 0.3 s of 28 s. Small strain, "
    "or the bundled solver in finite strain, reaches the end."
)


class CodeAsterAdapter(ExternalAdapter):
    """MONOCRISTAL of Code_Aster 15 or later, called through run_aster or as_run."""

    name = "code_aster"
    programs = ("run_aster", "as_run")
    results = (NODES, CELLS)

    def capabilities(self) -> Capabilities:
        """The law without the terms that Code_Aster lacks, both strain measures."""
        return Capabilities(
            material=HONOURED,
            strain_measures=frozenset(("small", "finite")),
            derivatives=False,
            cell_fields=True,
            cost=150.0,
            cautions={"finite": FINITE_CAUTION},
        )

    def write(self, simulation: Simulation) -> Mapping[str, bytes]:
        """Command file, export file, mesh and prescribed motion.

        Raises:
            UnsupportedError: the simulation asks for what Code_Aster lacks.
        """
        offered = self.capabilities()
        refuse_unsupported(simulation, self.name, offered, installed_capabilities)
        measure = simulation.material.strain_measure
        cautions = (text for word, text in offered.cautions.items() if word == measure)
        return render_files(simulation, self.profile, cautions)

    def command(self, program: tuple[str, ...]) -> tuple[str, ...]:
        """The program with the export file, which names all others."""
        return (*program, EXPORT)

    def read(self, simulation: Simulation, folder: Path) -> Response:
        """Displacement and force of every wanted instant, with the steps that the listing tells.

        Raises:
            ResultFileError: a file is missing, truncated, empty or not what it should be.
        """
        return result.read(simulation, folder)

    def diagnose(self, log: str) -> Status:
        """How the run ended, by the verdict of run_aster and by the messages before it."""
        return listing.diagnose(log)
