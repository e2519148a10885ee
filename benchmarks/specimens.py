"""Simulations of the demo's prism for the benchmarks: any mesh, any number of images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from driver.case.model import load_case
from driver.experiment.history import History, read_history, turning_points
from driver.forward.build import adapter_of, build_model, mesh_of
from meshes.arrays import IntArray
from solver_adapters.interface import Simulation
from solver_adapters.material import Material, StrainMeasure

ALPHA = Path(__file__).parents[1] / "examples" / "alpha"
# The truth of the demo: examples/alpha/README.md.
_ELONGATION = (0.064, 0.056, 0.128, 0.120, 0.192, 0.184)  # µm
_MOTION = {
    "lambda_plus_Y": 0.81, "lambda_plus_Z": 1.02, "lambda_minus_Y": 0.98, "lambda_minus_Z": 1.02,
    **{f"elongation_{k}": knot for k, knot in enumerate(_ELONGATION, start=1)},
    **{f"tilt_{k}": 0.25 * knot for k, knot in enumerate(_ELONGATION, start=1)},
}  # fmt: skip
_MATERIAL = {
    "small": Material(tau0=21.0, c=44e3, d=1140.0, tau0_grain2=1.15, strain_measure="small"),
    "finite": Material(),
}

EIGHT = (
    "tau0", "c", "d", "lambda_plus_Y", "elongation_1", "rotation_grain1_x", "boundary_shift",
    "depth_scale",
)  # fmt: skip
"""Parameters of every kind: material, motion, orientation, node coordinates."""

THIRTY = (
    *EIGHT, "K", "n", "Q", "b", "tau0_112", "tau0_grain2", "elastic_scale", "C44_scale",
    "lambda_plus_Z", "lambda_minus_Y", "lambda_minus_Z", *(f"elongation_{k}" for k in range(2, 7)),
    *(f"rotation_grain2_{axis}" for axis in "xyz"), "boundary_tilt_x", "boundary_bow",
    "apex_shift",
)  # fmt: skip

CYCLES = (64, 25, 90, 25, 90, 26)
"""Images of each loading phase in a test of 320: three times loading and unloading."""

SHORT_CYCLES = (10, 4, 12, 4, 12, 4)
"""The same in 46 images."""


def stops(images: Sequence[int]) -> History:
    """Stage moves of 5 µm in 10 s, each with a hold of 30 s and then an image.

    Args:
        images: images of each loading phase; the stage turns after each.
    """
    direction = np.repeat(np.resize([1.0, -1.0], len(images)), images)
    at_image = np.concatenate([[0.0], np.cumsum(5.0 * direction)])
    stage = np.concatenate([[0.0], np.repeat(at_image[1:], 2)])
    time = 40.0 * np.arange(at_image.size)
    rows: IntArray = 2 * np.arange(at_image.size)
    return History(
        time=np.concatenate([[0.0], np.ravel(np.column_stack([time[:-1] + 10.0, time[1:]]))]),
        stage=stage,
        image_row=rows,
        force=np.zeros(rows.size),
        turning=turning_points(stage),
        cycle=np.ones(rows.size, dtype=np.int64),
    )


def alpha_history() -> History:
    """Return the history of the demo: 97 images."""
    return read_history(ALPHA / "history.csv")


def specimen(
    size: float, measure: StrainMeasure, history: History, free: Sequence[str] = ()
) -> Simulation:
    """Return the demo's prism under the boundary motion of its truth.

    The material is that of the demo's truth in small strain, as its reference run had it, and the
    default one in finite strain.

    Args:
        size: edge length of the cells [µm].
        measure: the strain measure.
        history: a history of six loading phases.
        free: parameters along which derivatives are wanted.
    """
    case = load_case(ALPHA / "case.toml")
    mesh = mesh_of(case, size)
    model = build_model(case, mesh, history, np.zeros((1, 2)), adapter_of(case), 1)
    model = replace(model, material=_MATERIAL[measure])
    return model.simulation(model.null_values() | _MOTION, free)


def beginning(simulation: Simulation, n_images: int) -> Simulation:
    """Return the part of a simulation up to an image; the directions keep their number."""
    end = int(simulation.output[n_images]) + 1
    return replace(
        simulation,
        times=simulation.times[:end],
        motion=simulation.motion[:end],
        output=simulation.output[: n_images + 1],
        directions=tuple(
            d if d.motion is None else replace(d, motion=d.motion[:end])
            for d in simulation.directions
        ),
    )
