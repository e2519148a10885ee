"""A solver of its own program in a few lines: an elastic bar, and a shell that runs it."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from solver_adapters.external import ExternalAdapter, Profile, ResultFileError, Status
from solver_adapters.interface import Capabilities, Response, Simulation
from solver_adapters.material import Material
from tools.boxes import box, pulled

SCRIPT = """\
import json, sys
bar = json.load(open("bar.json"))
print("a bar of", bar["stiffness"], flush=True)
json.dump([bar["stiffness"] * u for u in bar["pull"]], open("force.json", "w"))
open("count", "a").write("x")
"""


SIMULATION = replace(
    pulled(box(), Material(strain_measure="small"), (0.001, 0.002)), integration="backward_euler"
)
FORCE = 233.5e3 * np.array([0.0, 0.004, 0.008])
"""The answer to `SIMULATION` [µN]: C11 times the elongation of 4 µm."""


class BarAdapter(ExternalAdapter):
    """The force of an elastic bar whose deck is JSON; its program ends with the lines `do`."""

    name = "bar"
    programs = ("prismid-bar-that-nobody-has",)
    results = ("force.json",)

    def __init__(self, profile: Profile | None = None) -> None:
        super().__init__(profile)
        self.do = ""
        self.deck = b"# prismid provenance: begin\n# now\n# prismid provenance: end\n"

    def capabilities(self) -> Capabilities:
        return Capabilities(frozenset({"Q", "b"}), frozenset({"small"}), derivatives=False)

    def write(self, simulation: Simulation) -> Mapping[str, bytes]:
        side = simulation.mesh.nodes["S_PLUS"]
        moved = np.isin(simulation.motion_nodes, side)
        pull = simulation.motion[simulation.output][:, moved, 1].mean(axis=1)
        bar = {"stiffness": simulation.material.C11, "pull": pull.tolist()}
        program = SCRIPT + self.do
        return {
            "bar.json": json.dumps(bar).encode(),
            "bar.py": self.deck + program.encode(),
        }

    def command(self, program: tuple[str, ...]) -> tuple[str, ...]:
        return (*program, "bar.py")

    def diagnose(self, log: str) -> Status:
        return next((status for status in Status if f"<{status}>" in log), Status.DONE)

    def read(self, simulation: Simulation, folder: Path) -> Response:
        path = folder / "force.json"
        if not path.is_file():
            raise ResultFileError(f"{path}: found nothing, expected the forces")
        force = np.array(json.loads(path.read_text()))
        nodes = len(simulation.output_nodes)
        displacement = np.zeros((len(force), nodes, 3))
        if len(force) == len(simulation.output):
            _, moved, asked = np.intersect1d(
                simulation.motion_nodes, simulation.output_nodes, return_indices=True
            )
            displacement[:, asked] = simulation.motion[simulation.output][:, moved]
        return Response(
            displacement, force, np.zeros((0, len(force), nodes, 3)),
            np.zeros((0, len(force))), steps=len(force),
        )  # fmt: skip


def bar(do: str = "", **settings: Any) -> BarAdapter:
    """The adapter with Python as its program."""
    profile = {"command": (sys.executable, "-S"), **settings}
    adapter = BarAdapter(Profile(**profile))
    adapter.do = do
    return adapter


def folders(jobs: Path) -> list[str]:
    """Names of the folders of jobs."""
    return sorted(path.name for path in jobs.iterdir())
