"""Refusal of bad simulations at the border, each in one sentence, before anything is computed."""

from __future__ import annotations

from numbers import Integral
from typing import Any, get_args

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.checks.arrays import (
    expect_array,
    expect_finite,
    expect_increasing,
    expect_indices,
    expect_number,
    expect_shape,
)
from solver_adapters.checks.directions import refuse_bad_directions
from solver_adapters.checks.eigenstrain import refuse_yielding_eigenstrain
from solver_adapters.checks.mesh import refuse_bad_mesh
from solver_adapters.checks.motion import refuse_bad_motion
from solver_adapters.crystal import MOST_SYSTEMS, table_fault
from solver_adapters.grain_scalars import INSIDE_NULL, as_honoured, inside_names
from solver_adapters.interface import (
    BadSimulationError,
    Integration,
    Simulation,
    UnsupportedError,
)
from solver_adapters.material import (
    LATENT,
    LEAST_EXPONENT,
    MATERIAL_PARAMETERS,
    Material,
    StrainMeasure,
    admissible_at,
    least_C11,
    of_other_crystals,
)
from solver_adapters.parameter import POSITIVE
from solver_adapters.time_steps import SAME_INSTANT

_ROUNDING = 1e-9  # of a rotation [-]


def refuse_bad_simulation(simulation: Simulation) -> None:
    """Raise where a simulation cannot be run, in one sentence: what was found, what was expected.

    Raises:
        UnsupportedError: a value that a solver cannot honour (constants, options, kind of cell).
        BadSimulationError: input that is broken (mesh, orientations, motion, outputs, directions).
    """
    refuse_bad_material(simulation.material)
    refuse_bad_mesh(simulation.mesh)
    _refuse_bad_crystals(simulation)
    _refuse_scalars_of_no_grain(simulation)
    refuse_yielding_eigenstrain(simulation)
    _refuse_bad_times(simulation)
    refuse_bad_motion(simulation)
    _refuse_bad_outputs(simulation)
    _refuse_bad_warm_start(simulation)
    refuse_bad_directions(simulation)


def refuse_bad_material(m: Material) -> None:
    """Raise where a constant of the law is none that a solver can honour.

    Raises:
        UnsupportedError: it is not admissible.
        BadSimulationError: it is no number.
    """
    for name in MATERIAL_PARAMETERS:
        expect_number(name, getattr(m, name))
    for name, admissible in admissible_at(m).items():
        value = getattr(m, name)
        if not admissible.holds(value):
            raise UnsupportedError(f"{name} is {value:g}; expected {admissible.words}")
    if not m.C11 > least_C11(m.C12):
        raise UnsupportedError(
            f"C11 = {m.C11:g}, C12 = {m.C12:g} MPa do not make a positive definite stiffness; "
            "expected C11 > |C12| and C11 + 2 C12 > 0"
        )
    if not isinstance(m.tau0_grains, tuple):
        raise BadSimulationError(f"tau0_grains is {m.tau0_grains!r}; expected a tuple of numbers")
    for ratio in m.tau0_grains:
        expect_number("tau0_grains", ratio)
        if not POSITIVE.holds(ratio):
            raise UnsupportedError(f"tau0_grains holds {ratio:g}; expected positive numbers")
    _refuse_bad_inside(m)
    fault = table_fault(m.slip_systems)
    if fault is not None:
        raise UnsupportedError(
            f"slip_systems has {fault}; expected 1 to {MOST_SYSTEMS} systems, each a plane normal "
            "and a slip direction in that plane"
        )
    for name in sorted(of_other_crystals(m.slip_systems)):
        value, null = getattr(m, name), getattr(Material(), name)
        if value != null:
            which = "BCC with {123}" if name == "tau0_123" else "BCC"
            raise UnsupportedError(
                f"{name} is {value:g}; expected {null:g}, for the slip systems are not those of "
                f"{which}"
            )
    if m.interaction is not None:
        _refuse_bad_interaction(m.interaction, len(m.slip_systems))
    if m.strain_measure not in get_args(StrainMeasure):
        raise UnsupportedError(
            f"strain_measure is {m.strain_measure!r}; expected 'small' or 'finite'"
        )


def _refuse_bad_inside(m: Material) -> None:
    rows, of_grain = m.tau0_grains_inside, len(INSIDE_NULL)
    if not isinstance(rows, tuple) or any(
        not isinstance(row, tuple) or len(row) != of_grain for row in rows
    ):
        raise BadSimulationError(
            f"tau0_grains_inside is {rows!r}; expected a tuple of tuples of {of_grain} numbers"
        )
    admissible = admissible_at(m)
    for grain, row in enumerate(rows, start=3):
        for name, value in zip(inside_names(grain), row, strict=True):
            expect_number(name, value)
            may_be = admissible[as_honoured(name)]
            if not may_be.holds(value):
                raise UnsupportedError(f"{name} is {value:g}; expected {may_be.words}")


def _refuse_bad_interaction(table: Any, n: int) -> None:
    try:
        rows = [len(row) for row in table]
    except TypeError:
        raise BadSimulationError(
            f"interaction is {table!r}; expected {n} rows of {n} numbers"
        ) from None
    if rows != [n] * n:
        raise UnsupportedError(
            f"interaction has {len(rows)} rows of {sorted(set(rows))} numbers; "
            f"expected {n} rows of {n}"
        )
    for row in table:
        for value in row:
            expect_number("a number of interaction", value)
    if not np.isfinite(table).all():
        raise UnsupportedError(
            f"interaction holds a number that is not finite; expected {n} × {n} finite numbers"
        )
    least = min(min(row) for row in table)
    if not LATENT.holds(least):
        raise UnsupportedError(f"interaction holds {least:g}; expected {LATENT.words}")


def _refuse_bad_crystals(simulation: Simulation) -> None:
    n, R = simulation.mesh.n_grains, simulation.orientations
    expect_array("orientations", R)
    if R.ndim != 3 or R.shape[1:] != (3, 3):
        raise BadSimulationError(f"orientations has shape {R.shape}; expected ({n}, 3, 3)")
    if len(R) != n:
        raise BadSimulationError(
            f"there are {len(R)} orientations for {n} grains; expected one for each grain"
        )
    expect_finite("orientations", R)
    for grain in range(n):
        refuse_bad_rotation(f"the orientation of grain {grain + 1}", R[grain])
    if simulation.lattice_gradient is not None:
        expect_shape("lattice_gradient", simulation.lattice_gradient, (n, 3))
        expect_finite("lattice_gradient", simulation.lattice_gradient)


def refuse_bad_rotation(name: str, rotation: FloatArray) -> None:
    """Raise where a matrix (3, 3) is no rotation.

    Raises:
        BadSimulationError: so it is.
    """
    off = abs(rotation.T @ rotation - np.eye(3)).max()
    if off > _ROUNDING:
        raise BadSimulationError(
            f"{name} is no rotation (RᵀR is {off:.2g} off the identity); expected an orthogonal "
            "matrix"
        )
    volume = np.linalg.det(rotation)
    if volume < 0:
        raise BadSimulationError(
            f"{name} is a reflection, left-handed (determinant {volume:.3g}); expected a rotation "
            "of determinant 1"
        )


def _refuse_scalars_of_no_grain(simulation: Simulation) -> None:
    m, n = simulation.material, simulation.mesh.n_grains
    most = max(n - 2, 0)
    for name, what, stated in (
        ("tau0_grains", "ratios", m.tau0_grains),
        ("tau0_grains_inside", "rows", m.tau0_grains_inside),
    ):
        if len(stated) > most:
            raise BadSimulationError(
                f"{name} has {len(stated)} {what} for {n} grains; expected at most {most}, "
                "those of the third and later grains"
            )


def _refuse_bad_times(simulation: Simulation) -> None:
    times, steps = simulation.times, simulation.steps
    expect_array("times", times)
    if times.ndim != 1 or len(times) < 2:
        raise BadSimulationError(
            f"times has shape {times.shape}; expected two instants or more in a row"
        )
    expect_finite("times", times)
    expect_increasing("times", times)
    count = simulation.steps_per_interval
    if not isinstance(count, Integral) or isinstance(count, bool) or count < 1:
        raise BadSimulationError(
            f"steps_per_interval is {count!r}; expected a whole number, 1 or more"
        )
    expect_number("tolerance", simulation.tolerance)
    if not 0 < simulation.tolerance <= 1e-2:
        raise BadSimulationError(
            f"tolerance is {simulation.tolerance:g}; expected more than 0 and at most 0.01"
        )
    if simulation.accuracy is not None:
        expect_number("accuracy", simulation.accuracy)
    if simulation.accuracy is not None and not 0 < simulation.accuracy < np.inf:
        raise BadSimulationError(
            f"accuracy is {simulation.accuracy:g} µN; expected a positive number or None"
        )
    refuse_bad_integration(simulation.integration, simulation.material.n)
    if steps is not None:
        expect_shape("steps", steps, (None,))
        expect_finite("steps", steps)
        expect_increasing("steps", steps)
        gap = np.array([abs(steps - time).min(initial=np.inf) for time in times[1:]])
        rounding = SAME_INSTANT * (times[-1] - times[0])
        outside = steps[(steps <= times[0] + rounding) | (steps > times[-1] + rounding)]
        if outside.size:
            raise BadSimulationError(
                f"steps holds {outside.size} ends outside of the history, the first is "
                f"{outside[0]:g} s; expected ends after {times[0]:g} s and up to {times[-1]:g} s"
            )
        missed = np.flatnonzero(gap > rounding)
        if missed.size:
            raise BadSimulationError(
                f"steps pass over {missed.size} of {len(gap)} instants, the first is "
                f"{times[1 + missed[0]]:g} s; expected a step that ends at every instant"
            )


def refuse_bad_integration(integration: Integration, n: float) -> None:
    """Raise where there is no such scheme, or it has no solution at the rate exponent n.

    Raises:
        UnsupportedError: so it is.
    """
    if integration == "exponential" and n < LEAST_EXPONENT:
        raise UnsupportedError(
            f"n is {n:g}; expected {LEAST_EXPONENT:g} or more with exponential integration "
            "(backward_euler takes 1 or more)"
        )
    if integration not in get_args(Integration):
        raise UnsupportedError(
            f"integration is {integration!r}; expected 'backward_euler' or 'exponential'"
        )


def _refuse_bad_outputs(simulation: Simulation) -> None:
    expect_shape("output", simulation.output, (None,))
    expect_indices("output", simulation.output, len(simulation.times), "instants")
    expect_increasing("output", simulation.output)
    expect_shape("output_nodes", simulation.output_nodes, (None,))
    expect_indices("output_nodes", simulation.output_nodes, len(simulation.mesh.points), "nodes")


def _refuse_bad_warm_start(simulation: Simulation) -> None:
    near = simulation.warm_start
    if near is None:
        return
    expect_shape("warm_start.times", near.times, (None,))
    expect_finite("warm_start.times", near.times)
    expect_increasing("warm_start.times", near.times)
    if len(near.times) < 2:
        raise BadSimulationError(
            f"warm_start.times holds {len(near.times)} instants; expected the first one and an end "
            "of a step or more"
        )
    nodes = len(simulation.mesh.points)
    expect_shape("warm_start.displacement", near.displacement, (len(near.times), nodes, 3))
    expect_finite("warm_start.displacement", near.displacement)
