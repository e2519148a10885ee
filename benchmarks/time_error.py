"""What the time steps leave wrong in the reference case, in standard deviations of its data.

The demo's own data, mesh and history at its known truth: each scheme and number of steps against
the exponential scheme with 32 steps an interval. The difference of the predictions is whitened as
the data are. Of its norm a part is taken up by the fitted parameters, as a bias; the rest is what
a diagnosis could mistake for a cause. Beside that, what halved steps change on a finer mesh beyond
what they change on the working one: a correction leaves that out.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.diagnosis import ALPHA, TRUTH
from benchmarks.measuring import SCHEMES
from benchmarks.numerics import FINER, WORKING, Discretisation, Ruler, demo
from driver.case.model import load_case
from driver.identification.problem import IdentificationProblem
from driver.parameters.boundary import LAMBDAS
from driver.workflow import pipeline
from driver.workflow.engine import StageContext
from driver.workflow.identify_stage import load_problem
from meshes.arrays import FloatArray
from solver_adapters.interface import Integration

REFERENCE_STEPS = 32
VARIANTS: tuple[tuple[Integration, int], ...] = (
    ("backward_euler", 1),
    ("backward_euler", 2),
    ("backward_euler", 4),
    ("exponential", 1),
    ("exponential", 2),
)
MESHES = (
    (Discretisation("tet10", 2.0, False), Discretisation("tet10", 1.1, False)),
    (WORKING, FINER),
)
"""Working and finer mesh on which steps are halved."""


@dataclass(frozen=True)
class TimeError:
    """Error of a scheme: whole norm, norm beside the parameters, largest bias [σ]; load [µN]."""

    integration: Integration
    steps: int
    norm: float
    beside: float
    bias: float
    worst: str
    load_rms: float
    seconds: float


def time_errors() -> list[TimeError]:
    """Return the errors of `VARIANTS`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "alpha" / "case.toml"
        shutil.copytree(ALPHA, path.parent, ignore=shutil.ignore_patterns("results"))
        pipeline.run(path, "measure", False)
        results = path.parent / "results"
        context = StageContext(load_case(path), results, results)
        problem = load_problem(context)
    values = problem.start | TRUTH
    free = (*LAMBDAS, *problem.law, *problem.knots)
    exact, _ = _predict(problem, values, "exponential", REFERENCE_STEPS)
    best = problem.objective.evaluate(values, free)
    jacobian = best.jacobian
    hessian = best.hessian
    errors = []
    for integration, steps in VARIANTS:
        (residual, load), seconds = _predict(problem, values, integration, steps)
        change = residual - exact[0]
        shift = np.linalg.solve(hessian, jacobian @ change)
        rest = change - jacobian.T @ shift
        biases = abs(shift) / np.sqrt(np.diag(np.linalg.inv(hessian)))
        worst = int(np.argmax(biases))
        errors.append(
            TimeError(
                integration,
                steps,
                float(np.linalg.norm(change)),
                float(np.linalg.norm(rest)),
                float(biases[worst]),
                free[worst],
                float(np.sqrt(np.mean((load - exact[1]) ** 2))),
                seconds,
            )
        )
    return errors


def _predict(
    problem: IdentificationProblem, values: dict[str, float], integration: Integration, steps: int
) -> tuple[tuple[FloatArray, FloatArray], float]:
    """Whitened residual and load of a prediction, and its CPU time [s]."""
    model = replace(problem.working, integration=integration, steps_per_interval=steps)
    start = time.process_time()
    prediction = model.predict(values)
    seconds = time.process_time() - start
    residual, _, _ = problem.objective.data.residual(prediction.motion, prediction.load)
    return (residual, prediction.load), seconds


def report() -> None:
    """Print a line for each scheme."""
    for e in time_errors():
        print(
            f"{e.integration}, {e.steps} steps an interval: time error {e.norm:.2f} σ, beside the "
            f"parameters {e.beside:.2f} σ (goal: <= 1), bias {e.bias:.2f} σ ({e.worst}), load "
            f"{e.load_rms:.2f} µN rms, {e.seconds:.1f} CPU-s"
        )


def products() -> None:
    """Print what halved steps change on two meshes, and by how much both changes differ."""
    with tempfile.TemporaryDirectory() as folder:
        ruler = Ruler(demo(Path(folder)))
    for scheme in SCHEMES:
        for meshes in MESHES:
            changes = []
            for mesh in meshes:
                model = replace(ruler.model(mesh), integration=scheme)
                whole, halved = (
                    replace(model, steps_per_interval=steps).predict(ruler.values)
                    for steps in (1, 2)
                )
                changes.append((halved.motion - whole.motion, halved.load - whole.load))
            (motion, load), (finer_motion, finer_load) = changes
            steps = ruler.difference(motion, load)
            product = ruler.difference(finer_motion - motion, finer_load - load)
            print(
                f"{scheme}, {meshes[0]} and {meshes[1].size:g} µm: halved steps change "
                f"{steps.beside:.2f} σ beside the parameters and {steps.load:.2f} µN rms; on the "
                f"finer mesh {product.beside:.2f} σ and {product.load:.3f} µN more",
                flush=True,
            )


if __name__ == "__main__":
    report()
    products()
