"""Golden decks: what each adapter writes for some cases, and the line that says why it changed.

`tests/data/decks/ADAPTER/CASE/` holds the text files of a job without their provenance header,
`tests/data/decks/ADAPTER/CHANGES` one line for each change: a hash of all of them and a sentence.

    python -m tests.templates.golden_decks code_aster "what changed, and why"
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from solver_adapters.calculix.adapter import CalculixAdapter
from solver_adapters.code_aster.adapter import CodeAsterAdapter
from solver_adapters.external import ExternalAdapter
from solver_adapters.interaction import bcc24_classes
from solver_adapters.interface import Simulation
from solver_adapters.jobs.key import what_is_computed
from solver_adapters.material import Material
from tools.boxes import box, pulled
from tools.code_aster_cases import small_case

DECKS = Path(__file__).parents[1] / "data" / "decks"
CHANGES = "CHANGES"


def _matrix() -> tuple[tuple[float, ...], ...]:
    matrix = bcc24_classes(0.5, 1.0, 0.25, 2.0)
    matrix[3, 7] = matrix[7, 3] = 0.75
    return tuple(tuple(row) for row in matrix.tolist())


def _freed(**material: object) -> Simulation:
    """X is prescribed at the first node alone."""
    case = small_case(**material)
    mask = case.motion_mask.copy()
    mask[1:, 0] = False
    return replace(case, motion_mask=mask)


CASES: Mapping[str, Simulation] = {
    "null": small_case(),
    "hardening": small_case(Q=10.0),
    "latent": small_case(Q=10.0, h_latent=1.4),
    "classes": small_case(
        Q=10.0, interaction=tuple(map(tuple, bcc24_classes(0.5, 1.0, 0.25, 2.0).tolist()))
    ),
    "matrix": small_case(Q=10.0, interaction=_matrix()),
    "families": small_case(tau0_112=1.25),
    "grains": small_case(tau0_grain2=0.875),
    "elasticity": small_case(elastic_scale=1.0625, C44_scale=0.9375),
    "finite": small_case(strain_measure="finite"),
    "free": _freed(),
    "steps": replace(
        small_case(), steps=np.array([0.5, 2.0, 3.0, 4.0, 5.5, 6.0]), output=np.array([1, 3])
    ),
    "divided": replace(small_case(), steps_per_interval=4),
    "long": replace(
        pulled(box(), Material(strain_measure="small"), tuple(0.0005 * k for k in range(1, 61))),
        integration="backward_euler",
        steps=np.linspace(0.0, 60.0, 241)[1:],
    ),
    "cells": replace(small_case(), cell_fields=True),
    "octahedral": small_case(tau0_112=1e9),
    "octahedral_grains": small_case(tau0_112=1e9, tau0_grain2=0.875),
    "octahedral_hardening": small_case(tau0_112=1e9, Q=10.0, h_latent=-0.1),
    "octahedral_elasticity": small_case(tau0_112=1e9, elastic_scale=1.0625, C44_scale=0.9375),
    "octahedral_without_back_stress": small_case(tau0_112=1e9, c=0.0),
    "octahedral_free": _freed(tau0_112=1e9),
    "octahedral_steps": replace(
        small_case(tau0_112=1e9),
        steps=np.array([0.5, 2.0, 3.0, 4.0, 5.5, 6.0]),
        output=np.array([1, 3]),
    ),
    "octahedral_divided": replace(small_case(tau0_112=1e9), steps_per_interval=4),
}
"""Simulations by name: the plain law, and every extension away from its null."""

_OCTAHEDRAL = tuple(name for name in CASES if name.startswith("octahedral"))

GOLDEN: Mapping[str, tuple[ExternalAdapter, tuple[str, ...]]] = {
    "calculix": (CalculixAdapter(), _OCTAHEDRAL),
    "code_aster": (CodeAsterAdapter(), tuple(name for name in CASES if name not in _OCTAHEDRAL)),
}
"""The adapters, with the cases that each can honour."""


def rendered(adapter: ExternalAdapter, case: str) -> dict[str, str]:
    """Text files of a job by name, without provenance headers; a mesh file is no text."""
    files = adapter.files(CASES[case])
    return {
        name: what_is_computed(content).decode("utf-8")
        for name, content in sorted(files.items())
        if b"\0" not in content
    }


def stored(name: str, case: str) -> dict[str, str]:
    """The golden files of a case."""
    folder = DECKS / name / case
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(folder.iterdir())}


def digest(name: str) -> str:
    """Hash of all golden files of an adapter."""
    state = hashlib.sha256()
    for case in sorted(path.name for path in (DECKS / name).iterdir() if path.is_dir()):
        for file, text in stored(name, case).items():
            state.update(f"{case}/{file}\n{len(text)}\n{text}".encode())
    return state.hexdigest()[:16]


def last_change(name: str) -> tuple[str, str]:
    """Hash and sentence of the last line of CHANGES."""
    line = (DECKS / name / CHANGES).read_text(encoding="utf-8").splitlines()[-1]
    found, _, sentence = line.partition(" ")
    return found, sentence


def write(name: str, sentence: str) -> None:
    """Replace the golden files of an adapter and say why."""
    adapter, cases = GOLDEN[name]
    for case in cases:
        folder = DECKS / name / case
        folder.mkdir(parents=True, exist_ok=True)
        for file, text in rendered(adapter, case).items():
            (folder / file).write_text(text, encoding="utf-8")
    with (DECKS / name / CHANGES).open("a", encoding="utf-8") as changes:
        changes.write(f"{digest(name)} {sentence}\n")


if __name__ == "__main__":
    write(sys.argv[1], sys.argv[2])
