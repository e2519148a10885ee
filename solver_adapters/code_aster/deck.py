"""The files of a job: command file, mesh, prescribed motion, export file."""

from __future__ import annotations

import tempfile
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from meshes.arrays import FloatArray, IntArray
from meshes.files import write_med
from meshes.prism_mesh import PrismMesh
from solver_adapters.code_aster.law import hardening, has_two_families, is_fcc
from solver_adapters.constants import grain_ratios
from solver_adapters.crystal import bunge_angles
from solver_adapters.external import Profile
from solver_adapters.interface import Simulation
from solver_adapters.time_steps import step_ends
from templates import render

EXPORT = "job.export"
NODES, CELLS, FORCES, LISTING = "nodes.rmed", "cells.rmed", "forces.csv", "job.mess"
"""What Code_Aster leaves: nodal fields, those at the Gauss points, resultants, its listing."""

_AXES = "XYZ"
# A job without a limit of its own gets a week: Code_Aster wants a number.
_LONGEST = 7 * 86400.0


def render_files(
    simulation: Simulation, profile: Profile, cautions: Iterable[str] = ()
) -> Mapping[str, bytes]:
    """Return the files of a job by name.

    Args:
        simulation: what is simulated.
        profile: limits and processes.
        cautions: sentences at the head of the command file.
    """
    groups = _moved_groups(simulation)
    texts = {
        "job.comm": render("code_aster/job.comm.j2", **_commands(simulation, groups, cautions)),
        "motion.csv": render(
            "code_aster/motion.csv.j2",
            instants=simulation.times.tolist(),
            rows=list(_motion_rows(simulation)),
        ),
        EXPORT: render(
            f"code_aster/{EXPORT}.j2",
            version=version("prismid"),
            time_limit=min(profile.cpu_time or _LONGEST, profile.wall_time or _LONGEST),
            memory=profile.memory,
            threads=profile.threads,
            processes=profile.processes,
            cell_fields=simulation.cell_fields,
        ),
    }
    files = {name: text.encode("ascii") for name, text in texts.items()}
    return {**files, "job.med": _med(simulation.mesh, groups)}


def _commands(
    simulation: Simulation, groups: Mapping[str, IntArray], cautions: Iterable[str]
) -> dict[str, Any]:
    """Return what the template of the command file names."""
    material, n_grains = simulation.material, simulation.mesh.n_grains
    said = hardening(material)
    ratios = grain_ratios(material, n_grains).tolist()
    ends = None if simulation.steps is None else step_ends(simulation)[1:]
    return {
        "version": version("prismid"),
        "cautions": [textwrap.fill(text, 96, subsequent_indent="# ") for text in cautions],
        "material": material,
        "two_families": has_two_families(material),
        "family": "OCTAEDRIQUE" if is_fcc(material) else "BCC24",
        "planes": "{111}" if is_fcc(material) else "{110}",
        "Q": said.Q,
        "classes": said.classes,
        "interaction": None if said.matrix is None else [_row(row) for row in said.matrix.tolist()],
        "grains": [
            {"number": grain + 1, "ratio": ratios[grain], "angles": _angles(rotation)}
            for grain, rotation in enumerate(simulation.orientations)
        ],
        "axes": [axis for axis in _AXES if f"MOVED_{axis}" in groups],
        "steps_per_interval": simulation.steps_per_interval,
        "steps": None if ends is None else _rows(ends.tolist()),
        "wanted": _rows(simulation.output.tolist()),
        "finite": material.strain_measure == "finite",
        "tolerance": simulation.tolerance,
        "cell_fields": simulation.cell_fields,
    }


def _angles(rotation: FloatArray) -> list[float]:
    """Bunge angles from 0 to 360 degrees, without the last digits, which depend on the machine."""
    return [round(angle % 360.0, 10) for angle in bunge_angles(rotation)]


def _moved_groups(simulation: Simulation) -> dict[str, IntArray]:
    """Nodes of which a component is prescribed, by the name of the group."""
    nodes, mask = simulation.motion_nodes, simulation.motion_mask
    return {
        f"MOVED_{axis}": np.sort(nodes[mask[:, column]])
        for column, axis in enumerate(_AXES)
        if mask[:, column].any()
    }


def _motion_rows(simulation: Simulation) -> Iterable[dict[str, Any]]:
    points = simulation.mesh.points
    for place, column in np.argwhere(simulation.motion_mask):
        node = simulation.motion_nodes[place]
        yield {
            "node": node + 1,
            "component": f"D{_AXES[column]}",
            "place": points[node].tolist(),
            "motion": simulation.motion[:, place, column].tolist(),
        }


def _med(mesh: PrismMesh, groups: Mapping[str, IntArray]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "job.med"
        write_med(replace(mesh, nodes={**mesh.nodes, **groups}), path)
        return path.read_bytes()


def _rows(values: Iterable[float]) -> list[str]:
    """Numbers in rows that fit a screen, without the comma at the end of a row."""
    return [row.rstrip(",") for row in textwrap.wrap(_row(values), 88)]


def _row(values: Iterable[float]) -> str:
    return ", ".join(map(repr, values))
