"""Four Gauss points or five: which rule of a tetrahedron is nearer to the converged answer.

The demo's specimen with the truth of examples/alpha, by the exponential scheme, on meshes from a
few cells to fine ones; the reference is a mesh finer than all of them, the mean of both rules.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from driver.case.model import load_case
from driver.experiment.reading import history_of
from driver.forward.build import adapter_of, build_model, mesh_of
from driver.forward.prediction import Prediction

ALPHA = Path(__file__).parents[1] / "examples" / "alpha" / "case.toml"
TRUTH = {
    "tau0": 21.0, "c": 44e3, "d": 1140.0, "tau0_grain2": 1.15, "lambda_plus_Y": 0.81,
    "lambda_plus_Z": 1.02, "lambda_minus_Y": 0.98, "lambda_minus_Z": 1.02,
}  # fmt: skip
ELONGATION = (0.064, 0.056, 0.128, 0.120, 0.192, 0.184)  # µm, at the turning points
SIZES = (7.0, 3.5, 2.0, 1.5, 1.1)
REFERENCE = 0.62  # µm
RULES = (4, 5)


@dataclass(frozen=True)
class Row:
    """How far a mesh is from the converged answer, by each rule.

    Attributes:
        size: of the elements [µm].
        cells: their number.
        load: root mean square of the load error by four and by five points [µN].
        motion: the same of the motion of the face [nm].
    """

    size: float
    cells: int
    load: tuple[float, float]
    motion: tuple[float, float]


def rows() -> Iterator[Row]:
    """One row for each size, the coarsest first."""
    fine = [predicted(REFERENCE, points) for points in RULES]
    load = np.mean([p.load for _, p in fine], axis=0)
    motion = np.mean([p.motion for _, p in fine], axis=0)
    for size in SIZES:
        predictions = [predicted(size, points) for points in RULES]
        yield Row(
            size,
            predictions[0][0],
            _both(float(np.sqrt(np.mean((p.load - load) ** 2))) for _, p in predictions),
            _both(float(1e3 * np.sqrt(np.mean((p.motion - motion) ** 2))) for _, p in predictions),
        )


def predicted(size: float, points: int) -> tuple[int, Prediction]:
    """Return the number of cells, and loads and motion of the face at the truth."""
    case = load_case(ALPHA)
    mesh = mesh_of(case, size)
    across, along = np.linspace(-1.8, 1.8, 19), np.linspace(0.3, 11.7, 58)
    pixels = np.stack(np.meshgrid(across, along, indexing="ij"), axis=-1).reshape(-1, 2)
    model = build_model(case, mesh, history_of(case), pixels, adapter_of(case), 1)
    model = replace(model, integration="exponential", tet10_points=points)
    knots = {f"elongation_{k}": value for k, value in enumerate(ELONGATION, start=1)}
    tilts = {f"tilt_{k}": 0.25 * value for k, value in enumerate(ELONGATION, start=1)}
    return len(mesh.cells), model.predict(model.null_values() | TRUTH | knots | tilts)


def _both(pair: Iterator[float]) -> tuple[float, float]:
    four, five = pair
    return four, five


def table(found: list[Row]) -> str:
    """Return the rows as a Markdown table."""
    lines = [
        "| element [µm] | cells | load [µN]: 4 points | 5 points | face [nm]: 4 points | 5 |",
        "|---|---|---|---|---|---|",
    ]
    for row in found:
        numbers = (f"{value:.3g}" for value in (*row.load, *row.motion))
        lines.append(f"| {row.size:g} | {row.cells} | " + " | ".join(numbers) + " |")
    return "\n".join(lines) + "\n"
