"""Motion of the end faces: knots in stage travel, apex amplitudes, and departures from them.

With ζ = −Z/depth, an end face moves by u = u_edge·(1 + ζ (λ − 1)): the measured edge at ζ = 0,
the apex at λ times the mean of the edge. The gauge sets the mean of both edges to zero, so that
S± move by ± half of the elongation (Y) and of the tilt (Z).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from driver.parameters.boundary import BOUNDARY_DECLARATIONS, elongation_names, tilt_names
from driver.parameters.user_terms import BoundaryTerm, EndFaces
from meshes.arrays import FloatArray, IntArray

_TINY = 1e-30  # complex step: the motion is a rational function of its parameters


def knots_of_stage(
    travel: FloatArray, ratio: float, uncertainty: float
) -> tuple[FloatArray, FloatArray]:
    """Elongation at the knots after the first where only the stage was watched.

    The ratio may be off by its uncertainty in every phase anew, for what the machine takes of the
    travel is another in elastic and in plastic phases, on loading and on unloading.

    Args:
        travel: of the stage at the turning points [µm], shape (n_knots,).
        ratio: elongation over stage travel.
        uncertainty: its standard deviation in a phase.

    Returns:
        elongation and its standard deviation [µm], shape (n_knots − 1,) each.
    """
    steps = np.diff(travel)
    return ratio * np.cumsum(steps), uncertainty * np.sqrt(np.cumsum(steps**2))


@dataclass(frozen=True, eq=False)
class BoundaryMotion:
    """Where the end-face nodes are, and how stage travel spreads the knots over time.

    Attributes:
        nodes: nodes of both end faces, shape (n,).
        side: +1 on S_PLUS, −1 on S_MINUS, shape (n,).
        zeta: −Z/depth of each node, 0 on the edge and 1 at the apex, shape (n,).
        across: X/(width/2) of each node, shape (n,).
        weights: weights of the knots at each instant, shape (n_times, n_knots).
        mask: prescribed components of each node, shape (n, 3).
        terms: what installed packages add.
    """

    nodes: IntArray
    side: FloatArray
    zeta: FloatArray
    across: FloatArray
    weights: FloatArray
    mask: NDArray[np.bool_]
    terms: tuple[BoundaryTerm, ...] = ()

    @property
    def parameters(self) -> frozenset[str]:
        """Names of the parameters that this motion depends on."""
        n = self.weights.shape[1]
        fixed = {p.name for p in BOUNDARY_DECLARATIONS}
        fixed |= {term.parameter.name for term in self.terms}
        return frozenset(fixed | set(elongation_names(n)) | set(tilt_names(n)))

    def evaluate(self, values: Mapping[str, float]) -> FloatArray:
        """Displacement of the end-face nodes [µm], shape (n_times, n, 3)."""
        return self._motion(values)

    def derivative(self, values: Mapping[str, float], name: str) -> FloatArray:
        """Return the derivative of `evaluate` with respect to one parameter (complex step)."""
        stepped: dict[str, complex] = dict(values)
        stepped[name] = values[name] + 1j * _TINY
        return np.asarray(self._motion(stepped).imag / _TINY)

    def _motion(self, values: Mapping[str, complex] | Mapping[str, float]) -> NDArray[Any]:
        n = self.weights.shape[1]
        stretch_knots = np.array([0.0, *(values[k] for k in elongation_names(n))])
        tilt_knots = np.array([0.0, *(values[k] for k in tilt_names(n))])
        # A product of neighbouring weights is a parabola over the phase, 1/4 at its middle.
        products = 4.0 * self.weights[:, :-1] * self.weights[:, 1:]
        phases = np.diff(stretch_knots)
        half_stretch = 0.5 * (
            self.weights @ stretch_knots + values["stretch_curvature"] * products @ phases
        )
        half_tilt = 0.5 * (self.weights @ tilt_knots)
        largest = stretch_knots[np.argmax(np.real(stretch_knots))] or 1.0
        progress = (self.weights @ stretch_knots) / largest
        plus = self.side > 0
        lam_Y = np.where(plus, values["lambda_plus_Y"], values["lambda_minus_Y"])
        lam_Z = np.where(plus, values["lambda_plus_Z"], values["lambda_minus_Z"])
        shape_Y = self.side * (1.0 + self.zeta * (lam_Y - 1.0))
        shape_Z = self.side * (1.0 + self.zeta * (lam_Z - 1.0))
        turn = np.where(plus, self.across, 0.0) * values["end_rotation"]
        bend = np.where(plus, self.zeta, 0.0) * values["apex_curvature"]
        shear = np.where(plus, 1.0, 0.0) * values["end_shear"]
        kind = np.result_type(half_stretch, half_tilt, shape_Y, shape_Z, turn, bend, shear)
        motion = np.empty((len(self.weights), self.nodes.size, 3), dtype=kind)
        motion[:, :, 0] = np.outer(half_stretch, shear)
        motion[:, :, 1] = np.outer(half_stretch, shape_Y + turn) + np.outer(
            half_stretch * progress, bend
        )
        motion[:, :, 2] = np.outer(half_tilt, shape_Z)
        faces = EndFaces(self.side, self.zeta, self.across, 2 * half_stretch, 2 * half_tilt)
        for term in self.terms:
            motion = motion + values[term.parameter.name] * term.displacement(faces)
        return motion
