"""A whole identification by CalculiX in the place of the bundled solver, on a tiny specimen.

    python -m benchmarks.identify_external

One grain, one cycle, made by `prismid virtual` on a finer mesh with finer steps. CalculiX has no
derivatives: they are finite differences, two runs side by side. Both solvers identify the same
data on the same mesh, in the steps that `check` recommends for CalculiX; their results should agree
within a part of their standard deviations, and no derivative should be called doubtful.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import h5py

from driver.case.grains import Grain
from driver.case.images import Images
from driver.case.material import MaterialTable
from driver.case.model import Case, load_case, write_case
from driver.case.solver import Execution, Solver
from driver.case.specimen import Specimen
from driver.common.progress import progress_to
from driver.results.hdf5 import read_hdf5
from driver.virtual.command import virtual
from driver.workflow import pipeline

TRUTH = {"tau0": 25.0, "c": 44e3, "d": 1140.0, "lambda_plus_Y": 0.85}
_SETTINGS = """
[program]
cycles = [[7, 3]]
largest_strain = 0.008
[truth]
tau0 = 25.0
c = 44e3
d = 1140.0
lambda_plus_Y = 0.85
"""


def small_case() -> Case:
    """Return a short prism of one grain with {110} systems alone, which CalculiX has."""
    return Case(
        specimen=Specimen(length_um=6.0, mesh_size_um=4.0, fine_mesh_size_um=3.0),
        grains=(Grain(name="grain", euler_deg=(281.0, 8.0, 47.0)),),
        material=MaterialTable(strain_measure="small", tau0_112=1e9),
        images=Images(frames="images.tif"),
        solver=Solver(steps_per_interval=20, fine_steps_per_interval=40),
        execution=Execution(processes=2),
    )


@dataclass(frozen=True)
class Identified:
    """What a solver found.

    Attributes:
        values: value and σ by name.
        seconds: wall-clock time of all stages [s].
        reason: why the last fit ended.
        doubts: lines of the log that call a derivative doubtful.
    """

    values: dict[str, tuple[float, float]]
    seconds: float
    reason: str
    doubts: tuple[str, ...]


def identified(folder: Path, solver: str) -> Identified:
    """Return the identification of a case by a solver."""
    case = load_case(folder / "case.toml")
    own = folder.parent / solver
    shutil.copytree(folder, own)
    write_case(
        case.model_copy(
            update={
                "solver": case.solver.model_copy(
                    update={"name": solver, "integration": "backward_euler"}
                )
            }
        ),
        own / "case.toml",
    )
    begun = time.monotonic()
    lines: list[str] = []

    def show(line: str) -> None:
        lines.append(line)
        print(line, flush=True)

    with progress_to(show):
        pipeline.run(own / "case.toml", "identify", False)
    seconds = time.monotonic() - begun
    results = read_hdf5(own / "results" / "identify.h5")
    with h5py.File(own / "results" / "identify.h5", "r") as file:
        names, reason = json.loads(file.attrs["names"]), str(file.attrs["reason"])
    pairs = zip(names, zip(results["values"], results["sigma"], strict=True), strict=True)
    values = {name: (float(v), float(s)) for name, (v, s) in pairs}
    doubts = tuple(line for line in lines if "derivative along" in line)
    return Identified(values, seconds, reason, doubts)


def main() -> None:
    """Run the study and print a line for each parameter."""
    if shutil.which("ccx") is None:
        sys.exit("there is no ccx on the PATH (package calculix-ccx)")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_case(small_case(), folder / "case.toml")
        (folder / "settings.toml").write_text(_SETTINGS, encoding="utf-8")
        with progress_to(print):
            virtual(folder / "case.toml", folder / "settings.toml", folder / "data", 1)
        outcomes = {
            solver: identified(folder / "data", solver) for solver in ("bundled", "calculix")
        }
        jobs = len(list((folder / "calculix" / "results" / "jobs").iterdir()))
    for solver, outcome in outcomes.items():
        print(f"{solver}: {outcome.seconds:.0f} s, {outcome.reason}")
    doubts = len(outcomes["calculix"].doubts)
    print(f"jobs of CalculiX: {jobs}; derivatives called doubtful: {doubts} (goal: 0)")
    own, other = outcomes["bundled"].values, outcomes["calculix"].values
    for name, (value, sigma) in own.items():
        truth = f" (truth {TRUTH[name]:g})" if name in TRUTH else ""
        print(
            f"{name}: bundled {value:.5g} ± {sigma:.2g}, calculix {other[name][0]:.5g} ± "
            f"{other[name][1]:.2g}, difference {(other[name][0] - value) / sigma:+.2f} σ{truth}"
        )


if __name__ == "__main__":
    main()
