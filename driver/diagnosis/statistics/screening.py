"""Screening: a score of every cause that a model can have, from one evaluation at the fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from driver.diagnosis.causes.candidates import causes_of
from driver.diagnosis.causes.causes import NUMERICS, Cause
from driver.diagnosis.statistics.correction_change import whitened_difference
from driver.diagnosis.statistics.discretisation_variance import score_variance
from driver.diagnosis.statistics.score_test import Score, score
from driver.forward.dwell_time import dwells
from driver.forward.model import ForwardModel
from driver.identification.correction import Correction
from driver.identification.fit import Fit
from driver.identification.mesh_error import patterns_left
from driver.identification.objective import Objective
from driver.parameters.history import HOLD
from driver.parameters.instrument import PATTERN_DECLARATIONS
from meshes.arrays import FloatArray
from solver_adapters.grain_scalars import as_honoured, later_names
from solver_adapters.material import MATERIAL_PARAMETERS, OF_SECOND_GRAIN, of_other_crystals


def screened(
    model: ForwardModel,
    fitted: Sequence[str],
    wanted: Sequence[str] | None,
    own: Sequence[Cause] = (),
) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Return the causes that a model can have, and the parameters that screening needs free."""
    known = parameters_of_the_specimen(model) & honoured(model)
    candidates = causes_of(known, fitted, wanted, own, model.n_grains)
    names = [*fitted]
    for cause in candidates:
        names += [n for n in (*cause.parameters, *cause.companions) if n not in names]
    return candidates, tuple(names)


def parameters_of_the_specimen(model: ForwardModel) -> frozenset[str]:
    """Parameters of the general model that this specimen has, whoever simulates it."""
    seen = frozenset(p for p in model.parameters if not model.simulated(p))
    if model.pattern is None:
        seen -= {p.name for p in PATTERN_DECLARATIONS}
    law = frozenset((*MATERIAL_PARAMETERS, *later_names(model.n_grains)))
    if model.n_grains < 2:
        law -= OF_SECOND_GRAIN
    law -= of_other_crystals(model.material.slip_systems)
    if dwells(model.boundary.weights).any():
        law |= {HOLD}
    return seen | law | model.boundary.parameters | model.microstructure.parameters


def honoured(model: ForwardModel) -> frozenset[str]:
    """Parameters of the general model that the solver can honour."""
    offered = model.adapter.capabilities()
    refused = frozenset(MATERIAL_PARAMETERS) - offered.material
    refused |= {name for name in model.parameters if as_honoured(name) in refused}
    if not offered.lattice_gradient:
        refused |= {p.name for p in model.parameters.values() if p.enters == "lattice"}
    if not offered.times:
        refused |= {HOLD}
    return frozenset(model.parameters) - refused


def screen(
    here: Fit,
    objective: Objective,
    candidates: Sequence[Cause],
    effects: Sequence[FloatArray],
    sizes: tuple[float, float],
) -> tuple[list[Score], float]:
    """Score every candidate, and the discretisation; best log evidence first.

    Where two finer meshes as good as each other were compared, half of what they differ by hides
    causes: it counts in what is visible of each.

    Args:
        here: the fit that is examined.
        objective: its objective.
        candidates: the causes.
        effects: whitened sensitivities of each per prior scale, shapes (k_c, n).
        sizes: element sizes of the working and of the first finer mesh [µm].

    Returns:
        The scores, and the variance that they count along the causes, 1 for noise alone.
    """
    data = objective.data
    family, degrees = len(candidates) + 1, data.load_degrees
    pairs = list(zip(candidates, effects, strict=True))
    change, left = objective.correction, []
    if isinstance(change.load, np.ndarray):
        pairs.append((NUMERICS, whitened_difference(objective, change, Correction())[None]))
        # What steps of first order leave is in the covariance, with its own pattern.
        mesh, behind = objective.model.microstructure.mesh, objective.sizes_behind(sizes)
        left = patterns_left(mesh, behind, change.of_mesh, data.load)

    off = off_by_meshes(objective)

    def scored(variance: float) -> list[Score]:
        return [
            score(cause, effect, here.best, family, degrees, variance, off)
            for cause, effect in pairs
        ]

    variance = score_variance(scored(1.0), data, left)
    return sorted(scored(variance), key=lambda s: -s.log_evidence), variance


def off_by_meshes(objective: Objective) -> FloatArray | None:
    """Return half of what two finer meshes differ by, whitened, shape (n,).

    None of one mesh, and where the second is the better one.
    """
    if objective.second is None or objective.second.off is None:
        return None
    return whitened_difference(objective, objective.second.off, Correction())


def own_error_shapes(objective: Objective) -> FloatArray:
    """Return what the simulation's own error looks like, whitened, shape (m, n).

    The correction itself, of which a share may be left, half of what two finer meshes as good as
    each other differ by, and what steps of first order leave; none without a correction.
    """
    left, second = objective.correction.left_by_steps, objective.second
    of_steps = None if left is None else Correction(left.motion, left.load)
    known = [objective.correction, None if second is None else second.off, of_steps]
    shapes = [
        whitened_difference(objective, change, Correction())
        for change in known
        if change is not None and isinstance(change.load, np.ndarray)
    ]
    return np.stack(shapes) if shapes else np.zeros((0, 0))
