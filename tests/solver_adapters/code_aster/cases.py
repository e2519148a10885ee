"""Small simulations for the decks and files of Code_Aster."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path
from typing import Any

from solver_adapters.interface import Simulation
from solver_adapters.material import Material
from tests.solver_adapters.boxes import box, pulled

DATA = Path(__file__).parents[2] / "data" / "solver" / "code_aster"


def small_case(**material: Any) -> Simulation:
    """Two grains pulled, held and unloaded, in small strain unless said otherwise."""
    law = Material(**{"strain_measure": "small", **material})
    return replace(
        pulled(box(), law, (0.01, 0.01, 0.006), interval=2.0, tolerance=1e-7),
        integration="backward_euler",
    )


def unpacked(name: str, folder: Path, to: str) -> Path:
    """A stored file of the data folder, unpacked."""
    path = folder / to
    path.write_bytes(gzip.decompress((DATA / f"{name}.gz").read_bytes()))
    return path
