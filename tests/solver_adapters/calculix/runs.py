"""Small simulations that CalculiX can run, and CalculiX run on them."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshes.prism_mesh import PrismMesh
from solver_adapters.calculix.adapter import CalculixAdapter
from solver_adapters.interface import Response, Simulation
from solver_adapters.material import Material
from tools.boxes import box, pulled

needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="there is no ccx on the PATH (package calculix-ccx)"
)
OCTAHEDRAL = Material(tau0_112=1e9, strain_measure="small")


def simulation(
    strains: tuple[float, ...] = (0.001, 0.002),
    interval: float = 1.0,
    mesh: PrismMesh | None = None,
    steps: int = 1,
    **changes: Any,
) -> Simulation:
    """Two grains clamped and pulled along Y; `changes` are of the material."""
    material = replace(OCTAHEDRAL, **changes)
    made = pulled(mesh or box(), material, strains, interval, steps=steps)
    return replace(made, integration="backward_euler")


def run(asked: Simulation, jobs: Path) -> Response:
    """The response of CalculiX, run as a job in a folder of all jobs."""
    return CalculixAdapter().solve(asked, jobs)


def largest(values: object) -> float:
    return float(np.max(np.abs(np.asarray(values))))
