"""Refusal of motions that break a run: jumps at rest, and rigid motions that are left free."""

from __future__ import annotations

import numpy as np

from meshes.arrays import AnyArray, FloatArray
from solver_adapters.checks.arrays import expect_finite, expect_indices, expect_shape
from solver_adapters.checks.mesh import twice
from solver_adapters.interface import BadSimulationError, Simulation

_AT_REST = 1e-9  # µm, of a first motion
_RIGID = 1e-8  # smallest singular value, in shares of the largest, of a rigid motion that is held
_MODES = tuple(
    f"{kind} {axis}" for kind in ("translation along", "rotation about") for axis in "XYZ"
)


def refuse_bad_motion(simulation: Simulation) -> None:
    """Raise where the prescribed motion cannot be that of a run.

    Raises:
        BadSimulationError: what was found, and what was expected.
    """
    s = simulation
    nodes, mask, motion, points = s.motion_nodes, s.motion_mask, s.motion, s.mesh.points
    expect_shape("motion_nodes", nodes, (None,))
    expect_indices("motion_nodes", nodes, len(points), "nodes")
    expect_shape("motion_mask", mask, (len(nodes), 3))
    if mask.dtype != np.bool_:
        raise BadSimulationError(f"motion_mask holds {mask.dtype}; expected true or false")
    expect_shape("motion", motion, (len(s.times), len(nodes), 3))
    doubled = twice(nodes)
    if doubled.size:
        raise BadSimulationError(
            f"{doubled.size} nodes are prescribed twice in motion_nodes, the first is node "
            f"{doubled[0]}; expected each node once"
        )
    prescribed = motion[:, mask]
    expect_finite("motion", prescribed)
    # The run starts from rest: a first motion would be a jump inside the first step.
    largest = abs(prescribed[0]).max(initial=0.0)
    if largest > _AT_REST:
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
    """Return the rigid motions that move none of the prescribed degrees of freedom, in words.

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
