"""The deck of CalculiX as rows of text; the keywords stand in `templates/calculix`.

One *STEP for each time interval: CalculiX keeps what the last plastic iteration wrote into a point
that turns out elastic, and starts a *STEP without such an iteration (docs/calculix.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib.metadata import version
from typing import SupportsInt

import numpy as np

from meshes.arrays import FloatArray, IntArray
from solver_adapters.calculix.limits import hardens
from solver_adapters.constants import elastic_constants, grain_ratios
from solver_adapters.interface import Simulation
from solver_adapters.time_steps import between_instants, step_ends
from templates import render

JOB = "job"
"""Stem of the input and result files."""
FORCE_SET, OUTPUT_SET = "S_PLUS", "OUTPUT"
CELLS = {10: "C3D10", 20: "C3D20R"}
"""CalculiX's names of the cells with as many Gauss points; nodes come in the order of VTK."""

# CalculiX divides by Q, b and c: a term at its null gets the smallest number that does no harm.
_NULL = 1e-6
_NO_RATE = 1.0
# Of the length of a step: below it CalculiX gives up cutting.
_SMALLEST = 1e-5
# Most numbers in a line.
_ENTRIES = 16


def render_files(simulation: Simulation) -> Mapping[str, bytes]:
    """Return the three files of a job; `job.inp` includes the others."""
    grains = _grains(simulation)
    texts = {
        f"{JOB}.inp": render(
            "calculix/job.inp.j2",
            version=version("prismid"),
            grains=grains,
            crystals=_crystals(simulation),
        ),
        "mesh.inp": render(
            "calculix/mesh.inp.j2",
            nodes=list(_table(simulation.mesh.points)),
            cell=CELLS[simulation.mesh.cells.shape[1]],
            grains=grains,
            sets=_sets(simulation),
        ),
        "steps.inp": render(
            "calculix/steps.inp.j2",
            held=_prescribed(simulation),
            steps=list(_steps(simulation)),
            displacements=bool(simulation.output_nodes.size),
            tolerance=number(simulation.tolerance),
        ),
    }
    return {name: text.encode("ascii") for name, text in texts.items()}


def number(value: float) -> str:
    """Write a number in the 20 columns that CalculiX reads; it cuts off what is longer."""
    return f"{value:.13g}"


def output_steps(simulation: Simulation) -> IntArray:
    """Numbers of the *STEPs with output, from 1, in the order of time, without the start."""
    wanted = np.unique(simulation.times[simulation.output])
    steps = np.searchsorted(step_ends(simulation), wanted)
    return np.asarray(steps[steps > 0])


def _table(rows: FloatArray) -> Iterator[str]:
    for node, row in enumerate(rows, start=1):
        yield ",".join([str(node), *map(number, row)])


def _grains(simulation: Simulation) -> list[dict[str, object]]:
    mesh = simulation.mesh
    distinct = np.unique(_tau0(simulation), return_inverse=True)[1]
    grains: list[dict[str, object]] = []
    for grain, rotation in enumerate(simulation.orientations):
        cells = np.flatnonzero(mesh.grain == grain)
        grains.append(
            {
                "number": grain + 1,
                "crystal": int(distinct[grain]) + 1,
                # The columns are the crystal axes in the specimen frame.
                "axes": ",".join(map(number, rotation[:, :2].T.ravel())),
                "cells": [_element(cell + 1, *(mesh.cells[cell] + 1)) for cell in cells],
            }
        )
    return grains


def _element(*integers: SupportsInt) -> str:
    """Write a cell and its nodes in lines that CalculiX reads; a comma at the end carries on."""
    lines = [integers[k : k + _ENTRIES] for k in range(0, len(integers), _ENTRIES)]
    return ",\n".join(_row(*line) for line in lines)


def _row(*integers: SupportsInt) -> str:
    return ",".join(str(int(value)) for value in integers)


def _tau0(simulation: Simulation) -> FloatArray:
    """Return the critical resolved shear stress of each grain [MPa], shape (n_grains,)."""
    m = simulation.material
    return m.tau0 * grain_ratios(m, simulation.mesh.n_grains)


def _crystals(simulation: Simulation) -> list[dict[str, object]]:
    """Return the constants of each different crystal."""
    m = simulation.material
    C11, C12, C44 = elastic_constants(m)
    isotropic = (m.Q, m.b) if hardens(m) else (_NULL, _NO_RATE)
    return [
        {
            "number": index,
            "C11": number(C11),
            "C12": number(C12),
            "C44": number(C44),
            "K": number(m.K),
            "n": number(m.n),
            "c": number(m.c or _NULL),
            "d": number(m.d),
            "tau0": number(tau0),
            "Q": number(isotropic[0]),
            "b": number(isotropic[1]),
        }
        for index, tau0 in enumerate(np.unique(_tau0(simulation)), start=1)
    ]


def _sets(simulation: Simulation) -> list[tuple[str, list[int]]]:
    groups = {FORCE_SET: simulation.mesh.nodes["S_PLUS"], OUTPUT_SET: simulation.output_nodes}
    return [(name, (nodes + 1).tolist()) for name, nodes in groups.items() if nodes.size]


def _prescribed(simulation: Simulation) -> list[str]:
    """Node and component, twice as CalculiX wants it, of every prescribed displacement."""
    rows, components = np.nonzero(simulation.motion_mask)
    nodes = simulation.motion_nodes[rows] + 1
    return [_row(n, k, k) for n, k in zip(nodes, components + 1, strict=True)]


def _steps(simulation: Simulation) -> Iterator[dict[str, object]]:
    prescribed = _prescribed(simulation)
    motion = simulation.motion[:, simulation.motion_mask]
    ends = step_ends(simulation)
    outputs = set(output_steps(simulation).tolist())
    parts = simulation.steps_per_interval if simulation.steps is None else 1
    before = motion[0]
    for step, (begin, end) in enumerate(zip(ends[:-1], ends[1:], strict=True), start=1):
        now = between_instants(end, simulation.times, motion)
        yield {
            "begin": number(begin),
            "end": number(end),
            "length": number(end - begin),
            "increment": number((end - begin) / parts),
            "smallest": number(_SMALLEST * (end - begin)),
            "motion": [f"{prescribed[k]},{number(now[k])}" for k in np.flatnonzero(now != before)],
            # The last increment of a step is put out whatever the frequency is; 0 is none.
            "output": 100000 if step in outputs else 0,
        }
        before = now
