"""Noise and roughness under which the images are most probable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from driver.dic.system import System
from meshes.arrays import FloatArray

STEPS = 3  # factorisations spent on the estimate
ENOUGH = 0.1  # relative change, times the share of the unknowns that the images decide
LARGEST_STEP = 3.0  # of a logarithm
LEAST = 1e-3  # px, or of the noise for w: as good as affine


@dataclass(frozen=True)
class NoiseAndRoughness:
    """Noise of one image, and what is granted to u, v (in the unit of the pixel) and to w."""

    sigma: float
    roughness: float
    roughness_w: float

    def variance(self, n_reference: int) -> float:
        """Variance of ρ at a pixel that did not move, with n images in the reference."""
        return self.sigma**2 * (1 + 1 / n_reference)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Images linearised about where they were solved: only d = b + M p = A p of each is needed.

    Attributes:
        system: M and the penalties, with the weights of the last solution.
        ranks: of the penalties of u, v and of w.
        free: which of roughness and roughness_w are to be found.
        n_reference: images averaged into the reference.
    """

    system: System
    ranks: tuple[int, int]
    free: tuple[bool, bool]
    n_reference: int

    def settle(
        self, p: FloatArray, estimate: NoiseAndRoughness, sigma: float
    ) -> tuple[NoiseAndRoughness, FloatArray]:
        """Return the most probable roughness, and the nodal values under it, shape (T, n).

        MacKay's fixed point of the evidence: with γ = rank − tr(A⁻¹P) unknowns that the images
        decide, a² = pᵀRp / γ. Where it creeps, a secant in log a leaps. It ends when a further
        change would hardly be felt: where the images decide little, roughness matters little.

        Args:
            p: nodal values under the weights of the system, (T, n).
            estimate: behind these weights.
            sigma: noise found from what p left.
        """
        targets = self._applied(p)
        now = np.log([estimate.roughness, estimate.roughness_w])
        stale = any(self.system.weights) and abs(np.log(sigma / estimate.sigma)) > ENOUGH
        last = now, np.zeros(2)
        for step in range(STEPS):
            drift, share = self._drift(p, now, LEAST * sigma)
            if not stale and (np.abs(drift) * share <= ENOUGH).all():
                break
            leap = drift.copy()
            if step:
                some = np.array(self.free)
                moved, turned = now[some] - last[0][some], drift[some] - last[1][some]
                leap[some] = _secant(moved, turned, drift[some])
            last, now, stale = (now, drift), now + leap, False
            estimate = NoiseAndRoughness(sigma, *(float(a) for a in np.exp(now)))
            weigh(self.system, estimate, self.n_reference)
            # Steps from p: a ridge in the factor does not pull them to 0.
            lacking = np.ascontiguousarray((targets - self._applied(p)).T)
            p = np.asarray(p + self.system.solve(lacking).T)
        return estimate, p

    def _applied(self, p: FloatArray) -> FloatArray:
        """Return A p of each image, the factor's ridge left out, shape (T, n)."""
        system = self.system
        return np.array([system.hessian @ q + system.penalty_force(q) for q in p])

    def _drift(
        self, p: FloatArray, now: FloatArray, least_w: float
    ) -> tuple[FloatArray, FloatArray]:
        """Change of the logarithms that the fixed point asks for; γ / rank of each part."""
        drift, share = np.zeros(2), np.zeros(2)
        if not any(self.free):
            return drift, share
        system, leasts = self.system, (LEAST * self.system.pixels.pixel, least_w)
        traces = system.traces()
        for k in np.flatnonzero(self.free):
            part, least = system.parts[k], leasts[k]
            rank = self.ranks[k]
            if not rank:  # a mesh of one element, which nothing can bend
                continue
            decided = max(rank - system.weights[k] * traces[k], 1.0)
            energy = max(float(np.sum(p.T * (part @ p.T))) / len(p), 0.0)
            drift[k] = np.log(max(np.sqrt(energy / decided), least)) - now[k]
            share[k] = decided / rank
        return drift, share


def weigh(system: System, estimate: NoiseAndRoughness, n_reference: int) -> None:
    """Give the penalties of u, v and of w their weights."""
    variance = estimate.variance(n_reference)
    system.weigh([variance / granted**2 for granted in (estimate.roughness, estimate.roughness_w)])


def _secant(moved: FloatArray, turned: FloatArray, drift: FloatArray) -> FloatArray:
    """Return the step to where the drift would vanish, as long as the drift is seen to shrink."""
    shrinks = moved * turned < 0
    slope = np.where(shrinks, turned / np.where(shrinks, moved, 1.0), -1.0)
    return np.clip(-drift / slope, -LARGEST_STEP, LARGEST_STEP)
