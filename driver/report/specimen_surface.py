"""The surface of the specimen as a page turns it: triangles by grain, edges of cells and grains."""

from __future__ import annotations

import numpy as np

from driver.report.maps import boundary_edges
from meshes.arrays import FloatArray
from meshes.cells import outer_faces
from meshes.prism_mesh import PrismMesh

MOST_NODES = 32_000
"""Corners beyond which the surface is left to the picture."""
_STEP = 1e-3  # µm, to which places are rounded
_SLIP = 1e-3  # %, to which slips are rounded


def specimen_surface(
    mesh: PrismMesh, slip: FloatArray | None = None
) -> dict[str, tuple[FloatArray, float]] | None:
    """Arrays of the surface with the step to which each is rounded, None of one that is too large.

    Args:
        mesh: the mesh.
        slip: accumulated slip of each cell [%], shape (n_cells,), or None.

    Returns:
        "points": corners [µm], shape (n, 3); "triangles": corners of each, shape (m, 3);
        "grain": of each triangle, shape (m,); "edges": ends of the edges of cells, shape (e, 2);
        "boundary": ends of the edges between grains, shape (b, 2); "slip" of each triangle [%],
        shape (m,), where it is given.
    """
    outer, owner = outer_faces(mesh.cells)
    n_corners = outer.shape[1] // 2
    nodes, place = np.unique(outer[:, :n_corners], return_inverse=True)
    if nodes.size > MOST_NODES:
        return None
    faces, grain = np.asarray(place).reshape(-1, n_corners), mesh.grain[owner]
    # A quadrilateral is two triangles.
    corners = [faces[:, [0, k, k + 1]] for k in range(1, n_corners - 1)]
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    arrays = {
        "triangles": np.concatenate(corners),
        "grain": np.tile(grain, len(corners)),
        "edges": np.unique(np.sort(edges, axis=1), axis=0),
        "boundary": boundary_edges(faces, grain),
    }
    whole = {name: (array.astype(np.float64), 1.0) for name, array in arrays.items()}
    painted = {} if slip is None else {"slip": (np.tile(slip[owner], len(corners)), _SLIP)}
    return {"points": (mesh.points[nodes], _STEP)} | whole | painted
