"""The correlation engine: the motion of every image, with the noise and roughness they ask for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from driver.common.splines.images import Splines
from driver.dic.basis import Basis, motion_at_pixels
from driver.dic.factor import Matrix
from driver.dic.messages import explanation
from driver.dic.missing_pixels import Equations
from driver.dic.regularisation import Penalty, penalties, ranks
from driver.dic.regularisation_evidence import Evidence, NoiseAndRoughness, weigh
from driver.dic.relief_gain import Gains, Relief
from driver.dic.residual_noise import residual_variance
from driver.dic.system import End, Pixels, System
from driver.dic.turn import turned
from meshes.arrays import BoolArray, FloatArray, IntArray

Result = TypeVar("Result")

FIRST_ROUGHNESS = 1.0  # px; where the estimate of what the motion needs begins
FIRST_ROUGHNESS_W, FIRST_NOISE = 0.1, 0.05  # of the relief
UNLIKE = 3.0  # times what the others leave, beyond which an image has no say in both
GAIN_ROUNDS = 3  # solutions at most, until the gains of the images are met
COARSE = 2e-2  # px; largest update at the end before an estimate, and enough to warp images back


@dataclass(frozen=True)
class KnownNoise:
    """What is known of the noise of the images.

    Attributes:
        n_reference: number of images averaged into the reference.
        sigma: standard deviation of the noise of one image at a pixel [µm]; None for what the
            residual says.
        sigma_flat: standard error of the flat pattern that was subtracted [µm]; known with sigma.
    """

    n_reference: int
    sigma: float | None = None
    sigma_flat: float = 0.0


@dataclass(frozen=True)
class Regularisation:
    """What is penalised, and how much of it is granted.

    Attributes:
        penalty: of u and v; None for "tikhonov" on a grid and "equilibrium_gap" elsewhere.
        roughness: standard deviation granted to what is penalised of u, v [µm]; infinity for no
            penalty, None for what makes the images most probable.
        roughness_w: the same of w [µm].
    """

    penalty: Penalty | None
    roughness: float | None
    roughness_w: float | None


@dataclass(frozen=True, eq=False)
class CorrelationProblem:
    """Images to be correlated with one reference.

    Attributes:
        pixels: the reference over n_pix pixels, and the gradient by which motion is seen.
        basis_uv: basis of u and of v at these pixels.
        basis_w: basis of w.
        splines: cubic B-spline coefficients of the T images [µm], NaN where nothing was measured.
        noise: of the images.
    """

    pixels: Pixels
    basis_uv: Basis
    basis_w: Basis
    splines: Splines
    noise: KnownNoise


@dataclass(frozen=True, eq=False)
class Solution:
    """Measured motion in T images.

    Attributes:
        equations: normal equations of the last iterations.
        coefficients: nodal values [u | v | w] [µm], shape (T, n).
        residual: ρ = f + w − g(x + u, y + v) at each pixel [µm], NaN where not compared,
            shape (T, n_pix), or (T, 0) where it was not asked for.
        compared: whether each pixel was compared, shape (T, n_pix).
        squares: Σ ρ² over its variance by noise, of each image, shape (T,). The relief stands for
            the residual of an image that is lost.
        seen: number of pixels in each of these sums, shape (T,).
        noise: what was known of it.
        estimate: noise and roughness, as given or as the images say.
        lost: whether most of the pixels left the image or the iteration diverged, (T,).
        unlike: whether it leaves so much more than the others that it has no say in the estimate;
            what is lost is unlike, too, (T,).
        gains: heights of each image over those of the reference, as estimated.
        applied: gains that the reference was held against each image with, shape (T,).
        iterations: Gauss–Newton steps of the last iterations, (T,).
        converged: whether the update fell below the tolerance, or within the noise, (T,).
        reason: why each image's iteration ended, and what to try if it failed, length T.
    """

    equations: Equations
    coefficients: FloatArray
    residual: FloatArray
    compared: BoolArray
    squares: FloatArray
    seen: IntArray
    noise: KnownNoise
    estimate: NoiseAndRoughness
    lost: BoolArray
    unlike: BoolArray
    gains: Gains
    applied: FloatArray
    iterations: IntArray
    converged: BoolArray
    reason: tuple[str, ...]

    @property
    def system(self) -> System:
        """The equations of an image that has every pixel: bases, Hessian, penalties and factor."""
        return self.equations.whole

    @property
    def basis_uv(self) -> Basis:
        """Basis of u and of v."""
        return self.system.basis_uv

    @property
    def basis_w(self) -> Basis:
        """Basis of w."""
        return self.system.basis_w

    def variance(self, t: int) -> FloatArray:
        """Variance of ρ of image t from noise alone [µm²], shape (n_pix,)."""
        return _variance(self.system, self.coefficients[t], self.noise, self.estimate.sigma)

    @property
    def chi(self) -> FloatArray:
        """Residual of each image in units of noise, degrees of freedom counted, shape (T,).

        NaN where the noise is not known: where it was not given, and no image has converged whose
        residual would tell it.
        """
        if self.noise.sigma is None and not (self.converged & ~self.unlike).any():
            return np.full(len(self.squares), np.nan)
        freedom = np.maximum(self.seen - self.system.freedom(), 1.0)
        return np.asarray(np.sqrt(self.squares / freedom))

    def covariance_of(self, functionals: FloatArray, noise: Matrix | None = None) -> FloatArray:
        """Covariance that the noise of one image causes in linear functionals of [u | v | w].

        σ² L A⁻¹ N A⁻¹ Lᵀ with A = M + P. Between the images t and t' it is to be multiplied by
        δ_tt' + 1/n_reference. A penalty takes noise away and adds a bias, which is not in it. Of an
        image that has turned u and v are along axes that turn with it.

        Args:
            functionals: L, shape (m, n).
            noise: N, covariance of the right-hand side b over σ² (1 + 1/n_reference), shape (n, n);
                M if None: between the pixels interpolation smoothes the noise of an image, but
                its slopes as much.
        """
        noise = self.system.hessian if noise is None else noise
        return self.estimate.sigma**2 * self.system.covariance_of(functionals, noise)


def solve(
    problem: CorrelationProblem,
    starts: FloatArray,
    regularisation: Regularisation,
    tolerance: float,
    workers: int = 1,
    with_residual: bool = True,
    with_gains: bool = False,
) -> Solution:
    """Find the motion of every image against the reference.

    The residual is ρ = f + w − g(x + u, y + v). With ∇f = (∂f/∂x, ∂f/∂y, −1) and the nodal
    functions ψ of all three components, each Gauss–Newton step solves (M + P) δ = b − P p,

        M_ij = Σ (∇f·ψ_i)(∇f·ψ_j),    b_i = Σ (∇f·ψ_i) ρ,

    factored once for all images. P = σ²(1 + 1/n)(R_uv/a_uv² + R_w/a_w²), with the penalties R of
    `regularisation`, keeps modes in bounds that a weak pattern leaves to the noise.

    Where σ or a roughness a is not given:

    1. the images are solved roughly, with 1 pixel for u, v and a tenth of the relief for w;
    2. σ is taken from their residual, and each a from their motion, by `Evidence`;
    3. the images are solved again from the motion that this leads to.

    A pixel without a height in one image is left out of ρ, b and M of that image alone. An image
    that is lost, or leaves more than `UNLIKE` times what is usual, has no say in σ and a: out of
    focus or of another field, it would ask for a roughness that spoils all others.

    Args:
        problem: the images.
        starts: nodal values [µm], shape (T, n).
        regularisation: penalty and roughness.
        tolerance: largest nodal update of u, v at the end [px].
        workers: threads over the images; the result does not depend on it.
        with_residual: whether the residuals of all images are kept.
        with_gains: whether an image that shows the relief larger or smaller is held against a
            reference that is so about its mean.
    """
    known = np.ones(len(starts))
    for _ in range(GAIN_ROUNDS):
        solution = _solve(problem, known, starts, regularisation, tolerance, workers, with_residual)
        off = solution.gains.off(known)
        if not (with_gains and off.any()):
            break
        known, starts = np.where(off, solution.gains.value, known), solution.coefficients
    return solution


def _as_high(equations: Equations, gain: float) -> Equations:
    """Return the equations of an image that shows the relief higher by a gain."""
    if gain == 1.0:
        return equations
    height = equations.whole.pixels.height
    height = height + (gain - 1.0) * (height - height.mean())
    return replace(equations, whole=equations.whole.at_heights(height))


def _solve(
    problem: CorrelationProblem,
    known: FloatArray,
    starts: FloatArray,
    regularisation: Regularisation,
    tolerance: float,
    workers: int,
    with_residual: bool,
) -> Solution:
    """Find the motion with the gains of the images as they are known."""
    pixels, noise = problem.pixels, problem.noise
    relief = float(np.std(pixels.height))
    estimate = NoiseAndRoughness(
        sigma=noise.sigma or FIRST_NOISE * relief,
        roughness=regularisation.roughness or FIRST_ROUGHNESS * pixels.pixel,
        roughness_w=regularisation.roughness_w or FIRST_ROUGHNESS_W * relief,
    )
    bases, penalty = (problem.basis_uv, problem.basis_w), regularisation.penalty
    system = System(pixels, *bases, penalties(*bases, penalty))
    weigh(system, estimate, noise.n_reference)
    free = (regularisation.roughness is None, regularisation.roughness_w is None)
    if any(free) or (noise.sigma is None and any(system.weights)):
        _, solved = _solved(problem, system, estimate, known, starts, COARSE, workers, False)
        kept = ~_unlike(solved)
        sigma = noise.sigma or _sigma(system, solved)
        evidence = Evidence(system, ranks(*bases, penalty), free, noise.n_reference)
        reached = np.array([one.end.p for one in solved])[kept]
        n_uv = system.n_uv
        # As equations of the reference have it, none of them turned.
        angles = [system.turn_of(p) for p in reached]
        p = np.array([turned(q, n_uv, -a) for q, a in zip(reached, angles, strict=True)])
        estimate, p = evidence.settle(p, estimate, sigma)
        starts = starts.copy()
        starts[kept] = [turned(q, n_uv, a) for q, a in zip(p, angles, strict=True)]
    shown = Relief.of(system)
    equations, solved = _solved(
        problem, system, estimate, known, starts, tolerance, workers, with_residual, shown
    )
    squares = np.array([one.squares for one in solved])
    if noise.sigma is None:
        estimate = replace(estimate, sigma=_sigma(system, solved))
        squares /= estimate.sigma**2
    ends, unlike = [one.end for one in solved], _unlike(solved)
    converged = np.array([end.reason == "converged" for end in ends])
    along = np.where(converged & ~unlike, [one.along for one in solved], np.nan)
    return Solution(
        equations=equations,
        coefficients=np.array([end.p for end in ends]),
        residual=np.array([end.residual for end in ends]),
        compared=np.array([one.compared for one in solved]),
        squares=squares,
        seen=np.array([one.seen for one in solved]),
        noise=noise,
        estimate=estimate,
        lost=_lost(solved),
        unlike=unlike,
        gains=shown.gains(system, along, known, estimate.sigma, noise.n_reference),
        applied=known,
        iterations=np.array([end.iterations for end in ends]),
        converged=converged,
        reason=tuple(explanation(one.end, tolerance, one.rms / relief) for one in solved),
    )


@dataclass(frozen=True, eq=False)
class _Outcome:
    """What is kept of an image that was solved.

    Attributes:
        end: where its iteration ended; without a residual where that was not asked for.
        compared: whether each pixel was compared, shape (n_pix,).
        squares: Σ ρ² over its variance by noise, of the given σ or of 1; the relief stands for
            the residual of an image that is lost.
        seen: number of pixels in that sum.
        along: of `Relief`, by which the gain is found [µm²], 0 where that is not asked for.
        rms: root mean square of ρ, or of the relief where the image is lost [µm].
    """

    end: End
    compared: BoolArray
    squares: float
    seen: int
    along: float
    rms: float

    @property
    def lost(self) -> bool:
        """Whether most of the pixels left the image or the iteration diverged."""
        return self.end.reason in ("left", "diverged")


def _solved(
    problem: CorrelationProblem,
    system: System,
    estimate: NoiseAndRoughness,
    known: FloatArray,
    starts: FloatArray,
    tolerance: float,
    workers: int,
    with_residual: bool,
    relief: Relief | None = None,
) -> tuple[Equations, list[_Outcome]]:
    """Solve all images with the system as it is weighed."""
    noise, height = problem.noise, problem.pixels.height
    variance = estimate.variance(noise.n_reference)
    equations = Equations(system, variance / float(np.var(height)))
    flat, unit = height - height.mean(), noise.sigma or 1.0

    def outcome(t: int) -> _Outcome:
        own = _as_high(equations, float(known[t]))
        end = own.solve(problem.splines[t], starts[t], tolerance, variance)
        compared = np.isfinite(end.residual)
        along = 0.0 if relief is None else relief.along(end)
        solved = _Outcome(end, compared, 0.0, 0, along, 0.0)
        left = flat if solved.lost else end.residual
        return replace(
            solved,
            end=end if with_residual else replace(end, residual=np.empty(0)),
            squares=float(np.nansum(left**2 / _variance(system, end.p, noise, unit))),
            seen=int(np.count_nonzero(np.isfinite(left))),
            rms=float(np.sqrt(np.nanmean(left**2))),
        )

    return equations, in_threads(outcome, workers, range(len(starts)))


def in_threads(
    work: Callable[..., Result], workers: int, *arguments: Sequence[FloatArray] | range
) -> list[Result]:
    """Results of `work` on the arguments of each image, in their order."""
    if min(workers, len(arguments[0])) == 1:
        return list(map(work, *arguments))
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(work, *arguments))


def _lost(solved: Sequence[_Outcome]) -> BoolArray:
    return np.array([one.lost for one in solved])


def _unlike(solved: Sequence[_Outcome]) -> BoolArray:
    """Images that are lost or leave far more than is usual; none where all are lost."""
    lost = _lost(solved)
    if lost.all():
        return ~lost
    left = np.sqrt([one.squares / max(one.seen, 1) for one in solved])
    told = np.sort(left[~lost])
    usual = told[(len(told) - 1) // 2]  # of two images the better one
    return np.asarray(lost | (left > UNLIKE * usual))


def _sigma(system: System, solved: Sequence[_Outcome]) -> float:
    """Noise of one image by the residuals of those that are not unlike the others.

    Of these such as have converged count, if there are any.
    """
    squares, freedom, each = 0.0, 0.0, system.freedom()
    told = ~_unlike(solved)
    converged = np.array([one.end.reason == "converged" for one in solved])
    if (told & converged).any():
        told &= converged
    for one, heard in zip(solved, told, strict=True):
        if heard:
            squares += one.squares
            freedom += one.seen - each
    return float(np.sqrt(squares / max(freedom, 1.0)))


def _variance(system: System, p: FloatArray, noise: KnownNoise, sigma: float) -> FloatArray:
    """Variance of ρ from noise alone, for nodal values p of one image, shape (n_pix,)."""
    at = system.pixels
    shift = motion_at_pixels(system.basis_uv, system.basis_w, p[None])[0, :, :2] / at.pixel
    places = np.column_stack([at.rows, at.cols])
    return residual_variance(places, shift, sigma, noise.n_reference, noise.sigma_flat)
