"""Whether rotations that were found of the grains are one turn of the EBSD frame.

A frame that lies otherwise than stated turns all grains alike. Fitted one by one they may end as
rotations of their own, which name nothing: the nearest of the symmetrically equivalent lattices.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from driver.common.distributions import chi2_isf
from driver.diagnosis.causes.ebsd_flips import FLIPS, frame_turn, from_lattice
from driver.identification.fit import Fit
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter

_CHANCE = 0.01  # of rejecting one turn that all grains share
_SEEN = 1e-3  # chance of a turn that is none
_SIGMAS = 3.0
# What is left stands in the way of the last degrees (2 and 3 of a quarter turn that was tried).
_NEAR = np.deg2rad(5.0)
_TAKEN = 0.1  # of the squares of the rotations, which a flip of the frame may leave


def turned_frame(fit: Fit, parameters: Mapping[str, Parameter], orientations: FloatArray) -> str:
    """Say with which turn of the EBSD frame the rotations of all grains agree, if with any.

    Args:
        fit: the fit with the causes that were added.
        parameters: all parameters by name.
        orientations: measured crystal → specimen of each grain, shape (n_grains, 3, 3).

    Returns:
        A sentence; empty where a grain was not rotated, or no turn is common.
    """
    names = [
        f"rotation_grain{grain}_{axis}"
        for grain in range(1, len(orientations) + 1)
        for axis in "xyz"
    ]
    free = list(fit.best.free)
    if len(orientations) < 2 or not set(names) <= set(free):
        return ""
    at = [free.index(name) for name in names]
    slopes = np.array([parameters[name].slope(fit.values[name]) for name in names])
    covariance = fit.covariance[np.ix_(at, at)] * np.outer(slopes, slopes)
    turns = np.array([fit.values[name] for name in names]).reshape(-1, 3)
    return common_turn(turns, covariance, orientations)


def common_turn(turns: FloatArray, covariance: FloatArray, orientations: FloatArray) -> str:
    """Say which turn of the frame rotations of the grains have in common, if any.

    Args:
        turns: rotation vector of each grain in the specimen frame [rad], shape (n_grains, 3).
        covariance: of all of them [rad²], shape (3 n_grains, 3 n_grains).
        orientations: measured crystal → specimen of each grain, shape (n_grains, 3, 3).
    """
    each = np.arange(turns.size).reshape(-1, 3)
    allowed = [
        max(_SIGMAS * float(np.linalg.eigvalsh(covariance[np.ix_(at, at)])[-1]) ** 0.5, _NEAR)
        for at in each
    ]
    found = Rotation.from_rotvec(turns).as_matrix() @ orientations
    off = {
        flip: np.array(
            [
                from_lattice(lattice, frame_turn((flip,)) @ measured)
                for lattice, measured in zip(found, orientations, strict=True)
            ]
        )
        for flip in FLIPS
    }
    flip = min(FLIPS, key=lambda one: float((off[one] ** 2).sum()))
    if np.all(off[flip] <= allowed) and (off[flip] ** 2).sum() < _TAKEN * (turns**2).sum():
        angles = " and ".join(f"{np.rad2deg(angle):.1f}°" for angle in off[flip])
        return (
            f"The rotations of the grains end {angles} from the lattices that they would have if "
            f"{flip.sentence}."
        )
    weight = np.linalg.inv(covariance)
    same = np.tile(np.eye(3), (len(turns), 1))
    information = same.T @ weight @ same
    mean = np.linalg.solve(information, same.T @ weight @ turns.ravel())
    rest = turns.ravel() - same @ mean
    degrees = 3 * (len(turns) - 1)
    apart, seen = float(rest @ weight @ rest), float(mean @ information @ mean)
    if apart > chi2_isf(_CHANCE, degrees) or seen < chi2_isf(_SEEN, 3):
        return ""
    angle = float(np.linalg.norm(mean))
    axis = " ".join(f"{component:+.2f}" for component in mean / angle)
    return (
        f"The rotations of the grains agree within their σ (χ² {apart:.1f} of {degrees}) with one "
        f"turn of the EBSD frame by {np.rad2deg(angle):.1f}° about [{axis}] of the specimen."
    )
