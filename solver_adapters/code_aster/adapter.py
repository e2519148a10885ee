"""Code_Aster behind the common interface: its deck, its call, its results, its listing."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from solver_adapters.code_aster import limits, listing, result
from solver_adapters.code_aster.deck import CELLS, EXPORT, NODES, render_files
from solver_adapters.code_aster.law import is_fcc
from solver_adapters.external import ExternalAdapter, Status
from solver_adapters.interface import Capabilities, Response, Simulation
from solver_adapters.jobs.folder import end_of_output

_SCRATCH = "run_aster"
_VERSION = re.compile(r"^code_aster (\S+) \((\S+)\)", re.MULTILINE)


class CodeAsterAdapter(ExternalAdapter):
    """MONOCRISTAL of Code_Aster 15.2 or later, called through run_aster."""

    name = "code_aster"
    programs = ("run_aster",)
    results = (NODES, CELLS)
    scratch = (_SCRATCH,)
    version_call = ("--version",)

    def capabilities(self) -> Capabilities:
        """Return the law without the terms that Code_Aster lacks, both strain measures."""
        return limits.CAPABILITIES

    def check_supported(self, simulation: Simulation) -> None:
        """Refuse interactions that Code_Aster cannot say.

        Raises:
            UnsupportedError: the interaction is not symmetric, or of two families.
        """
        limits.check_supported(simulation)

    def write(self, simulation: Simulation) -> Mapping[str, bytes]:
        """Command file, export file, mesh and prescribed motion."""
        material = simulation.material
        known = limits.CAPABILITIES.cautions.items()
        cautions = [text for word, text in known if word == material.strain_measure]
        cautions += [limits.FCC_CAUTION] if is_fcc(material) else []
        return render_files(simulation, self.profile, cautions)

    def command(self, program: tuple[str, ...]) -> tuple[str, ...]:
        """Return the program with the export file, which names all others.

        Its databases, up to gigabytes, are in the folder of the job: a killed one leaves none in
        the folder of passing files of the system.
        """
        return (*program, "--wrkdir", _SCRATCH, EXPORT)

    def read(self, simulation: Simulation, folder: Path) -> Response:
        """Displacement and force of every wanted instant, with the steps that the listing tells.

        Raises:
            ResultFileError: a file is missing, truncated, empty or not what it should be.
        """
        return result.read(simulation, folder)

    def diagnose(self, log: str) -> Status:
        """How the run ended, by the verdict of run_aster and by the messages before it."""
        return listing.diagnose(log)

    def cause(self, log: str) -> str:
        """Return the first message of an error."""
        return listing.cause(log)

    def reached(self, simulation: Simulation, folder: Path) -> float | None:
        """Return end of the last time step that the output of run_aster tells to have converged."""
        # The listing of a run that goes on may break off.
        with suppress(ValueError):
            ends = listing.steps_taken(end_of_output(folder)).ends
            return ends[-1] if ends else None
        return None

    def version_in(self, answer: str) -> str | None:
        """Version and revision, as `code_aster 15.2.17 (34161d7955)`."""
        found = _VERSION.search(answer)
        return found and f"code_aster {found[1]} ({found[2]})"
