"""The crystal law by NEML2, at many points: run by its own interpreter, without prismid.

    PEERS/bin/python benchmarks/neml2_point.py path.npz stress.npz

The first file holds the strain of each point in crystal axes at some instants, (rows, n, 3, 3),
and these, (rows,). Writes the stress after each step, (rows − 1, n, 3, 3) [MPa], and prints the CPU
time of a point and step [µs], the best of the repeats.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

REPEATS = 3
# Backward Euler of an elastic strain that 24 systems relax, each by |τ/100|^10 sign τ a second; a
# lattice that stands still. No hardening: both programs have this law.
MODEL = """
[Tensors]
  [directions]
    type = Python
    expr = 'MillerIndex(torch.tensor([[1, 1, 1], [1, 1, 1]], dtype=torch.int64))'
  []
  [planes]
    type = Python
    expr = 'MillerIndex(torch.tensor([[1, 1, 0], [1, 1, 2]], dtype=torch.int64))'
  []
[]
[Data]
  [crystal_geometry]
    type = CubicCrystal
    lattice_parameter = 1
    slip_directions = 'directions'
    slip_planes = 'planes'
  []
[]
[Models]
  [rotation]
    type = RotationMatrix
    from = 'orientation'
    to = 'orientation_matrix'
  []
  [elasticity]
    type = LinearIsotropicElasticity
    coefficients = '2e5 0.3'
    coefficient_types = 'YOUNGS_MODULUS POISSONS_RATIO'
    strain = 'elastic_strain'
    stress = 'cauchy_stress'
  []
  [resolved_shear]
    type = ResolvedShear
    stress = 'cauchy_stress'
  []
  [elastic_strain_rate]
    type = ElasticStrainRate
  []
  [plastic_deformation_rate]
    type = PlasticDeformationRate
  []
  [slip_rule]
    type = PowerLawSlipRule
    n = 10.0
    gamma0 = 1.0
  []
  [slip_strength]
    type = SingleSlipStrengthMap
    constant_strength = 100.0
  []
  [integration]
    type = SR2BackwardEulerTimeIntegration
    variable = 'elastic_strain'
  []
  [rate]
    type = ComposedModel
    models = 'rotation elasticity resolved_shear elastic_strain_rate plastic_deformation_rate
              slip_rule slip_strength integration'
  []
[]
[EquationSystems]
  [system]
    type = NonlinearSystem
    model = 'rate'
    unknowns = 'elastic_strain'
    residuals = 'elastic_strain_residual'
  []
[]
[Solvers]
  [newton]
    type = NewtonWithLineSearch
    max_linesearch_iterations = 5
    linear_solver = 'lu'
  []
  [lu]
    type = DenseLU
  []
[]
[Models]
  [predictor]
    type = CrystalPlasticityStrainPredictor
    scale = 0.1
  []
  [update]
    type = ImplicitUpdate
    equation_system = 'system'
    solver = 'newton'
    predictor = 'predictor'
  []
  [point]
    type = ComposedModel
    models = 'update elasticity'
    additional_outputs = 'elastic_strain'
  []
[]
"""
# Of a symmetric tensor in NEML2: XX, YY, ZZ, √2 YZ, √2 XZ, √2 XY.
ROWS, COLUMNS = [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]
FACTORS = np.sqrt([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


def run(model: Any, strain: Any, times: Any) -> tuple[Any, float]:
    """Return the stress after each step, (rows − 1, n, 6), and the CPU time of the updates [s]."""
    import torch
    from neml2.types import MRP, SR2, WR2, Scalar

    n, cpu, answers = strain.shape[1], 0.0, []
    given: dict[str, Any] = {
        "orientation": MRP(torch.zeros(n, 3)),
        "vorticity": WR2(torch.zeros(n, 3)),
        "slip_hardening": Scalar(torch.zeros(n)),
        "elastic_strain~1": SR2(torch.zeros(n, 6)),
    }
    for row in range(1, len(times)):
        rate = (strain[row] - strain[row - 1]) / (times[row] - times[row - 1])
        given |= {"deformation_rate": SR2(rate), "t": Scalar(times[row])}
        given["t~1"] = Scalar(times[row - 1])
        start = time.process_time()
        answer = model(*(given[name] for name in model.input_spec))
        cpu += time.process_time() - start
        found = dict(zip(model.output_spec, answer, strict=True))
        given["elastic_strain~1"] = found["elastic_strain"]
        answers.append(found["cauchy_stress"].data)
    return torch.stack(answers), cpu


def main() -> None:
    """Read the path, follow it, write the stress and print the time."""
    import neml2
    import torch

    torch.set_default_dtype(torch.float64)
    torch.set_num_threads(1)
    with np.load(sys.argv[1]) as data:
        times, strain = torch.tensor(data["time"]), data["strain"]
    path = torch.tensor(strain[..., ROWS, COLUMNS] * FACTORS)
    with tempfile.TemporaryDirectory() as folder, torch.no_grad():
        file = Path(folder) / "point.i"
        file.write_text(MODEL, encoding="utf-8")
        model = neml2.load_model(str(file), "point")
        runs = [run(model, path, times) for _ in range(REPEATS)]
    stress = np.zeros((*runs[0][0].shape[:2], 3, 3))
    stress[..., ROWS, COLUMNS] = stress[..., COLUMNS, ROWS] = runs[0][0].numpy() / FACTORS
    np.savez(sys.argv[2], stress=stress)
    print(1e6 * min(cpu for _, cpu in runs) / path.shape[1] / (len(times) - 1))


if __name__ == "__main__":
    main()
