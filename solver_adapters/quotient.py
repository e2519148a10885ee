"""A derivative from three runs along a line, and what it may be wrong by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solver_adapters.interface import Direction, FloatArray, Response

Pair = tuple[tuple[float, Response], tuple[float, Response]]
"""Two runs, each with its distance from the asked one."""

ASYMMETRY = 0.02
"""Largest difference of a one-sided slope from the derivative, in shares of it, that needs no word.

It leaves 1 %: curvature leaves a third of it at most (28 directions on a prism in two cycles),
independent noise 0.6 of it.
"""

_WIDEST = 0.5  # step in shares of the scale
_NARROWEST = 1 / 64  # second step in shares of the first


@dataclass(frozen=True, eq=False)
class Slope:
    """A derivative with what it may be wrong by.

    Attributes:
        amounts: where along the direction the two runs are.
        displacement, force: the derivatives.
        asymmetry: largest difference of a one-sided slope, in shares of the derivative; infinite
            where that is 0.
        noise: what of this the noise of the solver would make.
        same_steps: whether both runs took the time steps of the asked one.
        seen: whether any number of either run differs from the asked one.
    """

    amounts: tuple[float, float]
    displacement: FloatArray
    force: FloatArray
    asymmetry: float
    noise: float
    same_steps: bool
    seen: bool

    def better_step(self, scale: float) -> float | None:
        """Return a step that leaves half of the asymmetry that needs no word, or this one."""
        if self.asymmetry <= ASYMMETRY:
            return None
        step = max(abs(amount) for amount in self.amounts)
        wanted = ASYMMETRY / 2
        if self.noise >= self.asymmetry / 2:  # both are infinite where nothing was seen
            return min(self.asymmetry / wanted * step, _WIDEST * scale)
        factor = max(wanted / self.asymmetry, self.noise / wanted, _NARROWEST)
        return min(factor, 0.5) * step

    def doubts(self, direction: Direction) -> list[str]:
        """Return what is to be said of this derivative."""
        doubts = []
        if not self.seen:
            step = max(abs(amount) for amount in self.amounts)
            doubts.append(
                f"derivative along {direction.name!r}: no change was seen over ± {step:.3g} (scale "
                f"{direction.scale:.3g}); the derivative is 0 within the noise of the solver"
            )
        elif self.asymmetry > ASYMMETRY:
            doubts.append(
                f"derivative along {direction.name!r}: uncertain by about "
                f"{min(self.asymmetry / 2, 1.0):.0%}, as a slope to one side differs from it by "
                f"{self.asymmetry:.1%} (steps {self.amounts[0]:.3g} and {self.amounts[1]:.3g}, "
                f"scale {direction.scale:.3g}); expected {ASYMMETRY:.0%} or less"
            )
        if not self.same_steps:
            doubts.append(
                f"derivative along {direction.name!r}: its runs took other time steps than the "
                "asked one, whose errors differ; shorter steps make it better"
            )
        return doubts


def finest_steps(base: Response, pair: Pair) -> FloatArray | None:
    """Return the ends of the most steps that one of three runs took [s], None if unknown."""
    ends = max((base.ends, *(run.ends for _, run in pair)), key=lambda ends: ends.size)
    return ends if ends.size else None


def slope_through(base: Response, pair: Pair, noise: float) -> Slope:
    """Return the derivative at the asked run of the parabola through it and two others."""
    (a1, one), (a2, two) = pair
    w1, w2 = a2 / (a2 - a1), a1 / (a1 - a2)
    sides = [
        ((run.displacement - base.displacement) / a, (run.force - base.force) / a)
        for a, run in pair
    ]
    (u1, f1), (u2, f2) = sides
    displacement, force = w1 * u1 + w2 * u2, w1 * f1 + w2 * f2
    size = _size(base, displacement, force)
    # Of the whole response: what hardly moves the one half need not be known to a share of that.
    off = max(_size(base, u - displacement, f - force) for u, f in sides)
    return Slope(
        amounts=(a1, a2),
        displacement=displacement,
        force=force,
        asymmetry=off / size if size else np.inf,
        noise=2 * noise / (size * min(abs(a1), abs(a2))) if size else np.inf,
        same_steps=all(_same_steps(base, run) for run in (one, two)),
        seen=bool(size or off),
    )


def _size(base: Response, displacement: FloatArray, force: FloatArray) -> float:
    """Return a change in shares of the response."""
    of_displacement = np.linalg.norm(displacement) / (np.linalg.norm(base.displacement) or 1.0)
    of_force = np.linalg.norm(force) / (np.linalg.norm(base.force) or 1.0)
    return float(np.hypot(of_displacement, of_force))


def _same_steps(base: Response, run: Response) -> bool:
    # Some result files have seven digits of a time.
    if base.ends.size and base.ends.size == run.ends.size:
        return bool(np.allclose(base.ends, run.ends, rtol=1e-6, atol=0))
    return base.steps == run.steps
