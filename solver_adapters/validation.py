"""Refusal of bad simulations at the border, each in one sentence, before anything is computed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from meshes.cells import EDGES, inverted_cells
from meshes.prism_mesh import PrismMesh
from solver_adapters.constants import elastic_constants, grain_ratios
from solver_adapters.crystal import N_110, N_SYSTEMS, slip_systems
from solver_adapters.interface import (
    Direction,
    FloatArray,
    Integration,
    Simulation,
    SolverError,
    UnsupportedError,
)
from solver_adapters.material import MATERIAL_PARAMETERS, Material, StrainMeasure
from solver_adapters.time_steps import SAME_INSTANT

AnyArray = NDArray[Any]

_ROUNDING = 1e-9  # of a rotation [-], of a first motion [µm]
_RIGID = 1e-8  # smallest singular value, in shares of the largest, of a rigid motion that is held
# Cells with straight edges as tetrahedra of their corners.
_TETRAHEDRA = {
    10: np.array([[0, 1, 2, 3]]),
    15: np.array([[0, 1, 2, 5], [0, 1, 5, 4], [0, 4, 5, 3]]),
}
_NODE_GROUPS = ("S_PLUS", "S_MINUS")
_MODES = tuple(
    f"{kind} {axis}" for kind in ("translation along", "rotation about") for axis in "XYZ"
)


class BadSimulationError(SolverError):
    """A simulation that contradicts itself or that no solver could run."""


LEAST_EXPONENT = 1.5
"""Of n in the exponential scheme, whose relaxation has no power law at n = 1."""


@dataclass(frozen=True)
class _Rule:
    holds: Callable[[float, Material], bool]
    expected: str


_POSITIVE = _Rule(lambda v, m: 0 < v < np.inf, "a positive number")
_NOT_NEGATIVE = _Rule(lambda v, m: 0 <= v < np.inf, "zero or more")
# CalculiX has −0.1; below −1 slip would soften others by more than it hardens its own system.
_LATENT = _Rule(lambda v, m: -1 <= v < np.inf, "-1 or more")
_FINITE = _Rule(lambda v, m: bool(np.isfinite(v)), "a finite number")

_RULES: dict[str, _Rule] = {
    "C11": _FINITE,
    "C12": _FINITE,
    "C44": _POSITIVE,
    "K": _POSITIVE,
    "n": _Rule(lambda v, m: 1 <= v < np.inf, "one or more"),
    "tau0": _POSITIVE,
    "c": _NOT_NEGATIVE,
    "d": _NOT_NEGATIVE,
    "Q": _NOT_NEGATIVE,
    "b": _NOT_NEGATIVE,
    "tau0_112": _POSITIVE,
    "tau0_grain2": _POSITIVE,
    "tau0_antitwinning": _POSITIVE,
    "a1": _FINITE,
    "h_latent": _LATENT,
    "c2": _NOT_NEGATIVE,
    "d2": _NOT_NEGATIVE,
    "x0": _Rule(lambda v, m: bool(np.isfinite(v)) and abs(v) * m.d < 1, "less than 1/d in size"),
    "eigenstrain": _FINITE,
    "skin_tau0": _POSITIVE,
    "skin_thickness": _POSITIVE,
    "elastic_scale": _POSITIVE,
    "C44_scale": _POSITIVE,
}


def refuse_bad_simulation(simulation: Simulation) -> None:
    """Raise where a simulation cannot be run, in one sentence: what was found, what was expected.

    Raises:
        UnsupportedError: a value that a solver cannot honour (constants, options, kind of cell).
        BadSimulationError: input that is broken (mesh, orientations, motion, outputs, directions).
    """
    _refuse_bad_material(simulation.material)
    _refuse_bad_mesh(simulation.mesh)
    _refuse_bad_crystals(simulation)
    _refuse_ratios_of_no_grain(simulation)
    _refuse_yielding_eigenstrain(simulation)
    _refuse_bad_times(simulation)
    _refuse_bad_motion(simulation)
    _refuse_bad_outputs(simulation)
    refuse_bad_directions(simulation)


def _refuse_bad_material(m: Material) -> None:
    for name, rule in _RULES.items():
        value = getattr(m, name)
        _expect_number(name, value)
        if not rule.holds(value, m):
            raise UnsupportedError(f"{name} is {value:g}; expected {rule.expected}")
    if not (abs(m.C12) < m.C11 and m.C11 + 2 * m.C12 > 0):
        raise UnsupportedError(
            f"C11 = {m.C11:g}, C12 = {m.C12:g} MPa do not make a positive definite stiffness; "
            "expected C11 > |C12| and C11 + 2 C12 > 0"
        )
    if not isinstance(m.tau0_grains, tuple):
        raise BadSimulationError(f"tau0_grains is {m.tau0_grains!r}; expected a tuple of numbers")
    for ratio in m.tau0_grains:
        _expect_number("tau0_grains", ratio)
        if not 0 < ratio < np.inf:
            raise UnsupportedError(f"tau0_grains holds {ratio:g}; expected positive numbers")
    if m.interaction is not None:
        _refuse_bad_interaction(m.interaction)
    if m.strain_measure not in get_args(StrainMeasure):
        raise UnsupportedError(
            f"strain_measure is {m.strain_measure!r}; expected 'small' or 'finite'"
        )


def _refuse_bad_interaction(table: Any) -> None:
    try:
        rows = [len(row) for row in table]
    except TypeError:
        raise BadSimulationError(
            f"interaction is {table!r}; expected 24 rows of 24 numbers"
        ) from None
    if rows != [24] * 24:
        raise UnsupportedError(
            f"interaction has {len(rows)} rows of {sorted(set(rows))} numbers; "
            "expected 24 rows of 24"
        )
    for row in table:
        for value in row:
            _expect_number("a number of interaction", value)
    if not np.isfinite(table).all():
        raise UnsupportedError(
            "interaction holds a number that is not finite; expected 24 × 24 finite numbers"
        )
    least = min(min(row) for row in table)
    if least < -1:
        raise UnsupportedError(f"interaction holds {least:g}; expected -1 or more")


def _refuse_bad_mesh(mesh: PrismMesh) -> None:
    _expect_shape("mesh.points", mesh.points, (None, 3))
    _expect_finite("mesh.points", mesh.points)
    cells, n_nodes = mesh.cells, len(mesh.points)
    _expect_array("mesh.cells", cells)
    if cells.ndim != 2 or cells.shape[1] not in EDGES or not len(cells):
        raise UnsupportedError(
            f"mesh.cells has shape {cells.shape}; expected (n, 10) for tet10 or (n, 15) for "
            "wedge15, with one cell or more"
        )
    _expect_indices("mesh.cells", cells, n_nodes, "nodes")
    _expect_shape("mesh.grain", mesh.grain, (len(cells),))
    _expect_integers("mesh.grain", mesh.grain)
    without = np.flatnonzero(mesh.grain < 0)
    if without.size:
        raise BadSimulationError(
            f"{without.size} of {len(cells)} cells have no grain, the first is cell {without[0]} "
            f"with grain {mesh.grain[without[0]]}; expected a grain index of 0 or more"
        )
    present = np.unique(mesh.grain)
    if present[-1] != present.size - 1:
        hole = int(np.flatnonzero(present != np.arange(present.size))[0])
        raise BadSimulationError(
            f"grain index {hole} has no cell though the largest is {present[-1]}; "
            "expected grain indices without a hole"
        )
    for name in _NODE_GROUPS:
        if name not in mesh.nodes:
            raise BadSimulationError(
                f"mesh.nodes has no group {name} (it has {', '.join(mesh.nodes) or 'none'}); "
                f"expected {' and '.join(_NODE_GROUPS)}"
            )
        if not np.size(mesh.nodes[name]):
            raise BadSimulationError(
                f"the group {name} of mesh.nodes is empty; expected one node or more"
            )
    for name, nodes in mesh.nodes.items():
        _expect_shape(f"mesh.nodes[{name!r}]", nodes, (None,))
        _expect_indices(f"mesh.nodes[{name!r}]", nodes, n_nodes, "nodes")
        # The force on a face is a sum over its nodes.
        twice = _twice(nodes)
        if twice.size:
            raise BadSimulationError(
                f"the group {name} of mesh.nodes holds node {twice[0]} twice; "
                "expected each node once"
            )
    used = np.zeros(n_nodes, dtype=np.bool_)
    used[cells] = True
    loose = np.flatnonzero(~used)
    if loose.size:
        raise BadSimulationError(
            f"{loose.size} of {n_nodes} nodes belong to no cell, the first is node {loose[0]}; "
            "expected every node in a cell"
        )
    inverted = inverted_cells(mesh.points, cells)
    if inverted.size:
        first = int(inverted[0])
        raise BadSimulationError(
            f"{inverted.size} of {len(cells)} cells are inverted, the first is cell {first} in "
            f"grain {mesh.grain[first] + 1}; expected positive Jacobians"
        )
    _refuse_pieces(cells, n_nodes)


def _refuse_pieces(cells: AnyArray, n_nodes: int) -> None:
    first = np.repeat(cells[:, 0], cells.shape[1])
    links = coo_array((np.ones(cells.size, dtype=np.int8), (first, cells.ravel())), (n_nodes,) * 2)
    count, piece = connected_components(links, directed=False)
    if count > 1:
        sizes = np.sort(np.bincount(piece[cells[:, 0]]))[::-1]
        raise BadSimulationError(
            f"the mesh falls into {count} pieces that share no node, of "
            f"{', '.join(str(size) for size in sizes[:5])}{', …' if count > 5 else ''} cells; "
            "expected one connected mesh"
        )


def _refuse_bad_crystals(simulation: Simulation) -> None:
    n, R = simulation.mesh.n_grains, simulation.orientations
    _expect_array("orientations", R)
    if R.ndim != 3 or R.shape[1:] != (3, 3):
        raise BadSimulationError(f"orientations has shape {R.shape}; expected ({n}, 3, 3)")
    if len(R) != n:
        raise BadSimulationError(
            f"there are {len(R)} orientations for {n} grains; expected one for each grain"
        )
    _expect_finite("orientations", R)
    off = abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2))
    volume = np.linalg.det(R)
    for grain in range(n):
        if off[grain] > _ROUNDING:
            raise BadSimulationError(
                f"the orientation of grain {grain + 1} is no rotation (RᵀR is {off[grain]:.2g} off "
                "the identity); expected an orthogonal matrix"
            )
        if volume[grain] < 0:
            raise BadSimulationError(
                f"the orientation of grain {grain + 1} is a reflection, left-handed (determinant "
                f"{volume[grain]:.3g}); expected a rotation of determinant 1"
            )
    if simulation.lattice_gradient is not None:
        _expect_shape("lattice_gradient", simulation.lattice_gradient, (n, 3))
        _expect_finite("lattice_gradient", simulation.lattice_gradient)


def _refuse_ratios_of_no_grain(simulation: Simulation) -> None:
    ratios, n = simulation.material.tau0_grains, simulation.mesh.n_grains
    most = max(n - 2, 0)
    if len(ratios) > most:
        raise BadSimulationError(
            f"tau0_grains has {len(ratios)} ratios for {n} grains; expected at most {most}, "
            "those of the third and later grains"
        )


def _refuse_yielding_eigenstrain(simulation: Simulation) -> None:
    """The run starts from elastic equilibrium, which an eigenstrain can drive beyond yield.

    Between clamped ends the outermost fibre carries E times its eigenstrain along Y.
    """
    m = simulation.material
    if m.eigenstrain == 0:
        return
    C11, C12, C44 = elastic_constants(m)
    S11, S12 = np.linalg.inv(np.full((3, 3), C12) + (C11 - C12) * np.eye(3))[0, :2]
    along = simulation.orientations[:, 1]
    directions, normals = slip_systems()
    schmid = abs((along @ directions.T) * (along @ normals.T))
    strength = m.tau0 * np.where(np.arange(N_SYSTEMS) < N_110, 1.0, m.tau0_112)
    yields = grain_ratios(m, len(along)) / (schmid / strength).max(axis=1)
    # Young's modulus of a cubic crystal along a unit vector in its axes.
    x, y, z = along.T**2
    modulus = 1 / (S11 - 2 * (S11 - S12 - 0.5 / C44) * (x * y + y * z + z * x))
    stress = modulus * _outermost_share(simulation.mesh) * abs(m.eigenstrain)
    grain = int(np.argmax(stress / yields))
    if stress[grain] > yields[grain]:
        raise UnsupportedError(
            f"eigenstrain is {m.eigenstrain:g}, by which grain {grain + 1} carries about "
            f"{stress[grain]:.3g} MPa before loading and yields at {yields[grain]:.3g}; expected "
            f"at most {abs(m.eigenstrain) * yields[grain] / stress[grain]:.2g} in size"
        )


def _outermost_share(mesh: PrismMesh) -> float:
    """Largest distance from the mean height, in shares of the depth (√18 standard deviations)."""
    corners = mesh.cells[:, _TETRAHEDRA[mesh.cells.shape[1]]].reshape(-1, 4)
    z = mesh.points[corners, 2]
    volume = abs(np.linalg.det(mesh.points[corners[:, 1:]] - mesh.points[corners[:, :1]]))
    volume /= volume.sum()
    mean = float(volume @ z.mean(axis=1))
    z = z - mean
    # Mean square of a linear function over a tetrahedron.
    square = float(volume @ ((z**2).sum(axis=1) + z.sum(axis=1) ** 2)) / 20
    return float(abs(z).max() / np.sqrt(18 * square))


def _refuse_bad_times(simulation: Simulation) -> None:
    times, steps = simulation.times, simulation.steps
    _expect_array("times", times)
    if times.ndim != 1 or len(times) < 2:
        raise BadSimulationError(
            f"times has shape {times.shape}; expected two instants or more in a row"
        )
    _expect_finite("times", times)
    _expect_increasing("times", times)
    count = simulation.steps_per_interval
    if not isinstance(count, Integral) or isinstance(count, bool) or count < 1:
        raise BadSimulationError(
            f"steps_per_interval is {count!r}; expected a whole number, 1 or more"
        )
    _expect_number("tolerance", simulation.tolerance)
    if not 0 < simulation.tolerance <= 1e-2:
        raise BadSimulationError(
            f"tolerance is {simulation.tolerance:g}; expected more than 0 and at most 0.01"
        )
    if simulation.accuracy is not None:
        _expect_number("accuracy", simulation.accuracy)
    if simulation.accuracy is not None and not 0 < simulation.accuracy < np.inf:
        raise BadSimulationError(
            f"accuracy is {simulation.accuracy:g} µN; expected a positive number or None"
        )
    n = simulation.material.n
    if simulation.integration == "exponential" and n < LEAST_EXPONENT:
        raise UnsupportedError(
            f"n is {n:g}; expected {LEAST_EXPONENT:g} or more with exponential integration "
            "(backward_euler takes 1 or more)"
        )
    if simulation.integration not in get_args(Integration):
        raise UnsupportedError(
            f"integration is {simulation.integration!r}; expected 'backward_euler' or 'exponential'"
        )
    if steps is not None:
        _expect_shape("steps", steps, (None,))
        _expect_finite("steps", steps)
        _expect_increasing("steps", steps)
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


def _refuse_bad_motion(simulation: Simulation) -> None:
    s = simulation
    nodes, mask, motion, points = s.motion_nodes, s.motion_mask, s.motion, s.mesh.points
    _expect_shape("motion_nodes", nodes, (None,))
    _expect_indices("motion_nodes", nodes, len(points), "nodes")
    _expect_shape("motion_mask", mask, (len(nodes), 3))
    if mask.dtype != np.bool_:
        raise BadSimulationError(f"motion_mask holds {mask.dtype}; expected true or false")
    _expect_shape("motion", motion, (len(s.times), len(nodes), 3))
    twice = _twice(nodes)
    if twice.size:
        raise BadSimulationError(
            f"{twice.size} nodes are prescribed twice in motion_nodes, the first is node "
            f"{twice[0]}; expected each node once"
        )
    prescribed = motion[:, mask]
    _expect_finite("motion", prescribed)
    # The run starts from rest: a first motion would be a jump inside the first step.
    largest = abs(prescribed[0]).max(initial=0.0)
    if largest > _ROUNDING:
        raise BadSimulationError(
            f"motion is {largest:.3g} µm at the first instant, where the specimen is at rest; "
            "expected zero"
        )
    free = _free_rigid_motions(points[nodes], mask)
    if free:
        raise BadSimulationError(
            f"the prescribed motion leaves the specimen free in {' and '.join(free)}; "
            "expected motion_mask to hold all six rigid motions"
        )


def _free_rigid_motions(points: FloatArray, mask: AnyArray) -> list[str]:
    """The rigid motions that move none of the prescribed degrees of freedom, in words.

    Args:
        points: prescribed nodes [µm], shape (n, 3).
        mask: their prescribed components, shape (n, 3).
    """
    held = points[mask.any(axis=1)]
    if not len(held):
        return list(_MODES)
    # Turning about the middle of what is held, a lone held node is left by rotations alone.
    arms = points - held.mean(axis=0)
    arms /= np.ptp(held, axis=0).max() or 1.0
    modes = np.empty((*mask.shape, 6))
    modes[:, :, :3] = np.eye(3)
    for axis in range(3):
        modes[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms)
    # The triangular factor has the singular values of the whole, without its rows.
    _, values, basis = np.linalg.svd(np.linalg.qr(modes[mask], mode="r"))
    null = basis[np.count_nonzero(values > _RIGID * values[0]) :]
    named = [
        name for name, share in zip(_MODES, (null**2).sum(axis=0), strict=True) if share > 1 - 1e-6
    ]
    return named if len(named) == len(null) else [*named, "a rigid motion"]


def _refuse_bad_outputs(simulation: Simulation) -> None:
    _expect_shape("output", simulation.output, (None,))
    _expect_indices("output", simulation.output, len(simulation.times), "instants")
    _expect_increasing("output", simulation.output)
    _expect_shape("output_nodes", simulation.output_nodes, (None,))
    _expect_indices("output_nodes", simulation.output_nodes, len(simulation.mesh.points), "nodes")


def refuse_bad_directions(simulation: Simulation) -> None:
    """Raise where a direction does not fit its simulation, in one sentence.

    Raises:
        UnsupportedError: a direction along what the material does not have.
        BadSimulationError: names, shapes or numbers that are wrong.
    """
    names: set[str] = set()
    grains = (simulation.mesh.n_grains, 3)
    shapes: dict[str, tuple[int, ...]] = {
        "rotation": grains,
        "lattice_gradient": grains,
        "motion": simulation.motion.shape,
        "points": simulation.mesh.points.shape,
    }
    for direction in simulation.directions:
        if not isinstance(direction.name, str):
            raise BadSimulationError(f"a direction has the name {direction.name!r}; expected text")
        if direction.name in names:
            raise BadSimulationError(
                f"two directions have the name {direction.name!r}; expected different names"
            )
        names.add(direction.name)
        _refuse_bad_direction(direction, shapes)


def _refuse_bad_direction(direction: Direction, shapes: dict[str, tuple[int, ...]]) -> None:
    _expect_number(f"scale of direction {direction.name!r}", direction.scale)
    if not 0 < direction.scale < np.inf:
        raise BadSimulationError(
            f"scale of direction {direction.name!r} is {direction.scale:g}; "
            "expected a positive number"
        )
    if not isinstance(direction.material, Mapping):
        raise BadSimulationError(
            f"material of direction {direction.name!r} is {direction.material!r}; expected "
            "numbers by the names of parameters"
        )
    for name, rate in direction.material.items():
        if name not in MATERIAL_PARAMETERS:
            raise UnsupportedError(
                f"direction {direction.name!r} changes {name!r}, which the material does not have; "
                f"expected one of {', '.join(MATERIAL_PARAMETERS)}"
            )
        _expect_number(f"the change of {name} in direction {direction.name!r}", rate)
        if not np.isfinite(rate):
            raise BadSimulationError(
                f"direction {direction.name!r} changes {name} by {rate:g}; expected a finite number"
            )
    for name, shape in shapes.items():
        change = getattr(direction, name)
        if change is not None:
            _expect_shape(f"{name} of direction {direction.name!r}", change, shape)
            _expect_finite(f"{name} of direction {direction.name!r}", change)


def _twice(nodes: AnyArray) -> AnyArray:
    """The nodes that are listed more than once."""
    unique, count = np.unique(nodes, return_counts=True)
    return unique[count > 1]


def _expect_number(name: str, value: Any) -> None:
    if not isinstance(value, Real) or isinstance(value, bool):
        raise BadSimulationError(f"{name} is {value!r}; expected a number")


def _expect_array(name: str, array: Any) -> None:
    if not isinstance(array, np.ndarray):
        raise BadSimulationError(f"{name} is a {type(array).__name__}; expected an array")
    if array.dtype.kind not in "biuf":
        raise BadSimulationError(f"{name} holds {array.dtype}; expected real numbers")


def _expect_shape(name: str, array: AnyArray, shape: tuple[int | None, ...]) -> None:
    _expect_array(name, array)
    fits = array.ndim == len(shape) and all(
        wanted in (None, size) for size, wanted in zip(array.shape, shape, strict=True)
    )
    if not fits:
        words = ", ".join("n" if size is None else str(size) for size in shape)
        raise BadSimulationError(
            f"{name} has shape {array.shape}; expected ({words}{',' if len(shape) == 1 else ''})"
        )


def _expect_finite(name: str, array: AnyArray) -> None:
    bad = array.size - np.count_nonzero(np.isfinite(array))
    if bad:
        raise BadSimulationError(
            f"{name} holds {bad} values that are not finite; expected finite numbers"
        )


def _expect_integers(name: str, array: AnyArray) -> None:
    if not np.issubdtype(array.dtype, np.integer):
        raise BadSimulationError(f"{name} holds {array.dtype}; expected integers")


def _expect_indices(name: str, array: AnyArray, count: int, what: str) -> None:
    _expect_integers(name, array)
    bad = array[(array < 0) | (array >= count)]
    if bad.size:
        raise BadSimulationError(
            f"{name} holds {bad[0]}, but there are {count} {what}; expected 0 to {count - 1}"
        )


def _expect_increasing(name: str, array: AnyArray) -> None:
    back = np.flatnonzero(np.diff(array) <= 0)
    if back.size:
        i = int(back[0])
        raise BadSimulationError(
            f"{name} goes from {array[i]:g} to {array[i + 1]:g} at place {i + 1}; "
            "expected increasing values"
        )
