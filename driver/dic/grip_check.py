"""Whether the grips move the specimen as the stage travels: elongation against stage travel.

Each phase (a loading or an unloading) has a straight line of its own, fitted without the lines of
its neighbours. What a grip can do wrong then shows apart: play, where the next line starts later
than the last one ended; bowing, where a parabola fits better; slip, where a line breaks into two;
and images that lie off for themselves. Only what a family of normal tests at 1 % finds is told.

Regularisation carries the stretch of the middle on to the ends, alike in all images: a specimen
that stretches less at its ends has too large a ratio. Many images together do without it: their
ratios are those of the elongation without penalty where that knows them better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from driver.common.distributions import normal_isf
from meshes.arrays import BoolArray, FloatArray, IntArray

_FAMILY = 0.01  # error of all tests of a kind together
_ROBUST = 1.4826  # standard deviation of a normal distribution over its median deviation
_SIDE = 3  # images at least on either side of a break


@dataclass(frozen=True)
class Estimate:
    """A number with its standard deviation."""

    value: float
    sigma: float

    def is_beyond(self, limit: float) -> bool:
        """Whether it is further from zero than so many standard deviations."""
        return abs(self.value) > limit * self.sigma


@dataclass(frozen=True)
class Phase:
    """A loading or an unloading.

    Attributes:
        loading: whether the stage travels forward.
        first, last: its first and last image; the turning image ends a phase.
        ratio: elongation over stage travel [1]; what is held back is not in its deviation.
        bow: departure of the parabola from its chord half-way [µm]; None with fewer than 4 images.
    """

    loading: bool
    first: int
    last: int
    ratio: Estimate
    bow: Estimate | None


@dataclass(frozen=True)
class Turn:
    """A reversal of the stage.

    Attributes:
        image: the image at which the stage turned.
        lost: by how much the elongation lags behind the stage after it [µm]: play if positive,
            a grip that slides back if negative.
    """

    image: int
    lost: Estimate


@dataclass(frozen=True)
class Slip:
    """A break of the elongation within a phase.

    Attributes:
        image: the first image after it.
        jump: of the elongation [µm].
    """

    image: int
    jump: Estimate


@dataclass(frozen=True, eq=False)
class GripMotion:
    """What the check found, T images.

    Attributes:
        nominal: length of the specimen over the distance of the grips [1].
        ratio: elongation over stage travel of all images together [1], its standard deviation
            widened by how far they scatter about the line, and by what is held back.
        held: share of a ratio that regularisation may hold back, one standard deviation [1];
            0 where the ratios are those without penalty.
        unpenalised: whether they are.
        start: elongation of that line at no travel [µm].
        scatter: about the lines of the phases, over the noise of the correlation [1].
        phases: those of two images at least.
        turns: reversals between two of them.
        slips: breaks that are significant.
        outliers: images that lie off the lines for themselves.
        line: elongation on the line of all images [µm], shape (T,).
        line_sigma: its standard deviation [µm], shape (T,).
    """

    nominal: float
    ratio: Estimate
    held: float
    unpenalised: bool
    start: float
    scatter: float
    phases: tuple[Phase, ...]
    turns: tuple[Turn, ...]
    slips: tuple[Slip, ...]
    outliers: tuple[int, ...]
    line: FloatArray
    line_sigma: FloatArray

    def ratio_of(self, loading: bool) -> Estimate | None:
        """Mean ratio of the loadings or of the unloadings, None if there are none."""
        ratios = [phase.ratio for phase in self.phases if phase.loading == loading]
        if not ratios:
            return None
        weights = np.array([ratio.sigma**-2 for ratio in ratios])
        mean = float(np.average([ratio.value for ratio in ratios], weights=weights))
        return _widened(Estimate(mean, float(weights.sum() ** -0.5)), self.held)

    @property
    def bowed(self) -> tuple[Phase, ...]:
        """Phases that are significantly not straight."""
        limit = _limit(sum(phase.bow is not None for phase in self.phases))
        return tuple(p for p in self.phases if p.bow is not None and p.bow.is_beyond(limit))

    @property
    def played(self) -> tuple[Turn, ...]:
        """Reversals after which the elongation significantly lags or runs ahead."""
        limit = _limit(len(self.turns))
        return tuple(turn for turn in self.turns if turn.lost.is_beyond(limit))


@dataclass(frozen=True, eq=False)
class WithoutPenalty:
    """The elongation as images say it without regularisation, and what that does otherwise.

    Attributes:
        elongation: without a penalty of u and v [µm], shape (T,).
        sigma: standard deviation of it in an image, what all share left out; infinity where images
            do not decide the motion without a penalty [µm].
        held: standard deviation of what the penalty may hold back of the elongation of an image,
            alike in all [µm].
    """

    elongation: FloatArray
    sigma: float
    held: float


def grip_motion(
    stage: FloatArray,
    elongation: FloatArray,
    sigma: float,
    phase: IntArray,
    used: BoolArray,
    nominal: float,
    free: WithoutPenalty,
) -> GripMotion:
    """Check the motion of the grips.

    Args:
        stage: stage travel at each image [µm], shape (T,).
        elongation: of the specimen, by correlation [µm], shape (T,).
        sigma: standard deviation of it, without the part that all images share with their
            reference (it moves no slope) [µm].
        phase: in which phase each image lies, not decreasing; the turning image ends its phase,
            shape (T,).
        used: images that are not left out, shape (T,).
        nominal: length of the specimen over the distance of the grips.
        free: the elongation without regularisation.
    """
    of_phase = [np.flatnonzero(used & (phase == p)) for p in np.unique(phase)]
    of_phase = [images for images in of_phase if _spread(stage[images])]
    outliers = _outliers(stage, elongation, sigma, of_phase)
    kept = [np.setdiff1d(images, outliers) for images in of_phase]
    kept = [images for images in kept if _spread(stage[images])]
    lines = [_Line.through(stage[images], elongation[images], 1) for images in kept]
    square = sum(line.square for line in lines)
    freedom = sum(line.freedom for line in lines)
    scatter = float(np.sqrt(square / freedom) / sigma) if freedom else 1.0
    noise = sigma * max(scatter, 1.0)
    together = np.concatenate(kept)
    whole = _Line.through(stage[together], elongation[together], 1)
    wide = _scattered(noise, whole)
    share = free.held / float(np.sqrt(np.mean(elongation[together] ** 2)))
    ratio = _widened(whole.slope(wide), share)
    ratios = [line.slope(noise) for line in lines]
    unpenalised = np.isfinite(free.sigma)
    if unpenalised:
        line = _Line.through(stage[together], free.elongation[together], 1)
        alone = line.slope(_scattered(free.sigma, line))
        unpenalised = alone.sigma < ratio.sigma
    if unpenalised:
        ratio, share = alone, 0.0
        of_lines = [_Line.through(stage[images], free.elongation[images], 1) for images in kept]
        ratios = [line.slope(_scattered(free.sigma, line)) for line in of_lines]
    return GripMotion(
        nominal=nominal,
        ratio=ratio,
        held=share,
        unpenalised=bool(unpenalised),
        start=float(whole.at(np.zeros(1))[0]),
        scatter=scatter,
        phases=tuple(
            Phase(
                bool(stage[images[-1]] > stage[images[0]]), int(images[0]), int(images[-1]),
                slope, _bow(stage[images], elongation[images], noise),
            )
            for images, slope in zip(kept, ratios, strict=True)
        ),
        turns=tuple(_turns(stage, kept, lines, noise)),
        slips=tuple(_slips(stage, elongation, kept, sigma)),
        outliers=tuple(outliers),
        line=whole.at(stage),
        line_sigma=whole.deviation(stage, wide),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Line:
    """A polynomial by least squares, in stage travel about `centre` in units of `length`."""

    centre: float
    length: float
    coefficients: FloatArray
    inverse: FloatArray
    square: float
    freedom: int

    @classmethod
    def through(cls, stage: FloatArray, value: FloatArray, degree: int) -> _Line:
        centre, length = float(np.mean(stage)), float(np.ptp(stage)) / 2
        basis = np.vander((stage - centre) / length, degree + 1, increasing=True)
        inverse: FloatArray = np.linalg.inv(basis.T @ basis).astype(np.float64)
        coefficients = inverse @ basis.T @ value
        rest = value - basis @ coefficients
        return cls(
            centre, length, coefficients, inverse, float(rest @ rest), stage.size - degree - 1
        )

    def _basis(self, stage: FloatArray) -> FloatArray:
        return np.vander((stage - self.centre) / self.length, len(self.coefficients), True)

    def at(self, stage: FloatArray) -> FloatArray:
        return np.asarray(self._basis(stage) @ self.coefficients)

    def deviation(self, stage: FloatArray, noise: float) -> FloatArray:
        basis = self._basis(stage)
        return np.asarray(noise * np.sqrt(np.sum(basis @ self.inverse * basis, axis=1)))

    def slope(self, noise: float) -> Estimate:
        sigma = noise * float(np.sqrt(self.inverse[1, 1]))
        return Estimate(float(self.coefficients[1]) / self.length, sigma / self.length)


def _scattered(noise: float, line: _Line) -> float:
    """Return the noise, or the scatter about a line if that is more."""
    return max(noise, float(np.sqrt(line.square / line.freedom))) if line.freedom else noise


def _widened(ratio: Estimate, share: float) -> Estimate:
    """Return a ratio that may be off by a share of itself, too."""
    return Estimate(ratio.value, float(np.hypot(ratio.sigma, share * ratio.value)))


def _spread(stage: FloatArray) -> bool:
    return stage.size > 1 and bool(np.ptp(stage) > 0)


def _limit(tests: int) -> float:
    """Return the standard deviations beyond which one of so many normal numbers is significant."""
    return float(normal_isf(_FAMILY / 2 / max(tests, 1)))


def _outliers(
    stage: FloatArray, elongation: FloatArray, sigma: float, of_phase: Sequence[IntArray]
) -> list[int]:
    """Images off the parabola of their phase, the worst taken out first."""
    limit = _limit(sum(images.size for images in of_phase))
    outliers: list[int] = []
    for images in of_phase:
        rest = images
        while rest.size > 2 * _SIDE:
            off = elongation[rest] - _Line.through(stage[rest], elongation[rest], 2).at(stage[rest])
            spread = max(sigma, _ROBUST * float(np.median(np.abs(off))))
            worst = int(np.argmax(np.abs(off)))
            if abs(off[worst]) <= limit * spread:
                break
            outliers.append(int(rest[worst]))
            rest = np.delete(rest, worst)
    return sorted(outliers)


def _bow(stage: FloatArray, elongation: FloatArray, noise: float) -> Estimate | None:
    if stage.size < 4 or np.unique(stage).size < 3:
        return None
    line = _Line.through(stage, elongation, 2)
    # Between −1 and 1 the parabola a t² is a below its chord half-way.
    sigma = noise * float(np.sqrt(line.inverse[2, 2]))
    return Estimate(-float(line.coefficients[2]), sigma)


def _turns(
    stage: FloatArray, kept: Sequence[IntArray], lines: Sequence[_Line], noise: float
) -> list[Turn]:
    turns = []
    for k in range(1, len(kept)):
        turn = int(kept[k - 1][-1])
        at = stage[[turn]]
        direction = np.sign(stage[kept[k][-1]] - at[0])
        gap = lines[k].at(at)[0] - lines[k - 1].at(at)[0]
        sigma = np.hypot(lines[k].deviation(at, noise)[0], lines[k - 1].deviation(at, noise)[0])
        turns.append(Turn(turn, Estimate(float(-direction * gap), float(sigma))))
    return turns


def _slips(
    stage: FloatArray, elongation: FloatArray, kept: Sequence[IntArray], sigma: float
) -> list[Slip]:
    """Return the largest break of each phase that is significant, beside its parabola."""
    places = [range(_SIDE, images.size - _SIDE + 1) for images in kept]
    limit = _limit(sum(len(of) for of in places))
    slips = []
    for images, at in zip(kept, places, strict=True):
        scaled = (stage[images] - stage[images].mean()) / max(np.ptp(stage[images]), 1e-300)
        parabola = np.vander(scaled, 3, increasing=True)
        best: Slip | None = None
        for place in at:
            after = (np.arange(images.size) >= place).astype(np.float64)
            basis = np.column_stack([parabola, after])
            if np.linalg.matrix_rank(basis) < 4:
                continue
            inverse = np.linalg.inv(basis.T @ basis)
            jump = float((inverse @ basis.T @ elongation[images])[3])
            rest = elongation[images] - basis @ (inverse @ basis.T @ elongation[images])
            freedom = max(images.size - 4, 1)
            wide = max(sigma, float(np.sqrt(rest @ rest / freedom)))
            slip = Slip(int(images[place]), Estimate(jump, wide * float(np.sqrt(inverse[3, 3]))))
            if slip.jump.is_beyond(limit) and (
                best is None or abs(jump) / slip.jump.sigma > abs(best.jump.value) / best.jump.sigma
            ):
                best = slip
        if best is not None:
            slips.append(best)
    return slips
