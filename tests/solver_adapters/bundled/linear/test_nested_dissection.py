"""The order of elimination holds every unknown once, and fills less than minimum degree does."""

from __future__ import annotations

import numpy as np
import pytest

from meshes.arrays import FloatArray, IntArray
from meshes.prism_mesh import PrismMesh
from solver_adapters.bundled.fem.assembly import Pattern, stiffness_pattern
from solver_adapters.bundled.linear import nested_dissection as module
from solver_adapters.bundled.linear.nested_dissection import elimination_order
from solver_adapters.cholesky import Cholesky
from solver_adapters.cholmod import cholmod, matrix, spmatrix
from tests.support.waiting import hears_as_it_waits, said_by
from tools.boxes import box, hex_box


def _pattern(cells: IntArray, n_nodes: int) -> Pattern:
    """Of a box whose first nodes are held, and a further one along X."""
    held = np.zeros(3 * n_nodes, dtype=np.bool_)
    held[:12], held[15] = True, True
    return stiffness_pattern(cells, held)


def _values(pattern: Pattern) -> FloatArray:
    """A diagonally dominant matrix."""
    rng = np.random.default_rng(0)
    values = rng.uniform(-1.0, 0.0, pattern.nnz)
    values[pattern.indptr[:-1]] = 400.0
    return values


@pytest.mark.parametrize("mesh", [box((2, 3, 2)), hex_box((2, 3, 2))], ids=["tet10", "hex20"])
def test_every_unknown_is_eliminated_once_beside_those_of_its_node(mesh: PrismMesh) -> None:
    pattern = _pattern(mesh.cells, len(mesh.points))
    order = elimination_order(mesh.cells, pattern.free)
    np.testing.assert_array_equal(np.sort(order), np.arange(pattern.free.size))
    nodes = pattern.free[order] // 3
    changes = np.count_nonzero(np.diff(nodes))
    assert changes == np.unique(nodes).size - 1
    np.testing.assert_array_equal(order, elimination_order(mesh.cells, pattern.free))


@pytest.mark.parametrize("free", [[], [4], [0, 1, 2], [0, 12, 13], [0, 18]])
def test_few_unknowns_or_none_have_an_order(free: list[int]) -> None:
    """None, one, those of one node, of two that share no cell, and of one that is in no cell."""
    cells = np.array([[0, 1, 2, 3], [4, 1, 2, 3]])
    order = elimination_order(cells, np.array(free, dtype=np.int64))
    np.testing.assert_array_equal(np.sort(order), np.arange(len(free)))


def test_an_order_that_fills_more_than_minimum_degree_is_not_taken() -> None:
    mesh = hex_box((3, 5, 3))
    pattern = _pattern(mesh.cells, len(mesh.points))
    entries = [
        _entries(pattern, *order)
        for order in ((), (matrix(np.random.default_rng(0).permutation(pattern.free.size)),))
    ]
    assert entries[1] == entries[0]


def test_a_solution_does_not_hang_on_the_order_of_elimination() -> None:
    mesh = hex_box((6, 12, 6))
    pattern = _pattern(mesh.cells, len(mesh.points))
    rhs = np.random.default_rng(1).normal(size=(pattern.free.size, 5))
    solutions = []
    for order in (None, elimination_order(mesh.cells, pattern.free)):
        cholesky = Cholesky(pattern.indptr, pattern.indices, order)
        cholesky.values[:] = _values(pattern)
        assert cholesky.factor()
        solutions.append(cholesky.solve(rhs))
    largest = np.abs(solutions[0]).max()
    np.testing.assert_allclose(solutions[1], solutions[0], rtol=0.0, atol=1e-12 * largest)
    assert (solutions[1] != solutions[0]).any(), "minimum degree was taken in its place"


def _entries(pattern: Pattern, *order: matrix) -> int:
    """Stored numbers of the factor."""
    n = pattern.free.size
    columns = np.repeat(np.arange(n), np.diff(pattern.indptr))
    lower = spmatrix(matrix(_values(pattern)), matrix(pattern.indices), matrix(columns), (n, n))
    factor = cholmod.symbolic(lower, *order)
    cholmod.numeric(lower, factor)
    return len(cholmod.getfactor(factor))


def test_the_factor_of_a_solid_has_a_sixth_fewer_entries_than_by_minimum_degree() -> None:
    mesh = hex_box((8, 16, 8))
    pattern = _pattern(mesh.cells, len(mesh.points))
    dissected = _entries(pattern, matrix(elimination_order(mesh.cells, pattern.free)))
    assert dissected < 5 / 6 * _entries(pattern)


ORDER = """
import numpy as np
from solver_adapters.bundled.linear.nested_dissection import elimination_order

elimination_order(np.arange(24).reshape(3, 8), np.arange(72))
"""


@pytest.mark.parametrize("name", ["SIGTERM", "SIGABRT"])
def test_a_process_that_has_ordered_hears_of_a_signal_as_it_waits_for_others(name: str) -> None:
    """As a diagnosis does whose processes are at work: SIGTERM came to nothing until one ended."""
    assert hears_as_it_waits(ORDER, name)


INTERRUPTED = """
import os, signal, time
import numpy as np
import solver_adapters.bundled.linear.nested_dissection as module
from tools.boxes import hex_box

heard, tries = [], []
signal.signal(signal.SIGTERM, lambda *_: heard.append("heard"))
dissected = module.nested_dissection

def timed(graph):
    tries.append(time.monotonic())
    return dissected(graph)

module.nested_dissection = timed
mesh = hex_box((14, 14, 14))
free = np.arange(3 * len(mesh.points))
order = module.elimination_order(mesh.cells, free)
took, asker = time.monotonic() - tries.pop(), os.getpid()

def told(graph):
    if not tries:
        os.write(writer, b"x")
    return timed(graph)

module.nested_dissection = told
for share in (0.2, 0.1, 0.4, 0.05):  # on a busy machine it may come when METIS has ended
    tries, heard[:] = [], []
    reader, writer = os.pipe()
    if not os.fork():
        os.read(reader, 1)
        time.sleep(share * took)
        os.kill(asker, signal.SIGTERM)
        os._exit(0)
    again = module.elimination_order(mesh.cells, free)
    os.wait()
    if len(tries) == 2:
        break
print(len(tries), np.array_equal(order, again), *heard)
"""


def test_a_signal_that_comes_while_metis_orders_is_heard_once_it_has() -> None:
    """METIS traps it, leaves it blocked, and the binding tells of an unknown error."""
    assert said_by(INTERRUPTED) == (0, "2 True heard\n")


def test_what_metis_refuses_twice_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(graph: object) -> None:
        raise RuntimeError("no memory")

    monkeypatch.setattr(module, "nested_dissection", refused)
    with pytest.raises(RuntimeError, match="no memory"):
        elimination_order(np.arange(24).reshape(3, 8), np.arange(72))
