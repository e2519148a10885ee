"""Small simulations for the decks and files of Code_Aster."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from solver_adapters.crystal import bunge_matrix
from solver_adapters.interface import Simulation
from solver_adapters.material import Material
from tools.boxes import ORIENTATIONS, box, pulled

DATA = Path(__file__).parents[1] / "tests" / "data" / "solver" / "code_aster"


def small_case(**material: Any) -> Simulation:
    """Two grains pulled, held and unloaded, in small strain unless said otherwise."""
    law = Material(**{"strain_measure": "small", **material})
    return replace(
        pulled(box(), law, (0.01, 0.01, 0.006), interval=2.0, tolerance=1e-7),
        integration="backward_euler",
    )


def three_grains() -> Simulation:
    """Three grains of different strength in a row; X and Z of the moved end are free."""
    mesh = box((1, 3, 1), (2.0, 6.0, 2.0))
    centre = mesh.points[mesh.cells].mean(axis=1)[:, 1]
    law = Material(strain_measure="small", tau0_grain2=1.2, tau0_grains=(0.9,))
    asked = pulled(
        replace(mesh, grain=(centre // 2.0).astype(np.int64)), law, (0.004, 0.004), interval=2.0
    )
    mask = asked.motion_mask.copy()
    mask[np.isin(asked.motion_nodes, mesh.nodes["S_PLUS"]), ::2] = False
    orientations = np.concatenate([ORIENTATIONS, bunge_matrix(30, 60, 20)[None]])
    return replace(asked, motion_mask=mask, orientations=orientations, integration="backward_euler")


def unpacked(name: str, folder: Path, to: str) -> Path:
    """Return a stored file of the data folder, unpacked."""
    path = folder / to
    path.write_bytes(gzip.decompress((DATA / f"{name}.gz").read_bytes()))
    return path
