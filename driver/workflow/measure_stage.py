"""Stage 2: the motion of the surface by free correlation."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import numpy as np

from driver.case.model import Case
from driver.common.errors import InputError
from driver.common.splines.images import variance_gain
from driver.dic.derived_quantities import readings, without_penalty
from driver.dic.engine import GAIN_ROUNDS
from driver.dic.grip_check import WithoutPenalty, grip_motion
from driver.dic.series import SurfaceMotion, measure
from driver.dic.surface_images import SurfaceImages, refine_gradient
from driver.dic.system import sensitivity
from driver.dic.temporal_smoothing import smoothed_motion
from driver.experiment.history import phase_of_images
from driver.experiment.images.heightmaps import ImageError, fill_off_surface
from driver.experiment.images.noise import TemporalNoise, temporal_noise
from driver.experiment.images.outliers import find_outliers, left_out, noise_levels, without
from driver.experiment.images.region import Excluded
from driver.forward.build import correlation_meshes
from driver.forward.geometry import boundary_traces
from driver.report.grip_texts import sentences
from driver.report.measured import FIELDS, measured_motion
from driver.report.measured_figures import write_figures
from driver.results.files import MEASURE
from driver.results.hdf5 import open_hdf5
from driver.results.measurement import MeasuredFields, Measurement, write_measurement
from driver.workflow.engine import StageContext
from driver.workflow.measure_messages import (
    how_turned,
    tell_contradiction,
    tell_frames,
    tell_gains,
    tell_images,
    tell_readings,
    tell_regularisation,
    tell_wrong_frames,
)
from driver.workflow.prepared_images import prepared_images
from meshes.arrays import BoolArray, FloatArray

logger = logging.getLogger(__name__)


_AT_A_TIME = 4096  # pixels, whose rows of a dense matrix fit into memory
_AROUND = 8  # px around the region, of whose heights gaps at its rim may be filled
_OTHER_SURFACE = 2.0  # χ of a frame that did not converge, beyond which it shows something else


def run_measure(context: StageContext) -> None:
    """Measure, and draw what was measured."""
    measure_numbers(context)
    written = open_hdf5(context.workdir / MEASURE, FIELDS)
    case = context.case
    write_figures(
        measured_motion(written, case.images.level_um, boundary_traces(case)), context.workdir
    )


def measure_numbers(context: StageContext) -> None:
    """Correct the images, correlate every frame, and find the motion of the edges; no pictures."""
    case = context.case
    prepared = prepared_images(context)
    experiment, images = prepared.experiment, prepared.images
    tell_images(images)
    for remark in experiment.remarks:
        logger.info(f"  {remark}")
    pixel, history = case.images.pixel_um, experiment.history
    rows = history.image_row
    images, single, gains = _with_gains(case, images)
    tell_regularisation(case, single)
    _refuse_another_surface(single, images)
    rigid = single.means()
    used = images.codes == Excluded.USED
    noise = noise_levels(_sampled(images), used[images.box(_AROUND)])
    outliers = without(images.is_reference, find_outliers(single.chi, noise, rigid, pixel, "σ"))
    left = left_out(outliers, images.n_frames) | single.lost | images.is_reference
    motion, smoother = _along_travel(case, single, images, history.stage[rows], ~left)
    read = readings(single, images, case.specimen.length, motion, smoother)
    free = without_penalty(single, images, case.specimen.length)
    tell_readings(single, motion, read)
    tell_frames(single, outliers, left, read["elongation"])
    tell_gains(gains, single.gains.sigma)
    doubtful = left | ~single.converged
    tell_wrong_frames(images, single, doubtful, read["elongation"], history.stage[rows])
    refined = refine_gradient(images, motion.fields)
    later = _temporal(images, refined.gradient, single, ~left)
    if images.of_series:
        seen = np.nan if later is None else later.sigma
        tell_contradiction(images.sigma, seen, single.chi[~left])
    if later is not None:
        logger.info(
            f"  noise {1e3 * later.sigma:.2f} nm from frame to frame, larger than that at "
            f"{np.count_nonzero(later.larger)} pixels"
        )
    nominal = case.specimen.length / case.history.grip_distance
    grip = grip_motion(
        history.stage[rows],
        read["elongation"].value,
        read["elongation"].own,
        phase_of_images(history),
        ~left,
        nominal,
        WithoutPenalty(free.value, free.sigma, read["elongation"].held),
    )
    for line in sentences(grip):
        logger.info(f"  {line}")
    write_measurement(
        context.workdir,
        Measurement(
            case, experiment, images, motion, read, free, grip, refined.gradient, rigid,
            _fields(images, motion), left, noise, later, smoother, gains,
        ),
    )  # fmt: skip


def _with_gains(
    case: Case, images: SurfaceImages
) -> tuple[SurfaceImages, SurfaceMotion, FloatArray]:
    """Measure, and again where frames show the relief larger or smaller than the reference.

    Returns:
        The images with these frames brought to its height, their motion, and the gains by which
        their heights were divided, shape (T,).
    """
    gains = np.ones(images.n_frames)
    for last in range(GAIN_ROUNDS):
        as_high = images.rescaled(gains)
        motion = measure(
            as_high,
            *correlation_meshes(case),
            roughness=case.dic.roughness_um(images.pixel),
            workers=case.execution.processes,
            penalty=case.dic.penalty,
        )
        off = motion.gains.off(np.ones(images.n_frames))
        if not off.any() or last == GAIN_ROUNDS - 1:
            break
        gains = np.where(off, gains * motion.gains.value, gains)
    return as_high, motion, gains


def _refuse_another_surface(motion: SurfaceMotion, images: SurfaceImages) -> None:
    """Refuse a series of which more than half cannot be followed.

    Raises:
        InputError: the frames do not show the surface of the reference.
    """
    astray = motion.lost | (~motion.converged & (motion.chi > _OTHER_SURFACE))
    if 2 * np.count_nonzero(astray) > astray.size:
        first = int(np.argmax(astray))
        why = how_turned(images, first) or motion.reason[first]
        surface = "frame 0" if images.of_series else "images.repeats"
        raise InputError(
            f"images.frames: found {np.count_nonzero(astray)} of {astray.size} frames that cannot "
            f"be followed (frame {first} {why}), expected the surface of {surface}"
        )


def _along_travel(
    case: Case, single: SurfaceMotion, images: SurfaceImages, stage: FloatArray, kept: BoolArray
) -> tuple[SurfaceMotion, FloatArray]:
    """Return the motion smoothed as the case asks for, and the smoother."""
    if case.dic.travel_um is None:
        return single, np.eye(images.n_frames)
    try:
        return smoothed_motion(single, images, stage, case.dic.travel_um, kept)
    except ImageError as error:
        raise InputError(f"dic.travel_um: {error}") from None


def _sampled(images: SurfaceImages) -> Iterator[FloatArray]:
    """Return the frames around the region as sampled, extended over gaps, one after the other."""
    x, y = (
        (at - start) * images.pixel
        for at, start in zip(
            np.mgrid[images.box(_AROUND)].astype(np.float64), images.frames.origin, strict=True
        )
    )
    seen = (images.frames.value(t, x, y) for t in range(images.n_frames))
    return (fill_off_surface(heights, np.isfinite(heights)) for heights in seen)


def _fields(images: SurfaceImages, motion: SurfaceMotion) -> Iterator[MeasuredFields]:
    """Motion and residuals at the pixels, some frames at a time."""
    for index, some in images.blocks():
        fields = motion.fields[index]
        residual = some.residual(fields)
        standardised = residual / np.sqrt(images.expected_residual_variance(fields))
        # The fit has taken its degrees of freedom out of the residual: χ counts them, so does
        # this.
        square = np.nansum(standardised**2, axis=1) / np.maximum(
            np.isfinite(standardised).sum(axis=1), 1
        )
        chi = motion.chi[index] / np.sqrt(np.where(square > 0, square, 1.0))
        yield MeasuredFields(fields, residual, standardised * chi[:, None])


def _temporal(
    images: SurfaceImages, gradient: FloatArray, motion: SurfaceMotion, kept: BoolArray
) -> TemporalNoise | None:
    """Noise of the frames that are kept, from one to the next."""
    seen = sensitivity(gradient, motion.basis_uv, motion.basis_w)
    starts = range(0, seen.shape[0], _AT_A_TIME)
    some = (seen[first : first + _AT_A_TIME] for first in starts)
    taken = [((rows @ motion.covariance_one) * rows.toarray()).sum(axis=1) for rows in some]

    def residuals() -> Iterator[tuple[FloatArray, FloatArray]]:
        for t in np.flatnonzero(kept):
            index = np.array([t])
            field = motion.fields[index]
            moved = (images.xy + field[0, :, :2]) / images.pixel + images.frames.origin
            yield images.residual(field, index)[0], variance_gain(moved[:, 0], moved[:, 1])

    return temporal_noise(residuals(), np.concatenate(taken) / images.sigma**2)
