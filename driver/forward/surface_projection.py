"""The measured face as the pixels see it: nodal fields of a mesh at fixed places in space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from meshes.arrays import FloatArray
from meshes.surface import SurfaceMesh, interpolation_with_slopes

_INSET = 2e-3  # pixels stay this far inside the face, for beyond its rim no cell holds them [µm]


@dataclass(frozen=True, eq=False)
class Projection:
    """Operators from nodes of the face to pixels, each of shape (n_pix, n_nodes).

    Attributes:
        value: nodal values → values at the pixels.
        slope_X, slope_Y: nodal values → derivatives along X and Y [1/µm].
    """

    value: sp.csr_array
    slope_X: sp.csr_array
    slope_Y: sp.csr_array


@dataclass(frozen=True, eq=False)
class PixelProjection:
    """Where the pixels are.

    Attributes:
        surface: the face of the mesh as drawn.
        pixels: X, Y of the pixels as the case says [µm], shape (n_pix, 2).
        bounds: extent (x0, x1, y0, y1) of the face [µm].
    """

    surface: SurfaceMesh
    pixels: FloatArray
    bounds: tuple[float, float, float, float]

    def at(self, points: FloatArray, values: Mapping[str, float]) -> Projection:
        """Operators for nodes of the face at `points` (n_nodes, 2) and the pose in `values`."""
        surface = SurfaceMesh(points, self.surface.cells, self.surface.nodes)
        x0, x1, y0, y1 = self.bounds
        places = np.clip(
            self.pixels + np.array([values["origin_X"], values["origin_Y"]]),
            [x0 + _INSET, y0 + _INSET],
            [x1 - _INSET, y1 - _INSET],
        )
        return Projection(*interpolation_with_slopes(surface, places))


def apply(operator: sp.csr_array, nodal: FloatArray) -> FloatArray:
    """Apply an operator to a history of nodal vectors, (T, n_nodes, 3) → (T, n_pix, 3)."""
    T, n, _ = nodal.shape
    flat = operator @ nodal.transpose(1, 0, 2).reshape(n, 3 * T)
    return np.ascontiguousarray(flat.reshape(-1, T, 3).transpose(1, 0, 2))
