"""A prediction on cells of no size, from two meshes of hexahedra (Richardson's extrapolation).

Hexahedra of two sizes are meshes of one family, swept over the same section: their errors keep
their shape and fall with the power `ORDER` of the size (benchmarks/numerics.md). Tetrahedra of two
sizes are meshes of their own, and no such pair.
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

ORDER = 1.5
"""Power of the size with which the error of hexahedra falls."""
_LARGEST = 0.8  # ratio of sizes
_HEXAHEDRON = 20  # nodes
_INSET = 1e-6  # µm, by which nodes of an edge are drawn onto the face


def lacking_share(coarser: PrismMesh, finer: PrismMesh) -> float:
    """Share of what two meshes differ by that the finer one itself still lacks.

    0 for meshes of no family, and for one that is hardly finer.
    """
    nodes = {mesh.cells.shape[1] for mesh in (coarser, finer)}
    ratio: float = (len(coarser.cells) / len(finer.cells)) ** (1.0 / 3.0)
    if nodes != {_HEXAHEDRON} or ratio > _LARGEST:
        return 0.0
    fallen: float = ratio**ORDER
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
    share: float
    nodes: sp.csr_array

    def applied(self, finer: Prediction, coarser: Prediction) -> Prediction:
        """Return the prediction of the finer model, extrapolated with that of the coarser one.

        What is carried with the pixels stays that of the finer one alone.
        """
        d_surface = [
            self.extrapolated(one, apply(self.nodes, other))
            for one, other in zip(finer.d_surface, coarser.d_surface, strict=True)
        ]
        return replace(
            finer,
            surface=self.extrapolated(finer.surface, apply(self.nodes, coarser.surface)),
            load=self.extrapolated(finer.load, coarser.load),
            d_surface=np.array(d_surface).reshape(finer.d_surface.shape),
            d_load=self.extrapolated(finer.d_load, coarser.d_load),
        )

    def extrapolated(self, finer: FloatArray, coarser: FloatArray) -> FloatArray:
        """Return a field on cells of no size, from that of the finer and the coarser model."""
        return finer + self.share * (finer - coarser)


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
