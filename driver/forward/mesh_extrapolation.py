"""A prediction on cells of no size, from two meshes of hexahedra (Richardson's extrapolation).

Hexahedra of two sizes are meshes of one family, swept over the same section: their errors fall
with a power of the size (benchmarks/numerics.md). The error of the load keeps its shape, that of
the motion of the face does so in part. Tetrahedra of two sizes are meshes of their own, and no such
pair.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from driver.forward.prediction import Prediction
from driver.forward.surface_projection import apply
from meshes.arrays import FloatArray
from meshes.prism_mesh import PrismMesh
from meshes.surface import interpolation, trace

if TYPE_CHECKING:
    from driver.forward.model import ForwardModel

ORDER_OF_MOTION = 1.5
"""Power of the size by which the motion of the face is extrapolated."""
ORDER_OF_LOAD = 1.25
"""Power of the size by which the load is extrapolated: it leaves least (benchmarks/numerics.md)."""
_LARGEST = 0.8  # ratio of sizes
_HEXAHEDRON = 20  # nodes
_INSET = 1e-6  # µm, by which nodes of an edge are drawn onto the face


@dataclass(frozen=True)
class LackingShare:
    """Share of what two meshes differ by that the finer one itself still lacks.

    Attributes:
        motion: of the motion of the face.
        load: of the load.
    """

    motion: float = 0.0
    load: float = 0.0

    def __bool__(self) -> bool:
        """Return whether anything is known to be lacking."""
        return self.motion != 0.0 or self.load != 0.0


def lacking_share(coarser: PrismMesh, finer: PrismMesh) -> LackingShare:
    """Return what the finer one of two meshes lacks.

    Nothing for meshes of no family, and for one that is hardly finer.
    """
    nodes = {mesh.cells.shape[1] for mesh in (coarser, finer)}
    ratio: float = (len(coarser.cells) / len(finer.cells)) ** (1.0 / 3.0)
    if nodes != {_HEXAHEDRON} or ratio > _LARGEST:
        return LackingShare()
    return LackingShare(_lacking(ratio, ORDER_OF_MOTION), _lacking(ratio, ORDER_OF_LOAD))


def _lacking(ratio: float, order: float) -> float:
    """Return the share of a difference that is left where an error falls with a power of sizes."""
    fallen: float = ratio**order
    return fallen / (1.0 - fallen)


@dataclass(frozen=True, eq=False)
class MeshExtrapolation:
    """What a prediction is extrapolated with.

    Attributes:
        coarser: the model on the larger cells.
        share: of the difference of both that is added.
        nodes: from the surface nodes of the coarser mesh to those of the finer one.
    """

    coarser: ForwardModel
    share: LackingShare
    nodes: sp.csr_array

    def applied(self, finer: Prediction, coarser: Prediction) -> Prediction:
        """Return the prediction of the finer model, extrapolated with that of the coarser one.

        What is carried with the pixels stays that of the finer one alone.
        """
        d_surface = [
            self.motion(one, other)
            for one, other in zip(finer.d_surface, coarser.d_surface, strict=True)
        ]
        return replace(
            finer,
            surface=self.motion(finer.surface, coarser.surface),
            load=self.load(finer.load, coarser.load),
            d_surface=np.array(d_surface).reshape(finer.d_surface.shape),
            d_load=self.load(finer.d_load, coarser.d_load),
        )

    def motion(self, finer: FloatArray, coarser: FloatArray) -> FloatArray:
        """Return the motion of the finer model's nodes with cells of no size, (T, n, 3) [µm].

        Args:
            finer: as that model has it.
            coarser: of the nodes of the coarser one.
        """
        return finer + self.share.motion * (finer - apply(self.nodes, coarser))

    def load(self, finer: FloatArray, coarser: FloatArray) -> FloatArray:
        """Return the load with cells of no size, (..., T) [µN]."""
        return finer + self.share.load * (finer - coarser)


def extrapolated_with(finer: ForwardModel, coarser: ForwardModel) -> ForwardModel:
    """Return the finer model, its predictions extrapolated with those of a coarser one.

    Args:
        finer: the model.
        coarser: the same on hexahedra that are larger.
    """
    meshes = coarser.microstructure.mesh, finer.microstructure.mesh
    surfaces = [trace(mesh) for mesh in meshes]
    points = surfaces[0].points
    low, high = points.min(axis=0) + _INSET, points.max(axis=0) - _INSET
    nodes, inside = interpolation(surfaces[0], np.clip(surfaces[1].points, low, high))
    assert inside.all()
    pair = MeshExtrapolation(coarser, lacking_share(*meshes), nodes)
    return replace(finer, extrapolation=pair)
