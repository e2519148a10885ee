"""Jobs of the adapter that a real Code_Aster 15.2 ran (tests/data/solver/ORIGIN.md)."""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from solver_adapters.code_aster.deck import CELLS, FORCES, LISTING, NODES
from solver_adapters.interaction import bcc24_classes, self_and_latent
from solver_adapters.interface import Simulation
from tools.code_aster_cases import DATA, small_case

RUNS = DATA / "adapter_runs"
_CLASSES = tuple(map(tuple, bcc24_classes(1.1, 0.9, 1.6, 1.3).tolist()))
INTERACTIONS: Mapping[str, Any] = MappingProxyType(
    {
        "H1_H4": _CLASSES,
        "H1_H4_Q_latent": _CLASSES,
        "even_H": tuple(map(tuple, self_and_latent(1.0, 1.0).tolist())),
    }
)
"""Interaction matrices of the runs that have one."""
NAMES = tuple(sorted(path.name for path in RUNS.iterdir() if path.is_dir()))


def simulation(name: str) -> Simulation:
    """Return what a job simulated."""
    material = json.loads((RUNS / name / "parameters.json").read_text(encoding="utf-8"))
    if name in INTERACTIONS:
        material["interaction"] = INTERACTIONS[name]
    return replace(small_case(**material), cell_fields=True, tolerance=1e-8)


def at_the_end(asked: Simulation) -> Simulation:
    """Return the simulation with its last instant alone as output, at which cells are stored."""
    return replace(asked, output=np.array([len(asked.times) - 1]))


def results(name: str, folder: Path) -> Path:
    """Return the result files of a job as the program left them, in a folder."""
    for file in (NODES, CELLS, LISTING):
        (folder / file).write_bytes(gzip.decompress((RUNS / name / f"{file}.gz").read_bytes()))
    (folder / FORCES).write_bytes((RUNS / name / FORCES).read_bytes())
    return folder
