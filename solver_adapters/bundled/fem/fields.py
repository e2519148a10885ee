"""What varies inside a grain: crystal frames, factor on τ0, and the state of the points at rest.

Positions come from the mesh. The derivative along a `Direction` is taken by the complex step on
the same functions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshes.arrays import AnyArray, FloatArray, IntArray
from meshes.cells import outer_triangles
from solver_adapters.bundled.fem.element import (
    Element,
    gauss_positions,
    shape_gradient_velocity,
    shape_gradients,
)
from solver_adapters.bundled.fem.initial import (
    depth_share,
    initial_state,
    skin_factor,
    surface_distance,
)
from solver_adapters.grain_scalars import as_honoured, band_names, inside_names, mode_names
from solver_adapters.inside_grain import band_factor, mode_factor, standardised
from solver_adapters.interface import Direction, Simulation
from solver_adapters.material import scalar

_EVERYWHERE = ("x0", "eigenstrain", "skin_tau0", "skin_thickness")
_AT_REST = frozenset((*_EVERYWHERE, *inside_names(1), *inside_names(2)))

_STEP = 1e-30


@dataclass(frozen=True, eq=False)
class Frames:
    """Crystal → specimen rotations: one for each grain, or for each point where they vary.

    Attributes:
        rotation: (n_frames, 3, 3).
        of_point: row of `rotation` of each Gauss point, (n_points,).
    """

    rotation: FloatArray
    of_point: IntArray


def acts_at_rest(name: str) -> bool:
    """Whether a scalar of the law acts through the fields of this module, not local constants."""
    return as_honoured(name) in _AT_REST


def _names(n_grains: int) -> tuple[str, ...]:
    """Return the names of those of a specimen of so many grains."""
    inside = (name for grain in range(1, n_grains + 1) for name in inside_names(grain))
    return (*_EVERYWHERE, *inside)


@dataclass(frozen=True, eq=False)
class AtRest:
    """State (n_points, n_state) and factor on τ0 (n_points,) of the Gauss points."""

    state: FloatArray
    skin: FloatArray


@dataclass(frozen=True, eq=False)
class _Points:
    """Positions (n_points, 3) and volumes (n_points,) of Gauss points, and all nodes (n_nodes, 3).

    Complex where nodes move along a direction.
    """

    position: AnyArray
    volume: AnyArray
    nodes: AnyArray


def crystal_frames(simulation: Simulation, element: Element) -> Frames:
    """Return the frames of a simulation."""
    mesh = simulation.mesh
    grain = np.repeat(mesh.grain, len(element.weights))
    if not _varies(simulation):
        return Frames(simulation.orientations, grain)
    rotation = _rotations(
        simulation.orientations, _gradient(simulation), _points(simulation, element, None), grain
    )
    return Frames(rotation.real, np.arange(grain.size))


def frame_change(simulation: Simulation, element: Element, direction: Direction) -> FloatArray:
    """Return the derivative of the rotations of `crystal_frames`."""
    mesh = simulation.mesh
    spins = np.zeros((mesh.n_grains, 3), dtype=np.complex128)
    if direction.rotation is not None:
        spins += 1j * _STEP * direction.rotation
    orientations = _turns(spins) @ simulation.orientations
    if not _varies(simulation):
        return np.ascontiguousarray(orientations.imag / _STEP)
    gradient = _gradient(simulation).astype(np.complex128)
    if direction.lattice_gradient is not None:
        gradient += 1j * _STEP * direction.lattice_gradient
    grain = np.repeat(mesh.grain, len(element.weights))
    points = _points(simulation, element, direction)
    rotation = _rotations(orientations, gradient, points, grain)
    return np.ascontiguousarray(rotation.imag / _STEP)


def at_rest(simulation: Simulation, element: Element, frames: Frames) -> AtRest:
    """State, and factor on τ0, of a simulation."""
    values = {name: scalar(simulation.material, name) for name in _names(simulation.mesh.n_grains)}
    rotation = frames.rotation[frames.of_point]
    state, skin = _rest(simulation, values, rotation, _points(simulation, element, None))
    return AtRest(np.ascontiguousarray(state), np.ascontiguousarray(skin))


def at_rest_change(
    simulation: Simulation,
    element: Element,
    direction: Direction,
    frames: Frames,
    drotation: FloatArray,
) -> AtRest | None:
    """Return the derivative of `at_rest` along a direction that turns the frames by `drotation`.

    None where the direction has no part in it.
    """
    m, rates = simulation.material, direction.material
    names = _names(simulation.mesh.n_grains)
    null = m.x0 == 0.0 and m.eigenstrain == 0.0 and m.skin_tau0 == 1.0
    grains = range(1, simulation.mesh.n_grains + 1)
    varying = (name for g in grains for name in (*mode_names(g), band_names(g)[0]))
    uniform = all(scalar(m, name) == 0.0 for name in varying)
    if null and uniform and not any(name in rates for name in names):
        return None
    values = {name: scalar(m, name) + 1j * _STEP * rates.get(name, 0.0) for name in names}
    rotation = (frames.rotation + 1j * _STEP * drotation)[frames.of_point]
    points = _points(simulation, element, direction)
    state, skin = _rest(simulation, values, rotation, points)
    return AtRest(state.imag / _STEP, skin.imag / _STEP)


def _rest(
    simulation: Simulation, values: Mapping[str, Any], rotation: AnyArray, points: _Points
) -> tuple[AnyArray, AnyArray]:
    x0, eigenstrain = values["x0"], values["eigenstrain"]
    ratio, thickness = values["skin_tau0"], values["skin_thickness"]
    mesh = simulation.mesh
    depth: AnyArray = np.zeros(len(rotation))
    skin: AnyArray = np.ones(len(rotation))
    if eigenstrain != 0.0:
        depth = depth_share(points.position[:, 2], points.volume)
    if ratio != 1.0:
        faces = outer_triangles(mesh.cells)
        held = np.zeros(len(faces), dtype=np.bool_)
        for group in ("S_PLUS", "S_MINUS"):
            held |= np.isin(faces, mesh.nodes[group]).all(axis=1)
        distance = surface_distance(points.position, points.nodes[faces[~held]])
        skin = skin_factor(ratio, thickness, distance)
    skin = skin * _factor_inside(simulation, values, points)
    material = simulation.material
    second = material.c2 != 0.0 or any(
        "c2" in direction.material for direction in simulation.directions
    )
    measure, systems = material.strain_measure, material.slip_systems
    return initial_state(measure, systems, x0, eigenstrain, rotation, depth, second), skin


def _factor_inside(simulation: Simulation, values: Mapping[str, Any], points: _Points) -> AnyArray:
    """Factor on τ0 of modes and bands inside the grains, (n_points,)."""
    mesh = simulation.mesh
    grain = np.repeat(mesh.grain, len(points.volume) // len(mesh.grain))
    factor = np.ones(len(grain), dtype=np.result_type(points.position, *values.values()))
    for number in range(mesh.n_grains):
        of_grain = mode_names(number + 1), band_names(number + 1)
        modes, band = ([values[name] for name in names] for names in of_grain)
        if not any(value != 0.0 for value in (*modes, band[0])):
            continue
        here = grain == number
        xi, eta = (standardised(at, points.volume[here]) for at in points.position[here, :2].T)
        factor[here] = mode_factor(modes, eta, xi) * band_factor(band, eta)
    return factor


def _varies(simulation: Simulation) -> bool:
    return simulation.lattice_gradient is not None or any(
        direction.lattice_gradient is not None for direction in simulation.directions
    )


def _gradient(simulation: Simulation) -> FloatArray:
    if simulation.lattice_gradient is None:
        return np.zeros((simulation.mesh.n_grains, 3))
    return simulation.lattice_gradient


def _points(simulation: Simulation, element: Element, direction: Direction | None) -> _Points:
    mesh = simulation.mesh
    nodes: AnyArray = mesh.points
    gradients, weights = shape_gradients(nodes, mesh.cells, element)
    volume: AnyArray = weights
    if direction is not None and direction.points is not None:
        nodes = nodes + 1j * _STEP * direction.points
        _, change = shape_gradient_velocity(gradients, weights, mesh.cells, direction.points)
        volume = volume + 1j * _STEP * change
    positions = gauss_positions(nodes, mesh.cells, element)
    return _Points(positions.reshape(-1, 3), volume.ravel(), nodes)


def _rotations(
    orientations: AnyArray, gradient: AnyArray, points: _Points, grain: IntArray
) -> AnyArray:
    """Rotation at each Gauss point."""
    y, volume = points.position[:, 1], points.volume
    moment = np.zeros(len(orientations), dtype=y.dtype)
    whole = np.zeros(len(orientations), dtype=volume.dtype)
    np.add.at(moment, grain, volume * y)
    np.add.at(whole, grain, volume)
    spins = gradient[grain] * (y - (moment / whole)[grain])[:, None]
    return np.asarray(_turns(spins) @ orientations[grain])


def _turns(vectors: AnyArray) -> AnyArray:
    """Matrices (n, 3, 3) of rotation vectors (n, 3) by Rodrigues' formula, complex as those."""
    x, y, z = vectors.T
    null = np.zeros_like(x)
    spin = np.stack([null, -z, y, z, null, -x, -y, x, null], axis=1).reshape(-1, 3, 3)
    angle = np.sqrt(x * x + y * y + z * z)[:, None, None]
    half = np.sinc(angle / (2.0 * np.pi))
    turned = np.sinc(angle / np.pi) * spin + 0.5 * half**2 * (spin @ spin)
    return np.asarray(np.eye(3) + turned)
