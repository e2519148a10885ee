"""The linear systems of a run: assembled from the tangents of the points, solved as suits the law.

Symmetric laws keep two factors, one of the last move and one of the last hold: a tangent of the
same kind is so near that conjugate gradients need few iterations from it. Of many unknowns one is
kept, for that saves memory and costs hardly any time.
"""

from __future__ import annotations

import time

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.fem.assembly import add_projected_stiffness, element_stiffness
from solver_adapters.bundled.fem.problem import Problem
from solver_adapters.bundled.linear.nested_dissection import elimination_order
from solver_adapters.bundled.linear.split_matrix import RESIDUAL
from solver_adapters.bundled.linear.symmetric import SymmetricSolver
from solver_adapters.bundled.linear.unsymmetric import UnsymmetricSolver
from solver_adapters.bundled.statistics import Statistics

MOST_WITH_TWO = 30_000
"""Unknowns up to which two factors are kept: of more each takes 0.15 GB and upwards.

On 31 488 unknowns a run with one takes as long as with two, on 4 000 a twentieth to a tenth longer.
"""


class TangentSystem:
    """Tangent stiffness on the free degrees of freedom."""

    def __init__(self, problem: Problem, statistics: Statistics) -> None:
        self._problem = problem
        self._statistics = statistics
        pattern = problem.pattern
        shape = pattern.indptr, pattern.indices, elimination_order(problem.cells, pattern.free)
        self._unsymmetric = problem.points.unsymmetric
        self._skew: UnsymmetricSolver | None = None
        self._symmetric: tuple[SymmetricSolver, ...] = ()  # of holds and of moves
        if self._unsymmetric:
            self._skew = UnsymmetricSolver(*shape)
        else:
            of_holds = SymmetricSolver(*shape)
            few = pattern.free.size <= MOST_WITH_TWO
            self._symmetric = of_holds, SymmetricSolver(*shape) if few else of_holds
        self._moves = False
        # Memory that is used again, since fresh memory has to be cleared.
        self._triangles = np.empty(pattern.slots.shape)
        small = problem.points.strain_measure == "small"
        self._dilatation = None if small else problem.dilatation
        self._projected = small and problem.dilatation is not None
        self._constant: FloatArray | None = None

    def assemble(self, C: FloatArray, moves: bool, columns: int = 0) -> None:
        """Take the tangents (n_points, 9, 9) of a move or of a hold.

        columns: right-hand sides that are to be solved for, which want a new factor; 0 for one of
            Newton's method, which may do without.

        Raises:
            LinearSolverError: the matrix is singular or not finite.
        """
        clock = time.perf_counter()
        values = self._problem.pattern.values(self._stiffness(C, 1 if self._skew else 0))
        if self._projected:
            if self._constant is None:
                self._constant = self._projected_stiffness(C)
            values += self._constant
        self._moves = moves
        if self._skew:
            skew = self._problem.pattern.antisymmetric_values(self._stiffness(C, -1))
            clock = self._statistics.clock("assembly", clock)
            self._skew.factor(values, skew, max(columns, 1))
        else:
            clock = self._statistics.clock("assembly", clock)
            solver = self._symmetric[self._moves]
            if columns:
                solver.factor(values)
            else:
                solver.update(values)
        self._statistics.clock("factorisation", clock)

    def _stiffness(self, C: FloatArray, part: int) -> FloatArray:
        p = self._problem
        element_stiffness(C, p.gradients, p.weights, self._triangles, part, self._dilatation)
        return self._triangles

    def _projected_stiffness(self, C: FloatArray) -> FloatArray:
        """Return what the projection of the dilatation adds to the matrix in small strain.

        Slip keeps the volume there: C R, all that it depends on, is that of elasticity.
        """
        p = self._problem
        assert p.dilatation is not None
        self._triangles[:] = 0.0
        add_projected_stiffness(C, p.gradients, p.weights, self._triangles, 0, p.dilatation)
        return p.pattern.values(self._triangles)

    def solve(self, rhs: FloatArray, accuracy: float = RESIDUAL) -> FloatArray:
        """Solution for right-hand sides (n_free,) or (n_free, m).

        Raises:
            LinearSolverError: no solution passes the check of its residual.
        """
        clock = time.perf_counter()
        solver = self._skew or self._symmetric[self._moves]
        solution = solver.solve(rhs, accuracy)
        self._statistics.clock("solution", clock)
        return solution
