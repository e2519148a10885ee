"""Solving with a regularisation that the images themselves ask for."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array

from driver.common.splines.images import variance_gain
from driver.dic.basis import Basis
from driver.dic.kernels import motion_of
from driver.dic.regularisation import Penalty, penalties, ranks
from driver.dic.regularisation_evidence import Evidence, NoiseAndRoughness, weigh
from driver.dic.system import End, Pixels, System
from driver.experiment.images.heightmaps import ImageError

FloatArray = NDArray[np.float64]

FIRST_ROUGHNESS = 1.0  # px; where the estimate of what the motion needs begins
FIRST_ROUGHNESS_W, FIRST_NOISE = 0.1, 0.05  # of the relief
COARSE = 3e-2  # px; largest update at the end of a step of the ramp, or before the estimate


@dataclass(frozen=True)
class Options:
    """How a correlation is regularised and ended.

    Attributes:
        penalty: what is penalised of u, v: "tikhonov" (second derivatives), "equilibrium_gap"
            (nodal forces inside an elastic sheet) or "elastic" (its energy). None takes the first
            on grids and the second on other meshes.
        roughness: standard deviation granted to what is penalised [px]: inf for no penalty; None
            for the value that makes the images most probable.
        roughness_w: the same for the second differences (or the Laplacian) of w, in the unit of
            the images.
        ramp: weights of |p − start|², relative to the mean diagonal of the Hessian, solved in
            turn. The last one stays and biases towards the start, whose own noise the covariance
            leaves out: end with 0 for neither.
        tolerance: largest nodal update of u, v at convergence [px].
        workers: threads over the images; the result does not depend on it.
    """

    penalty: Penalty | None = None
    roughness: float | None = None
    roughness_w: float | None = None
    ramp: tuple[float, ...] = ()
    tolerance: float = 1e-3
    workers: int = 1

    def __post_init__(self) -> None:
        for name in ("roughness", "roughness_w"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ImageError(f"{name} = {value}; a positive number, inf or None is expected.")
        if any(not weight >= 0 for weight in self.ramp):
            raise ImageError(f"ramp = {self.ramp}; weights of 0 or more are expected.")
        if not self.tolerance > 0 or self.workers < 1:
            raise ImageError(
                f"tolerance = {self.tolerance}, workers = {self.workers}; "
                "a positive tolerance and at least 1 worker are expected."
            )


@dataclass(frozen=True, eq=False)
class Search:
    """Solve, estimate noise and roughness from what is found, solve again."""

    pixels: Pixels
    basis_uv: Basis
    basis_w: Basis
    options: Options
    sigma: float | None
    n_reference: int
    splines: list[FloatArray]
    pool: ThreadPoolExecutor | None

    def run(self, starts: list[FloatArray]) -> tuple[System, list[End], NoiseAndRoughness]:
        """Return ends of all images, with the system that led to them and what it assumed."""
        options = self.options
        relief = float(np.std(self.pixels.height))
        estimate = NoiseAndRoughness(
            sigma=self.sigma or FIRST_NOISE * relief,
            roughness=self.pixels.pixel * (options.roughness or FIRST_ROUGHNESS),
            roughness_w=options.roughness_w or FIRST_ROUGHNESS_W * relief,
        )
        free = (options.roughness is None, options.roughness_w is None)
        *ramp, anchor = options.ramp or (0.0,)
        system = self._system(any(options.ramp))
        for weight in ramp:
            weigh(system, estimate, self.n_reference, weight)
            starts = [end.p for end in self._solve(system, starts, starts, COARSE)]
        weigh(system, estimate, self.n_reference, anchor)
        unsettled = any(free) or (self.sigma is None and any(system.weights[:2]))
        ends = self._solve(system, starts, starts, COARSE if unsettled else options.tolerance)
        if unsettled:
            targets = np.array([end.target for end in ends])
            rank = ranks(self.basis_uv, self.basis_w, options.penalty)
            evidence = Evidence(system, targets, anchor, rank, free, self.n_reference)
            p = np.array([end.p for end in ends])
            estimate, p = evidence.settle(p, estimate, self.sigma or self._noise(system, ends))
            ends = self._solve(system, list(p), starts, options.tolerance)
        return system, ends, replace(estimate, sigma=self.sigma or self._noise(system, ends))

    def _system(self, anchored: bool) -> System:
        parts = penalties(self.basis_uv, self.basis_w, self.options.penalty)
        system = System(self.pixels, self.basis_uv, self.basis_w, parts)
        if not anchored:
            return system
        diagonal = mean_diagonals(system)
        dense = isinstance(parts[0], np.ndarray)
        anchor = np.diag(diagonal) if dense else csc_array(diags_array(diagonal))
        return System(self.pixels, self.basis_uv, self.basis_w, [*parts, anchor])

    def _solve(
        self,
        system: System,
        starts: list[FloatArray],
        anchors: list[FloatArray],
        tolerance: float,
    ) -> list[End]:
        def one(spline: FloatArray, start: FloatArray, anchor: FloatArray) -> End:
            pull: FloatArray | float = 0.0
            if len(system.parts) > 2:
                pull = system.weights[2] * (system.parts[2] @ anchor)
            return system.iterate(spline, start, tolerance, pull)

        run = map if self.pool is None else self.pool.map
        return list(run(one, self.splines, starts, anchors))

    def _noise(self, system: System, ends: list[End]) -> float:
        squares, used = 0.0, 0
        for end in ends:
            gain = expected_variance(system, end.p, self.n_reference)
            squares += float(np.nansum(end.residual**2 / gain))
            used += int(np.isfinite(end.residual).sum())
        return float(np.sqrt(squares / max(used - system.freedom() * len(ends), 1.0)))


def expected_variance(system: System, p: FloatArray, n_reference: int) -> FloatArray:
    """Variance of ρ that white noise of variance 1 in each image causes, shape (n_pix,)."""
    at = system.pixels
    moved = motion_at_pixels(system, p)[:, :2] / at.pixel
    return variance_gain(at.rows + moved[:, 0], at.cols + moved[:, 1]) + 1 / n_reference


def motion_at_pixels(system: System, p: FloatArray) -> FloatArray:
    """u, v, w at the pixels from nodal values [u | v | w], shape (n_pix, 3)."""
    n, uv, w = system.n_uv, system.basis_uv, system.basis_w
    motion: FloatArray = motion_of(
        uv.mesh.cells, uv.cell, uv.shape, w.mesh.cells, w.cell, w.shape, p, n
    )
    return motion


def mean_diagonals(system: System) -> FloatArray:
    """Return the mean diagonal of the Hessian for u, v and for w, at each unknown, shape (n,)."""
    parts = np.split(system.hessian.diagonal(), [2 * system.n_uv])
    return np.concatenate([np.full(len(part), part.mean()) for part in parts])
