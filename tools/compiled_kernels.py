"""Compiles the kernels of a run, each once: tests side by side would compile them at the same time.

    python -m tools.compiled_kernels

Nothing is done where kernels of these sources were compiled before.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from driver.common.machine import cores
from driver.common.parallel import side_by_side
from driver.forward.build import build_model, geometry_of
from driver.virtual.truth import history_of_rows
from driver.workflow.pipeline import run
from meshes.prism import CellKind, generate
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.kernels import compiled_before
from solver_adapters.material import StrainMeasure
from tools import closed_form

FREE = ("tau0", "elongation_1", "depth_scale")


def simulate(strain: StrainMeasure, cells: CellKind) -> None:
    """Simulate two steps of a short specimen, with their derivatives."""
    case = closed_form.small_case().with_values_at({"material.strain_measure": strain})
    history = history_of_rows([(0.0, 0.0, True), (15.0, 40.0, True), (30.0, 30.0, True)])
    mesh = generate(geometry_of(case), 2.0, cells)
    model = build_model(case, mesh, history, closed_form.pixels(), BundledAdapter(), 1)
    knots = {"elongation_1": 0.03, "elongation_2": 0.02}
    model.predict(model.null_values() | knots, FREE)


def measure() -> None:
    """Correlate the images of a short specimen."""
    with TemporaryDirectory() as folder:
        closed_form.write_files(Path(folder), {})
        run(Path(folder, "case.toml"), "measure")


# Two processes take about the same time: the kernels of finite strain are half of all.
TASKS: tuple[Callable[[], None], ...] = (
    partial(simulate, "finite", "tet10"),
    partial(simulate, "small", "hex20"),
    measure,
)


def _call(number: int) -> None:
    TASKS[number]()


def main() -> None:
    """Carry out all tasks, as many at a time as there are cores."""
    if not compiled_before():
        side_by_side(_call, range(len(TASKS)), min(cores(), len(TASKS)))


if __name__ == "__main__":
    main()
