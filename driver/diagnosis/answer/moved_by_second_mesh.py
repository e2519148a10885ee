"""What a second finer mesh moves of the values that were identified with the first one."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from driver.common.formatting import joined
from driver.identification.fit import Fit
from driver.parameters.registry import label_of
from solver_adapters.parameter import Parameter

MATTERS = 1.0
"""σ by which a value has to move to be told."""


def moved_by_second_mesh(
    identified: Mapping[str, float],
    baseline: Fit,
    parameters: Mapping[str, Parameter],
    names: Collection[str],
) -> dict[str, float]:
    """Return by how much values differ from those that were identified, where it matters [σ].

    Args:
        identified: values with the first mesh.
        baseline: the fit with the second one.
        parameters: declarations by name.
        names: of the parameters that are looked at.
    """
    sigma = np.sqrt(np.diag(baseline.covariance))
    moved = {}
    for row, name in enumerate(baseline.best.free):
        if name in names:
            value = baseline.values[name]
            unit = sigma[row] * parameters[name].slope(value)
            moved[name] = float((value - identified[name]) / unit)
    return {name: by for name, by in moved.items() if abs(by) > MATTERS}


def moved_told(moved: Mapping[str, float], sizes: tuple[float, float]) -> tuple[str, ...]:
    """Return one sentence on what was moved, or none.

    Stated sizes alone would ask for tetrahedra, of which no second mesh is the better one.

    Args:
        moved: by name [σ].
        sizes: of the working mesh and of the second finer one [µm].
    """
    if not moved:
        return ()
    which = joined([f"{label_of(name)} by {by:+.1f} σ" for name, by in moved.items()])
    return (
        f"a second finer mesh, of {sizes[1]:.3g} µm, moves {which}: the identified values and the "
        f'posterior are those of the first one; specimen.cells = "hex20", specimen.mesh_size_um = '
        f"{sizes[0]:.3g} and specimen.fine_mesh_size_um = {sizes[1]:.3g} make them those of the "
        "second",
    )
