"""Refusal of meshes that no solver could run."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from meshes.arrays import AnyArray
from meshes.cells import EDGES, inverted_cells
from meshes.prism_mesh import PrismMesh
from solver_adapters.checks.arrays import (
    expect_array,
    expect_finite,
    expect_indices,
    expect_integers,
    expect_shape,
)
from solver_adapters.interface import BadSimulationError, UnsupportedError

_NODE_GROUPS = ("S_PLUS", "S_MINUS")


def refuse_bad_mesh(mesh: PrismMesh) -> None:
    """Raise where a mesh is broken, or of cells that are not known.

    Raises:
        BadSimulationError: what was found, and what was expected.
    """
    expect_shape("mesh.points", mesh.points, (None, 3))
    expect_finite("mesh.points", mesh.points)
    cells, n_nodes = mesh.cells, len(mesh.points)
    expect_array("mesh.cells", cells)
    if cells.ndim != 2 or cells.shape[1] not in EDGES or not len(cells):
        raise UnsupportedError(
            f"mesh.cells has shape {cells.shape}; expected (n, 10) for tet10 or (n, 20) for "
            "hex20, with one cell or more"
        )
    expect_indices("mesh.cells", cells, n_nodes, "nodes")
    expect_shape("mesh.grain", mesh.grain, (len(cells),))
    expect_integers("mesh.grain", mesh.grain)
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
        expect_shape(f"mesh.nodes[{name!r}]", nodes, (None,))
        expect_indices(f"mesh.nodes[{name!r}]", nodes, n_nodes, "nodes")
        # The force on a face is a sum over its nodes.
        doubled = twice(nodes)
        if doubled.size:
            raise BadSimulationError(
                f"the group {name} of mesh.nodes holds node {doubled[0]} twice; "
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


def twice(nodes: AnyArray) -> AnyArray:
    """Return the nodes that are listed more than once."""
    unique, count = np.unique(nodes, return_counts=True)
    return unique[count > 1]
