"""Measurements behind the choice of the linear solver.

    export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
    python -m benchmarks.linear_solvers [--quick]

Times are CPU time, the best of several runs. cholespy is not a dependency: without it, or without
pypardiso, its lines are missing.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from meshes.arrays import FloatArray, IntArray
from meshes.gmsh_library import running_gmsh
from solver_adapters.bundled.linear.nested_dissection import elimination_order
from solver_adapters.bundled.linear.symmetric import SymmetricSolver
from solver_adapters.cholmod import cholmod, matrix, spmatrix

try:
    from pypardiso import PyPardisoSolver
except ImportError:
    PyPardisoSolver = None
try:
    import cholespy
except ImportError:
    cholespy = None

CUBIC = (233.5e3, 135.5e3, 118e3)
MESH_SIZES = (1.4, 1.0, 0.62, 0.43)
SMALLEST = 0.28  # µm, of the comparison of orders alone
N_RHS = 24


def prism(size: float) -> tuple[FloatArray, IntArray]:
    """Nodes (n, 3) [µm] and tet10 cells (m, 10), in the order of gmsh, of a 12 µm prism."""
    with running_gmsh() as gmsh:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        geometry = gmsh.model.occ
        corners = [geometry.addPoint(x, 0, z) for x, z in ((-2, 0), (2, 0), (0, -2 * np.sqrt(3)))]
        edges = [geometry.addLine(corners[i], corners[(i + 1) % 3]) for i in range(3)]
        face = geometry.addPlaneSurface([geometry.addCurveLoop(edges)])
        geometry.extrude([(2, face)], 0, 12, 0)
        geometry.synchronize()
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, connectivity = gmsh.model.mesh.getElementsByType(11)
    points = np.zeros((int(tags.max()) + 1, 3))
    points[tags] = coordinates.reshape(-1, 3)
    used, cells = np.unique(connectivity, return_inverse=True)
    return points[used], cells.reshape(-1, 10)


def _shape_gradients(xi: FloatArray) -> FloatArray:
    """Gradients (10, 3) of the tet10 shape functions at a point of the reference cell."""
    corner = np.array([1.0 - xi.sum(), *xi])
    gradient = np.vstack([-np.ones(3), np.eye(3)])
    edges = ((0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3))
    at_corners = [(4 * corner[i] - 1) * gradient[i] for i in range(4)]
    at_edges = [4 * (corner[i] * gradient[j] + corner[j] * gradient[i]) for i, j in edges]
    return np.array(at_corners + at_edges)


def stiffness(points: FloatArray, cells: IntArray, cubic: tuple[float, float, float]) -> Any:
    """Lower triangle (CSC) of the elastic stiffness [µN/µm] with both end faces fixed."""
    c11, c12, c44 = cubic
    elastic = np.diag([c11 - c12] * 3 + [c44] * 3)
    elastic[:3, :3] += c12
    local = np.zeros((len(cells), 30, 30))
    inner, outer = 0.1381966011250105, 0.5854101966249685  # the quadrature of degree 2
    for xi in np.vstack([np.zeros(3), (outer - inner) * np.eye(3)]) + inner:
        reference = _shape_gradients(xi)
        jacobian = np.einsum("eai,aj->eij", points[cells], reference)
        gradient = reference @ np.linalg.inv(jacobian)
        strain = np.zeros((len(cells), 6, 10, 3))
        for i in range(3):
            strain[:, i, :, i] = gradient[..., i]
        for row, (i, j) in enumerate(((0, 1), (1, 2), (0, 2)), start=3):
            strain[:, row, :, i] = gradient[..., j]
            strain[:, row, :, j] = gradient[..., i]
        b = strain.reshape(len(cells), 6, 30)
        weight = np.linalg.det(jacobian)[:, None, None] / 24
        local += np.swapaxes(b, 1, 2) @ (elastic @ b) * weight
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(-1, 30)
    rows, columns = np.repeat(dofs, 30, axis=1).ravel(), np.tile(dofs, (1, 30)).ravel()
    full = sp.coo_array((local.ravel(), (rows, columns)), shape=(points.size, points.size)).tocsc()
    free = unknowns(points)
    lower = sp.csc_array(sp.tril(full[free][:, free]))
    lower.sort_indices()
    return lower


def unknowns(points: FloatArray) -> IntArray:
    """Degrees of freedom 3·node + component that lie on neither end face."""
    return np.flatnonzero(np.repeat(np.abs(points[:, 1] - 6) < 6 - 1e-9, 3))


def _symmetric(lower: Any) -> Any:
    return (lower + lower.T - sp.diags_array(lower.diagonal())).tocsc()


class Candidate(Protocol):
    """A direct solver under test; one that splits off its symbolic part also has `symbolic`."""

    def __init__(self, lower: Any) -> None: ...

    def factor(self) -> None:
        """Numeric factorisation with new values (and the symbolic one, where it is not split)."""

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solution for (n, m) right-hand sides, without refinement."""


class Prismid:
    """`SymmetricSolver`: CHOLMOD with all overheads and the check of every residual."""

    def __init__(self, lower: Any) -> None:
        self.lower = lower
        self.symbolic()

    def symbolic(self) -> None:
        """Build the pattern and analyse it."""
        self.solver = SymmetricSolver(self.lower.indptr, self.lower.indices)

    def factor(self) -> None:
        """Factor."""
        self.solver.factor(self.lower.data)

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solve and check."""
        return self.solver.solve(rhs)


class Cvxopt:
    """CHOLMOD in cvxopt: supernodal L·Lᵀ, AMD or a given order, values set in a kept pattern."""

    def __init__(self, lower: Any, order: IntArray | None = None) -> None:
        n = lower.shape[0]
        columns = np.repeat(np.arange(n), np.diff(lower.indptr))
        rows = matrix(lower.indices.astype(np.int64))
        self.values = matrix(lower.data)
        self.matrix = spmatrix(1.0, rows, matrix(columns), (n, n))
        self.order = () if order is None else (matrix(order),)
        self.symbolic()

    def symbolic(self) -> None:
        """Analyse."""
        self.factors = cholmod.symbolic(self.matrix, *self.order)

    def factor(self) -> None:
        """Set the values and factor."""
        self.matrix.V = self.values
        cholmod.numeric(self.matrix, self.factors)

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solve."""
        solution = matrix(rhs)
        cholmod.solve(self.factors, solution)
        return np.asarray(solution)


class CvxoptSparse(Cvxopt):
    """The same as `Cvxopt`, right-hand sides passed as one sparse matrix without zeros."""

    rhs: Any = None

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solve in the blocks of columns that CHOLMOD forms."""
        n, m = rhs.shape
        if self.rhs is None or self.rhs.size != rhs.shape:
            rows, columns = np.tile(np.arange(n), m), np.repeat(np.arange(m), n)
            self.rhs = spmatrix(1.0, matrix(rows), matrix(columns), (n, m))
        self.rhs.V = matrix(rhs.ravel(order="F"))
        return np.asarray(cholmod.spsolve(self.factors, self.rhs).V).reshape(m, n).T


class Cholespy:
    """Cholespy (CHOLMOD simplicial), which keeps no symbolic part."""

    def __init__(self, lower: Any) -> None:
        full = _symmetric(lower)
        self.arguments = (
            full.shape[0],
            full.indptr.astype(np.int32),
            full.indices.astype(np.int32),
            full.data,
            cholespy.MatrixType.CSC,
        )

    def factor(self) -> None:
        """Analyse and factor."""
        self.solver = cholespy.CholeskySolverD(*self.arguments)

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solve."""
        solution = np.zeros_like(rhs)
        self.solver.solve(rhs, solution)
        return solution


class Pardiso:
    """PARDISO of MKL, mtype 2, METIS ordering, no refinement."""

    def __init__(self, lower: Any) -> None:
        self.solver = PyPardisoSolver(mtype=2)
        for index, value in ((1, 1), (2, 2), (8, 0), (35, 0)):
            self.solver.set_iparm(index, value)
        self.upper = sp.csr_matrix(lower.T)
        self.none = np.zeros((lower.shape[0], 1), order="F")
        self.symbolic()

    def _phase(self, phase: int, rhs: FloatArray) -> FloatArray:
        self.solver.set_phase(phase)
        solution: FloatArray = self.solver._call_pardiso(self.upper, rhs)
        return solution

    def symbolic(self) -> None:
        """Analyse."""
        self._phase(11, self.none)

    def factor(self) -> None:
        """Factor."""
        self._phase(22, self.none)

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solve."""
        return self._phase(33, np.asfortranarray(rhs))


class SuperLU:
    """SuperLU of SciPy in symmetric mode, which keeps no symbolic part."""

    def __init__(self, lower: Any) -> None:
        self.full = _symmetric(lower)

    def factor(self) -> None:
        """Analyse and factor."""
        self.factors = splu(
            self.full,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.01,
            options={"SymmetricMode": True},
        )

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solve."""
        solution: FloatArray = self.factors.solve(rhs)
        return solution


def _candidates() -> Iterator[tuple[str, type[Candidate]]]:
    yield "prismid", Prismid
    yield "cvxopt", Cvxopt
    yield "cvxopt-spsolve", CvxoptSparse
    if cholespy is not None:
        yield "cholespy", Cholespy
    if PyPardisoSolver is not None:
        yield "pardiso", Pardiso
    yield "superlu", SuperLU


def _milliseconds(work: Callable[[], Any], repeats: int) -> float:
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        work()
        best = min(best, time.process_time() - start)
    return 1e3 * best


def linear_solvers(quick: bool) -> None:
    """Time every candidate on elastic stiffnesses of growing size."""
    repeats = 3 if quick else 9
    for size in MESH_SIZES[:2] if quick else MESH_SIZES:
        points, cells = prism(size)
        lower = stiffness(points, cells, CUBIC)
        full, n = _symmetric(lower), lower.shape[0]
        print(f"\n# {len(cells)} tets, {n} unknowns, {lower.nnz} entries")
        rhs = np.random.default_rng(0).normal(size=(n, N_RHS))
        single = rhs[:, :1].copy()
        factor_times = {}
        for name, kind in _candidates():
            candidate = kind(lower)
            symbolic = getattr(candidate, "symbolic", None)
            if symbolic is not None:
                print(f"symbolic {name} [ms] = {_milliseconds(symbolic, 3):.2f}")
            factor_times[name] = _milliseconds(candidate.factor, repeats)
            print(f"factor {name} [ms] = {factor_times[name]:.2f}")
            for count, columns in ((1, single), (N_RHS, rhs)):
                elapsed = _milliseconds(partial(candidate.solve, columns), repeats)
                print(f"solve {count} rhs {name} [ms] = {elapsed:.2f}")
            residual = np.linalg.norm(full @ candidate.solve(rhs) - rhs) / np.linalg.norm(rhs)
            print(f"residual {name} [-] = {residual:.0e}")
        for name, elapsed in factor_times.items():
            print(f"factor {name} / cvxopt = {elapsed / factor_times['cvxopt']:.1f}")


def orders(quick: bool) -> None:
    """Compare entries of the factor, and its time, by minimum degree and by nested dissection."""
    for size in MESH_SIZES[:2] if quick else (*MESH_SIZES, SMALLEST):
        points, cells = prism(size)
        lower, free = stiffness(points, cells, CUBIC), unknowns(points)
        print(f"\n# {len(cells)} tets, {free.size} unknowns")
        dissected = _milliseconds(partial(elimination_order, cells, free), 3)
        print(f"order of elimination by nested dissection [ms] = {dissected:.1f}")
        for name, order in (
            ("minimum degree", None),
            ("the better of it and nested dissection", elimination_order(cells, free)),
        ):
            solver = Cvxopt(lower, order)
            elapsed = _milliseconds(solver.factor, 3)
            entries = len(cholmod.getfactor(solver.factors)) / 1e6
            print(f"factor by {name} [ms] = {elapsed:.1f}, entries [millions] = {entries:.2f}")


def cholmod_and_threads(quick: bool) -> None:
    """Whether a factorisation lets other Python threads run, and whether it uses more than one."""
    solver = Cvxopt(stiffness(*prism(MESH_SIZES[1 if quick else 2]), CUBIC))
    count, running = 0, True

    def counting() -> None:
        nonlocal count
        while running:
            count += 1

    thread = threading.Thread(target=counting)
    thread.start()
    start, before = time.perf_counter(), count
    time.sleep(0.5)
    rate = (count - before) / (time.perf_counter() - start)
    start, before = time.perf_counter(), count
    solver.factor()
    share = (count - before) / (time.perf_counter() - start) / rate
    running = False
    thread.join()
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(5):
        solver.factor()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    print("\n# threads")
    print(f"speed of another Python thread during factor cvxopt [-] = {share:.2f}")
    print(f"CPU / wall time of factor cvxopt [-] = {cpu / wall:.2f}")


def attainable_residual() -> None:
    """How small a residual rounding allows when shear is soft against bulk (plastic flow)."""
    points, cells = prism(MESH_SIZES[0])
    bulk = 1.7e5
    print("\n# attainable residual, two refinements, uniform force along the axis")
    for shear in (1e5, 1e3, 1e2, 1e1, 1e0):
        lower = stiffness(points, cells, (bulk + 4 / 3 * shear, bulk - 2 / 3 * shear, shear))
        solver, full = Cvxopt(lower), _symmetric(lower)
        solver.factor()
        rhs = np.tile([[0.0], [1.0], [0.0]], (lower.shape[0] // 3, 1))
        solution = np.zeros_like(rhs)
        for _ in range(3):
            solution = solution + solver.solve(rhs - full @ solution)
        residual = np.linalg.norm(rhs - full @ solution) / np.linalg.norm(rhs)
        eigenvalues = np.linalg.eigvalsh(full.toarray())
        condition = eigenvalues[-1] / eigenvalues[0]
        print(f"residual at condition {condition:.0e} [-] = {residual:.0e}")


def main() -> int:
    """Run all measurements."""
    parser = argparse.ArgumentParser(description="Measurements behind the linear solver.")
    parser.add_argument("--quick", action="store_true", help="two small meshes, few repeats")
    quick = parser.parse_args().quick
    linear_solvers(quick)
    orders(quick)
    cholmod_and_threads(quick)
    attainable_residual()
    return 0


if __name__ == "__main__":
    sys.exit(main())
