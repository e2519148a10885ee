"""Identification as it is commonly done today: FEMU on unweighted nodal displacements.

Finite element model updating (FEMU-UF): the boundary motion is what correlation found, smoothed by
the knots and then held; the residual holds the nodal displacements of the correlation, each over
one scalar standard deviation (no covariance between nodes or images), and the loads over theirs;
Jacobians are forward differences of 2 %; SciPy's trust-region least squares does the rest.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from driver.case.model import load_case
from driver.experiment.reading import read_experiment
from driver.forward.build import adapter_of, build_model
from driver.forward.model import ForwardModel
from driver.identification.identify import start_values
from driver.parameters.boundary import LAMBDAS
from driver.results.files import MESH, RESULTS
from driver.results.hdf5 import read_hdf5
from meshes.arrays import FloatArray
from meshes.files import read_med
from solver_adapters.interface import SolverError

STEP = 0.02  # of each parameter
MOST = 30  # iterations
_TOLERANCE = 1e-4  # of cost and parameters
_FAILED = 1e3  # standard deviations, of a simulation that did not converge


@dataclass(frozen=True)
class Updated:
    """What model updating found.

    Attributes:
        value, sigma: by parameter; σ from the residual's variance and JᵀJ.
        runs: simulations.
        cpu: CPU time [s].
        chi_load: root mean square of the load residual over its noise.
        reason: why it ended.
    """

    value: dict[str, float]
    sigma: dict[str, float]
    runs: int
    cpu: float
    chi_load: float
    reason: str


def update(case_path: Path, law: Sequence[str], extensions: Mapping[str, float]) -> Updated:
    """Update the model of a measured case.

    Args:
        case_path: a case whose stages mesh and measure have run.
        law: constants of the law to find, from the case's starts.
        extensions: starts of others.
    """
    began = time.process_time()
    case = load_case(case_path)
    measured = read_hdf5(case_path.parent / RESULTS / "measure.h5")
    experiment = read_experiment(case)
    nodes_uv, nodes_w = measured["nodes_uv"], measured["nodes_w"]
    model = build_model(
        case, read_med(case_path.parent / RESULTS / MESH), experiment.history,
        np.concatenate([nodes_uv, nodes_w]), adapter_of(case), case.solver.steps_per_interval,
    )  # fmt: skip
    values, _ = start_values(model, measured["elongation"], measured["tilt"])
    start = case.boundary.lambda_start.model_dump()
    values |= {f"lambda_{name}": value for name, value in start.items()} | dict(extensions)
    free = (*LAMBDAS, *law, *extensions)
    problem = _Problem(
        model, values, free, measured["coefficients"], len(nodes_uv), experiment.force,
        experiment.gamma_F, _scatter(measured),
    )  # fmt: skip
    scale = np.array([values[name] for name in free])
    end = least_squares(
        problem, np.ones(len(free)), bounds=(0.05, 20.0), diff_step=STEP, ftol=_TOLERANCE,
        xtol=_TOLERANCE, gtol=None, max_nfev=MOST,
    )  # fmt: skip
    covariance = np.linalg.inv(end.jac.T @ end.jac) * 2.0 * end.cost / end.fun.size
    loads = end.fun[: experiment.force.size]
    return Updated(
        value=dict(zip(free, (end.x * scale).tolist(), strict=True)),
        sigma=dict(zip(free, (np.sqrt(np.diag(covariance)) * scale).tolist(), strict=True)),
        runs=problem.runs,
        cpu=time.process_time() - began,
        chi_load=float(np.sqrt(np.mean(loads**2))),
        reason=end.message,
    )


def _scatter(measured: Mapping[str, FloatArray]) -> FloatArray:
    """One standard deviation for all nodal values of u, v and one for those of w [µm]."""
    variance = np.diag(measured["covariance_one"])
    n = 2 * len(measured["nodes_uv"])
    return np.sqrt([variance[:n].mean(), variance[n:].mean()])


@dataclass
class _Problem:
    """The residual at multiples of the starts, and how often it was simulated."""

    model: ForwardModel
    values: Mapping[str, float]
    free: Sequence[str]
    nodal: FloatArray
    n_uv: int
    force: FloatArray
    force_noise: float
    scatter: FloatArray
    runs: int = 0

    def __call__(self, multiples: FloatArray) -> FloatArray:
        self.runs += 1
        tried = {n: self.values[n] * x for n, x in zip(self.free, multiples, strict=True)}
        try:
            prediction = self.model.predict({**self.values, **tried})
        except SolverError:
            return np.full(self.force.size + self.nodal.size, _FAILED)
        u, v, w = np.moveaxis(prediction.motion, 2, 0)
        n = self.n_uv
        components = (u[:, :n], v[:, :n], w[:, n:])
        seen = np.split(self.nodal, [n, 2 * n], axis=1)
        parts = [(self.force - prediction.load) / self.force_noise]
        for component, (measured, simulated) in enumerate(zip(seen, components, strict=True)):
            gap = measured - simulated
            gap -= gap.mean(axis=1, keepdims=True)  # the stage moves between images
            parts.append((gap / self.scatter[int(component == 2)]).ravel())
        return np.concatenate(parts)
