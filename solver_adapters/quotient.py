"""A derivative from three runs along a line, and what it may be wrong by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.interface import Direction, Response

Pair = tuple[tuple[float, Response], tuple[float, Response]]
"""Two runs, each with its distance from the asked one."""

ASYMMETRY = 0.02
"""Largest difference of a one-sided slope from the derivative, in shares of it, that needs no word.

It leaves 1 %: curvature leaves a third of it at most (28 directions on a prism in two cycles),
independent noise 0.6 of it, and a jump of one run alone all of it.
"""

OTHER_STEPS = 0.25
"""Share of the time steps that runs need not have in common, as where a step was cut.

What such runs are off by stands in the asymmetry: all three would have to be off by as much.
"""

MOST_STEPS = 6
"""Steps that are tried for a derivative."""

_SEARCHED = 4  # of these, steps about the best one; then wider ones, for a polynomial

_WIDEST = 0.5  # step in shares of the scale
_NARROWEST = 1 / 64  # second step in shares of the first
_FURTHER = 3.0  # factor from the second step to the third, at most
_OTHER = 1.1  # factor between two steps that are not the same
# Of curvature the asymmetry grows with the step, of noise it falls, of a kink it stays.
_NO_KINK = 1.5
_DIGITS = 6  # of an uncertainty by which derivatives are told apart
_WIDER = 2.0  # factor from a step of the polynomial to the next
_FEWEST = 4  # steps of a polynomial: its mean takes three coefficients
_CENTRED = 1e-9  # by which two runs may be off the same distance, in shares of it


@dataclass(frozen=True, eq=False)
class Slope:
    """A derivative with what it may be wrong by.

    Attributes:
        amounts: where along the direction the two runs are.
        displacement, force: the derivatives.
        asymmetry: largest difference of a one-sided slope, in shares of the derivative; infinite
            where that is 0.
        uncertainty: what the derivative may be wrong by, in shares of it: half of the asymmetry,
            or what it differs by from that of another step. All of the asymmetry where a run took
            other time steps in part: that run alone may be off.
        noise: what of this the noise of the solver would make.
        other_steps: share of the time steps that only a run or the asked one took.
        seen: whether any number of either run differs from the asked one.
        norms: of displacement and force of the asked run.
        ends: ends of the most time steps that one of the three runs took [s], None if unknown.
        bend: by which the slopes to both sides are off the derivative, half of their difference in
            shares of the response; empty if unknown.
    """

    amounts: tuple[float, float]
    displacement: FloatArray
    force: FloatArray
    asymmetry: float
    uncertainty: float
    noise: float
    other_steps: float
    seen: bool
    norms: tuple[float, float] = (1.0, 1.0)
    ends: FloatArray | None = None
    bend: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def whole(self) -> FloatArray:
        """The derivative, displacement and force as one vector in shares of the response."""
        return _joined(self.norms, self.displacement, self.force)

    @property
    def step(self) -> float:
        """Distance of the farther run from the asked one."""
        return max(abs(amount) for amount in self.amounts)

    @property
    def allowed(self) -> float:
        """Largest asymmetry that needs no word."""
        return ASYMMETRY / 2 if self.other_steps else ASYMMETRY

    @property
    def doubtful(self) -> bool:
        """Whether the derivative may be wrong by more than needs no word."""
        return not self.uncertainty <= ASYMMETRY / 2

    @property
    def same_steps(self) -> bool:
        """Whether both runs took the time steps of the asked one, but for few that were cut."""
        return self.other_steps <= OTHER_STEPS

    def better_step(self, scale: float) -> float | None:
        """Return a step that leaves half of the asymmetry that needs no word, or None.

        Where noise makes the asymmetry, one run alone may be off, and the derivative by all of it.
        """
        noisy = self.noise >= self.asymmetry / 2  # both are infinite where nothing was seen
        if not (self.doubtful or (noisy and self.asymmetry > ASYMMETRY / 2)):
            return None
        step = self.step
        wanted = self.allowed / 2
        if noisy:
            return min(self.asymmetry / wanted * step, _WIDEST * scale)
        factor = max(wanted / self.asymmetry, self.noise / wanted, _NARROWEST)
        return min(factor, 0.5) * step

    def apart(self, other: Slope) -> float:
        """Return by how much another derivative differs from this one, in shares of it."""
        size = _size(self.norms, self.displacement, self.force)
        change = other.displacement - self.displacement, other.force - self.force
        return _size(self.norms, *change) / size if size else np.inf

    def doubts(self, direction: Direction) -> list[str]:
        """Return what is to be said of this derivative."""
        doubts = []
        if not self.seen:
            doubts.append(
                f"derivative along {direction.name!r}: no change was seen over ± {self.step:.3g} "
                f"(scale {direction.scale:.3g}); the derivative is 0 within the noise of the solver"
            )
        elif self.doubtful:
            doubts.append(
                f"derivative along {direction.name!r}: uncertain by about "
                f"{min(self.uncertainty, 1.0):.0%}, as a slope to one side differs from it by "
                f"{self.asymmetry:.1%} (steps {self.amounts[0]:.3g} and {self.amounts[1]:.3g}, "
                f"scale {direction.scale:.3g}); expected {self.allowed:.0%} or less"
            )
        if not self.same_steps:
            doubts.append(
                f"derivative along {direction.name!r}: its runs took other time steps than the "
                "asked one, whose errors differ; shorter steps make it better"
            )
        return doubts


def following_step(tried: Sequence[Slope], scale: float) -> float | None:
    """Return the step to be tried next along a direction, None where no other is needed.

    Args:
        tried: derivatives by the steps that were tried, in their order.
        scale: of the direction.
    """
    best = best_of(tried)
    if len(tried) == 1:
        return best.better_step(scale)
    if not best.doubtful or len(tried) >= MOST_STEPS:
        return None
    if len(tried) >= _SEARCHED:
        # Noise falls with the step, and what grows with it the polynomial tells apart.
        step = _WIDER * max(slope.step for slope in tried if not slope.other_steps or slope is best)
        return step if step <= _WIDEST * scale else None
    wider = [slope for slope in tried if slope.step > best.step]
    narrower = [slope for slope in tried if slope.step < best.step]
    if wider and narrower:
        next_best = min((*wider, *narrower), key=lambda slope: slope.uncertainty)
        step = float(np.sqrt(best.step * next_best.step))
    else:
        # Beyond the best one, as far as the nearest other one is on its other side.
        nearest = min(s.step for s in wider) if wider else max(s.step for s in narrower)
        factor = best.step / nearest
        step = min(best.step * min(max(factor, 1 / _FURTHER), _FURTHER), _WIDEST * scale)
    known = any(1 / _OTHER < step / other.step < _OTHER for other in tried)
    return None if known else step


def best_of(tried: Sequence[Slope]) -> Slope:
    """Return the least uncertain derivative in the same time steps, and how sure it is.

    Two steps that agree tell that neither noise nor curvature makes a derivative wrong: the error
    of the one falls with the step, that of the other grows. Where the asymmetry does not change
    with the step there is a kink, and they tell nothing.
    """
    # Runs in other time steps than the asked one differ by the error of these, too.
    alike = [slope for slope in tried if slope.same_steps] or tried
    # Of steps that all show no change the last, widest one is told.
    best = min(reversed(alike), key=lambda slope: slope.uncertainty)
    if not best.doubtful:
        return best
    polynomial = _polynomial_of(alike)
    kink = 0.0 if polynomial is None else polynomial.kink
    judged = [] if polynomial is None else [polynomial.slope]
    for slope in reversed(alike):
        agreed = max(kink, min(_agreements(slope, alike), default=np.inf))
        judged.append(replace(slope, uncertainty=min(slope.uncertainty, agreed)))
    return min(judged, key=lambda slope: (round(slope.uncertainty, _DIGITS), slope.asymmetry))


@dataclass(frozen=True, eq=False)
class _Polynomial:
    """Of third degree, through the runs of all steps.

    Attributes:
        slope: its derivative.
        kink: what a kink may make the derivatives of all steps wrong by, in shares of them, were
            noise no part of what is seen of it.
    """

    slope: Slope
    kink: float


def _polynomial_of(tried: Sequence[Slope]) -> _Polynomial | None:
    """Return the polynomial, None where the runs are too few or took other time steps.

    What runs differ by to both sides is odd in the step, h and h³, and the derivative is that of
    the first. Their mean is even: a constant, by which the asked run is off, h², and |h| of a kink.
    What these leave is noise, by whose size the derivative is uncertain (least squares).
    """
    known = [
        slope
        for slope in tried
        if slope.seen
        and not slope.other_steps
        and abs(slope.amounts[0] + slope.amounts[1]) <= _CENTRED * slope.step
    ]
    if len(known) < _FEWEST:
        return None
    widest = max(known, key=lambda slope: slope.step)
    h = np.array([slope.step for slope in known]) / widest.step
    to_first = np.stack([h, h**3], axis=1)
    to_kink = np.stack([h, h**0, h**2], axis=1)
    first, left = _fitted(to_first, h[:, None] * np.array([slope.whole for slope in known]))
    kinked, left_by_mean = _fitted(to_kink, h[:, None] * np.array([slope.bend for slope in known]))
    noise = float(np.hypot(left, left_by_mean) / np.sqrt(2 * len(known) - 5))
    size = float(np.linalg.norm(first))
    # Of the coefficient of |h| noise makes so much; the rest is a kink.
    found, expected = float(np.linalg.norm(kinked)), noise * _spread(to_kink)
    kink = np.sqrt(max(found**2 - expected**2, 0.0)) / size if size else np.inf
    of_noise = noise * _spread(to_first) / size if size else np.inf
    of_displacement, of_force = np.split(first, [widest.displacement.size])
    slope = replace(
        widest,
        displacement=widest.norms[0] * of_displacement.reshape(widest.displacement.shape),
        force=widest.norms[1] * of_force.reshape(widest.force.shape),
        uncertainty=float(np.hypot(of_noise, kink)),
    )
    return _Polynomial(slope, found / size if size else np.inf)


def _fitted(terms: FloatArray, values: FloatArray) -> tuple[FloatArray, float]:
    """Return the coefficients of the first of some terms, and the norm of what all leave."""
    found = np.linalg.lstsq(terms, values)[0]
    return found[0], float(np.linalg.norm(values - terms @ found))


def _spread(terms: FloatArray) -> float:
    """Return the standard deviation of the first coefficient where that of the values is 1."""
    return float(np.sqrt(np.linalg.inv(terms.T @ terms)[0, 0]))


def _agreements(slope: Slope, others: Sequence[Slope]) -> list[float]:
    """Return by how much the derivatives of clearly other asymmetry differ from one."""
    if not slope.seen:
        return []
    return [
        slope.apart(other)
        for other in others
        if max(slope.asymmetry, other.asymmetry) >= _NO_KINK * min(slope.asymmetry, other.asymmetry)
        and other is not slope
    ]


def _finest_steps(base: Response, pair: Pair) -> FloatArray | None:
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
    norms = _norm(base.displacement), _norm(base.force)
    size = _size(norms, displacement, force)
    # Of the whole response: what hardly moves the one half need not be known to a share of that.
    off = max(_size(norms, u - displacement, f - force) for u, f in sides)
    asymmetry = off / size if size else np.inf
    other_steps = max(_other_steps(base, run) for run in (one, two))
    return Slope(
        amounts=(a1, a2),
        displacement=displacement,
        force=force,
        asymmetry=asymmetry,
        uncertainty=asymmetry if other_steps else asymmetry / 2,
        norms=norms,
        ends=_finest_steps(base, pair),
        noise=2 * noise / (size * min(abs(a1), abs(a2))) if size else np.inf,
        other_steps=other_steps,
        seen=bool(size or off),
        bend=_joined(norms, (u1 - u2) / 2, (f1 - f2) / 2),
    )


def _norm(values: FloatArray) -> float:
    return float(np.linalg.norm(values)) or 1.0


def _joined(norms: tuple[float, float], displacement: FloatArray, force: FloatArray) -> FloatArray:
    """Return displacement and force as one vector in shares of the response."""
    of_displacement, of_force = norms
    return np.concatenate([displacement.ravel() / of_displacement, force / of_force])


def _size(norms: tuple[float, float], displacement: FloatArray, force: FloatArray) -> float:
    """Return a change in shares of the response, whose norms are those of its two parts."""
    of_displacement, of_force = norms
    return float(
        np.hypot(np.linalg.norm(displacement) / of_displacement, np.linalg.norm(force) / of_force)
    )


def _other_steps(base: Response, run: Response) -> float:
    """Return the share of the time steps of two runs that only one of them took."""
    if not (base.ends.size and run.ends.size):
        return float(base.steps != run.steps)
    # Some result files have seven digits of a time.
    common = int(np.isclose(base.ends[:, None], run.ends, rtol=1e-6, atol=0).any(axis=1).sum())
    return 1 - common / (base.ends.size + run.ends.size - common)
