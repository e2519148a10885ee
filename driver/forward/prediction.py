"""What images and load cell should show, with its derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.forward.surface_projection import Projection, apply
from meshes.arrays import FloatArray
from solver_adapters.interface import Response


@dataclass(frozen=True, eq=False)
class Prediction:
    """What the model expects, T images, n surface nodes, k free parameters.

    Attributes:
        surface: motion of the surface nodes as the images show it [µm], shape (T, n, 3).
        load: load reading [µN], shape (T,).
        d_surface: derivative for each free parameter, shape (k, T, n, 3).
        d_load: derivative of the load, shape (k, T).
        carried: what the images see besides, where a parameter moves the surface under the
            pixels: derivative of the motion at the pixels by index of the parameter,
            each of shape (T, n_pix, 3).
        projection: operators from the nodes to the pixels.
        rise: by how much the surface seems to rise at the pixels besides [µm], shape (T, n_pix),
            or 0.
        response: statistics and raw fields of the solver.
    """

    surface: FloatArray
    load: FloatArray
    d_surface: FloatArray
    d_load: FloatArray
    carried: Mapping[int, FloatArray]
    projection: Projection
    response: Response
    rise: FloatArray | float = 0.0

    def restrict(self, rows: Sequence[int]) -> Prediction:
        """Return prediction with the derivatives of some of its parameters, in the given order."""
        carried = {new: self.carried[old] for new, old in enumerate(rows) if old in self.carried}
        return replace(
            self, d_surface=self.d_surface[rows], d_load=self.d_load[rows], carried=carried
        )

    def joined(self, other: Prediction) -> Prediction:
        """Append the derivatives of another prediction at the same values."""
        n = len(self.d_load)
        return replace(
            self,
            d_surface=np.concatenate([self.d_surface, other.d_surface]),
            d_load=np.concatenate([self.d_load, other.d_load]),
            carried={**self.carried, **{n + row: c for row, c in other.carried.items()}},
        )

    def derivatives_alone(self) -> Prediction:
        """Return the prediction without what is large and of no derivative."""
        none = self.response.d_displacement[:0]
        response = replace(self.response, d_displacement=none, cells=None, trajectory=None)
        return replace(self, response=response)

    def with_derivatives_times(self, motion: float, load: float) -> Prediction:
        """Return the prediction with its derivatives of motion and load times factors."""
        if motion == load == 1.0:
            return self
        return replace(
            self,
            d_surface=motion * self.d_surface,
            d_load=load * self.d_load,
            carried={row: motion * carried for row, carried in self.carried.items()},
        )

    def along(self, change: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Change of the prediction with its parameters, to first order.

        Args:
            change: of each parameter, shape (k,).

        Returns:
            Motion at the pixels [µm], shape (T, n_pix, 3), and load [µN], shape (T,).
        """
        motion = apply(self.projection.value, np.tensordot(change, self.d_surface, 1))
        for row, carried in self.carried.items():
            motion += change[row] * carried
        return motion, change @ self.d_load

    @property
    def motion(self) -> FloatArray:
        """Motion at the pixels [µm], shape (T, n_pix, 3)."""
        motion = apply(self.projection.value, self.surface)
        motion[..., 2] += self.rise
        return motion
