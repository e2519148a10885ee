"""A small case of three images with invented results, to be exported."""

from __future__ import annotations

import csv
import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from functools import cache
from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray

from driver.case.model import load_case, write_case
from driver.forward.build import mesh_of
from driver.parameters.boundary import LAMBDAS
from driver.parameters.registry import declared_parameters
from driver.results.hdf5 import write_hdf5
from driver.workflow import pipeline
from driver.workflow.engine import stage_keys
from meshes.files import write_med, write_vtu
from meshes.prism_mesh import PrismMesh
from solver_adapters.interface import Capabilities, CellFields, Progress, Response, Simulation
from tests.driver.stated_sizes import stated_case

Arrays = dict[str, tuple[NDArray[np.generic] | float, str]]
PIXEL = 0.11
TIME = np.array([0.0, 40.5, 81.0])
STAGE = np.array([0.0, 10.0, 4.0])
FORCE = np.array([1.5, 302.0, 120.25])
SHIFT = np.array([[0.0, 0.0, 0.0], [0.02, -0.05, 0.01], [-0.03, 0.04, 0.2]])
# Seven pixels of a field of 3 × 3: one is masked in the middle of the first row, one at a corner.
ROWS, COLS = np.array([0, 1, 1, 1, 2, 2, 2]), np.array([0, 0, 1, 2, 0, 1, 2])
XY = np.column_stack([(ROWS - 1) * PIXEL, COLS * PIXEL])
OUTPUTS = {
    "mesh": ("mesh.med", "mesh.vtu"),
    "measure": ("measure.h5",),
    "identify": ("identify.h5",),
    "diagnose": ("diagnosis.json", "diagnosis.h5"),
}


@cache
def coarse_mesh() -> PrismMesh:
    return mesh_of(stated_case(), 3.0)


class LinearSolver:
    """Fields that are linear in time and tell models, cells and components apart."""

    name = "bundled"
    cell_fields = True

    def __init__(self) -> None:
        self.asked: list[Simulation] = []
        self.workspaces: list[Path | None] = []

    def capabilities(self) -> Capabilities:
        return Capabilities(frozenset(), frozenset({"small", "finite"}), False, self.cell_fields)

    def version(self) -> str:
        return "1"

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        self.asked.append(simulation)
        self.workspaces.append(workspace)
        if progress is not None:
            for time in simulation.times[1:]:
                progress(Progress(time, simulation.times[-1], 1, 1, 0, 60.0))
        times = simulation.times[simulation.output]
        points = simulation.mesh.points[simulation.output_nodes]

        def field(width: int) -> NDArray[np.float64]:
            cells = np.arange(len(simulation.mesh.cells))[:, None] + np.arange(width) / 100
            return simulation.material.tau0 * times[:, None, None] * cells

        return Response(
            displacement=1e-3 * times[:, None, None] * points,
            force=times,
            d_displacement=np.zeros((0, len(times), len(points), 3)),
            d_force=np.zeros((0, len(times))),
            cells=CellFields(field(6), field(24), field(24) + 1, field(3)),
        )


class Results:
    """A small case of three images whose results are known; both models stretch the face."""

    def __init__(self, folder: Path) -> None:
        self.solver = LinearSolver()
        self.case_path, self.folder = folder / "case.toml", folder / "results"
        self.to = folder / "to"
        folder.mkdir(exist_ok=True)
        self.folder.mkdir()
        write_case(stated_case(), self.case_path)
        rows = "".join(
            f"{t},{s},{i},{f / 2}\n"
            for i, (t, s, f) in enumerate(zip(TIME, STAGE, FORCE, strict=True))
        )
        (folder / "history.csv").write_text("time_s,stage_um,image,force_N\n" + rows)
        stretch = np.zeros((3, 7, 3))
        stretch[..., 1] = np.outer([0.0, 0.01, 0.005], XY[:, 1])
        self.motion = {"final": stretch, "after": 1.1 * stretch}
        self.rho = {key: np.arange(21.0).reshape(3, 7) * 1e-3 for key in self.motion}
        self.load = {"final": np.array([0.0, 300.0, 130.0]), "after": np.array([0.5, 302.5, 120.0])}
        self.measured = stretch + SHIFT[:, None, :]
        self.reference = np.arange(9.0).reshape(3, 3) / 100
        self.write_measure()
        names = ["tau0", "elongation_1", "elongation_2"]
        declared = declared_parameters(3)
        everything = {name: parameter.null for name, parameter in declared.items()}
        everything |= {"tau0": 21.0, "elongation_1": 0.064, "elongation_2": 0.056}
        everything |= {name: 0.9 for name in LAMBDAS}
        write_hdf5(
            self.folder / "identify.h5",
            {
                "sigma": (np.array([0.5, 1e-3, 2e-3]), "see units"),
                "start": (np.array([40.0, 0.0, 0.0]), "see units"),
                **self.predictions("final"),
            },
            {
                "names": json.dumps(names),
                "units": json.dumps(["MPa", "µm", "µm"]),
                "all_values": json.dumps(everything),
                "warnings": json.dumps([]),
                "reason": "the Newton decrement is 0.04 σ",
                "converged": "yes",
            },
        )
        write_hdf5(self.folder / "diagnosis.h5", self.predictions("after"))
        extended = {
            "tau0": {"value": 20.0, "sigma": 0.4, "unit": "MPa"},
            "elongation_1": {"value": 0.065, "sigma": 1e-3, "unit": "µm"},
            "elongation_2": {"value": 0.057, "sigma": 1e-3, "unit": "µm"},
            "tau0_grain2": {"value": 1.15, "sigma": 0.02, "unit": ""},
            "tilt_drift": {"value": 1e-3, "sigma": 1e-4, "unit": ""},
        }
        (self.folder / "diagnosis.json").write_text(json.dumps({"extended": {"values": extended}}))
        write_med(coarse_mesh(), self.folder / "mesh.med")
        write_vtu(coarse_mesh(), self.folder / "mesh.vtu")
        self.record("mesh", "measure", "identify", "diagnose")

    def predictions(self, prefix: str) -> Arrays:
        return {
            f"{prefix}/load": (self.load[prefix], "µN"),
            f"{prefix}/load_residual": (FORCE - self.load[prefix], "µN"),
            f"{prefix}/motion": (self.motion[prefix], "µm"),
            f"{prefix}/rho": (self.rho[prefix], "µm"),
        }

    def write_measure(self) -> None:
        write_hdf5(
            self.folder / "measure.h5",
            {
                "time": (TIME, "s"),
                "stage": (STAGE, "µm"),
                "cycle": (np.array([1, 1, 1]), "1"),
                "force": (FORCE, "µN"),
                "reference": (self.reference, "µm"),
                "xy": (XY, "µm"),
                "rows": (ROWS, "pixel"),
                "cols": (COLS, "pixel"),
                "motion": (self.measured, "µm"),
                "chi": (np.array([1.0, 1.1, 0.9]), "1"),
                "elongation": (np.array([0.0, 0.07, 0.05]), "µm"),
                "tilt": (np.array([0.0, 0.02, 0.01]), "µm"),
            },
        )

    def record(self, *finished: str) -> None:
        """What `run_stages` would have written after these stages."""
        case = load_case(self.case_path)
        keys = stage_keys(pipeline.stages(case), case)
        entries = {
            name: {"key": keys[name], "outputs": OUTPUTS[name], "seconds": 1.0}
            for name in keys
            if name in finished
        }
        (self.folder / "stages.json").write_text(json.dumps(entries))

    def edit(self, old: str, new: str) -> None:
        text = self.case_path.read_text("utf-8")
        assert text.count(old) == 1
        self.case_path.write_text(text.replace(old, new), encoding="utf-8")

    def frames(self) -> list[tuple[float, meshio.Mesh]]:
        """Time and mesh of each step of the exported series."""
        sets = ElementTree.parse(self.to / "surface.pvd").getroot().findall("Collection/DataSet")
        return [
            (float(s.attrib["timestep"]), meshio.read(self.to / s.attrib["file"])) for s in sets
        ]

    def table(self, name: str) -> list[dict[str, str]]:
        with (self.to / name).open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    def numbers(self, name: str, column: str) -> NDArray[np.float64]:
        return np.array([float(row[column]) for row in self.table(name)])


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }
