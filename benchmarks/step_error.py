"""Whether uncertainties count the error of first-order steps: fits of loads with a known truth.

    python -m benchmarks.step_error

One grain of 6 µm, one cycle, loads alone; the truth is the exponential scheme in small steps on the
mesh that identifies, so that the steps are all that is wrong. Each number of steps an interval fits
the same draws of the noise by backward Euler.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from driver.case.grains import Grain
from driver.case.inference import Identification
from driver.case.loading import Boundary
from driver.case.material import MaterialTable
from driver.case.model import Case, write_case
from driver.case.solver import Solver
from driver.case.specimen import Specimen
from driver.experiment.history import read_history
from driver.forward.boundary_motion import knots_of_stage
from driver.forward.build import build_model, mesh_of
from driver.parameters.boundary import elongation_names
from driver.results.hdf5 import read_hdf5
from driver.workflow import pipeline
from meshes.arrays import FloatArray
from solver_adapters.bundled.adapter import BundledAdapter

RATIO = 4.5e-4
TAU0 = 25.0  # MPa
STAGE = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 50.0, 40.0)  # µm
SIZE = 5.0  # µm
_TRUE_STEPS = 32


def case(steps: int) -> Case:
    """Return what the user states."""
    return Case(
        specimen=Specimen(length_um=6.0, mesh_size_um=SIZE, fine_mesh_size_um=0.999 * SIZE),
        grains=(Grain(name="grain", euler_deg=(281.0, 8.0, 47.0)),),
        material=MaterialTable(strain_measure="small", tau0_MPa=30.0),
        boundary=Boundary(motion="stage", stage_ratio=RATIO, stage_ratio_uncertainty=2e-5),
        identification=Identification(parameters=("tau0",)),
        solver=Solver(
            integration="backward_euler",
            steps_per_interval=steps,
            fine_steps_per_interval=2 * steps,
        ),
    )


def write_history(path: Path, force: FloatArray) -> None:
    """Instants, travel and load [N] of each stop."""
    pairs = enumerate(zip(STAGE, force, strict=True))
    rows = (f"{30.0 * k:g},{s:g},,{f:.6f}" for k, (s, f) in pairs)
    path.write_text("time_s,stage_um,image,force_N\n" + "\n".join(rows) + "\n", encoding="utf-8")


def true_load(folder: Path) -> FloatArray:
    """Return the load of the truth [µN]."""
    path = folder / "history.csv"
    write_history(path, np.zeros(len(STAGE)))
    truth = case(1).model_copy(update={"solver": Solver()})
    history = read_history(path, with_images=False)
    mesh, nothing = mesh_of(truth, SIZE), np.zeros((0, 2))
    model = build_model(truth, mesh, history, nothing, BundledAdapter(), _TRUE_STEPS)
    along, _ = knots_of_stage(history.stage[history.turning], RATIO, 0.0)
    knots = dict(zip(elongation_names(history.n_knots), along.tolist(), strict=True))
    return model.predict(model.null_values() | {"tau0": TAU0} | knots).load


def fitted(folder: Path, steps: int, force: FloatArray) -> tuple[float, float]:
    """τ0 and its standard deviation [MPa]."""
    write_history(folder / "history.csv", force)
    write_case(case(steps), folder / "case.toml")
    pipeline.run(folder / "case.toml", "identify", True)
    results = read_hdf5(folder / "results" / "identify.h5")
    return float(results["values"][-1]), float(results["sigma"][-1])


def main() -> None:
    """Print a line for each number of steps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=12, help="draws of the noise")
    draws = parser.parse_args().draws
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        load, stated = true_load(folder), case(1)
        for steps in (1, 2, 4, 8):
            values = []
            for seed in range(draws):
                noise = np.random.default_rng(seed).normal(0.0, stated.loads.noise_uN, load.size)
                values.append(fitted(folder, steps, (load + noise) / stated.force_scale))
            tau0, sigma = np.array(values).T
            off = (tau0 - TAU0) / sigma
            print(
                f"{steps} steps an interval: tau0 {tau0.mean():.2f} ± {sigma.mean():.2f} MPa "
                f"(truth {TAU0:g}), off by {np.sqrt(np.mean(off**2)):.2f} σ rms",
                flush=True,
            )


if __name__ == "__main__":
    main()
