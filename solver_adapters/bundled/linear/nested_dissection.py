"""The order in which unknowns are eliminated, by nested dissection of the mesh (METIS).

It cuts the mesh in halves again and again and eliminates the cuts last (George, SIAM J. Numer.
Anal. 10 (1973) 345; Karypis and Kumar, SIAM J. Sci. Comput. 20 (1998) 359). Of solids it leaves a
factor with fewer entries than minimum degree does, the more so the more cells there are
(benchmarks/numerics.md).
"""

from __future__ import annotations

from signal import SIGABRT, SIGTERM, raise_signal

import numpy as np
import scipy.sparse as sp
from pymetis import CSRAdjacency, nested_dissection

from meshes.arrays import IntArray
from meshes.kept_signals import signals_kept


def elimination_order(cells: IntArray, free: IntArray) -> IntArray:
    """Return a permutation of the unknowns, the one that is eliminated first before all others.

    Args:
        cells: nodes of each cell, shape (n_cells, n).
        free: the unknowns as degrees of freedom 3·node + component, shape (n_free,).

    Returns:
        Places in `free`, shape (n_free,); those of one node follow each other.
    """
    if free.size == 0:
        return np.empty(0, dtype=np.int64)  # METIS would end the process
    nodes, node_of = np.unique(free // 3, return_inverse=True)
    starts = np.arange(0, cells.size + 1, cells.shape[1])
    shape = len(cells), max(cells.max(), nodes.max()) + 1
    of_cells = sp.csr_array((np.ones(cells.size), cells.ravel(), starts), shape)
    of_cells = of_cells[:, nodes]
    neighbours = (of_cells.T @ of_cells).tocsr()
    neighbours.setdiag(0.0)
    neighbours.eliminate_zeros()
    first = _ordered(CSRAdjacency(neighbours.indptr, neighbours.indices))
    place = np.empty(nodes.size, dtype=np.int64)
    place[first] = np.arange(nodes.size)
    return np.argsort(place[node_of], kind="stable")


def _ordered(graph: CSRAdjacency) -> IntArray:
    """Nodes in the order of their elimination; a SIGTERM that METIS traps comes afterwards."""
    try:
        return _dissected(graph)
    except RuntimeError:  # all that is told of a signal
        first = _dissected(graph)
        raise_signal(SIGTERM)
        return first


def _dissected(graph: CSRAdjacency) -> IntArray:
    with signals_kept((SIGABRT, SIGTERM)):
        first, _ = nested_dissection(graph)
    return np.array(first, dtype=np.int64)
