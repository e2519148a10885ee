"""What is told of a measured motion: how it was held, how sure it is, which frames are doubtful."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from driver.case.model import Case
from driver.common.splines.images import samples
from driver.dic.derived_quantities import Reading
from driver.dic.series import SurfaceMotion
from driver.dic.surface_images import SurfaceImages
from driver.dic.wrong_frames import exchanged, jumps, turned
from driver.experiment.images.heightmaps import fill_off_surface, on_surface
from driver.experiment.images.outliers import Outlier, texts_by_frame
from driver.experiment.images.region import Excluded
from driver.experiment.images.stated_noise import COST, contradiction
from meshes.arrays import BoolArray, FloatArray

logger = logging.getLogger(__name__)


_LOOKED_AT = 20  # frames that cannot be followed, of which it is asked whether they are mirrored
_TOLD = 5  # frames at most, of which it is told why they stopped
_STRETCHED = 5.0  # σ of the elongation before loading, beyond which the images are in doubt


def tell_images(images: SurfaceImages) -> None:
    """Tell how many images and pixels there are, and where their noise comes from."""
    noise = f"noise {1e3 * images.sigma:.2f}"
    if images.of_series:
        noise += " nm as stated, no repeats"
    else:
        error = images.sigma / np.sqrt(2 * images.noise_dof)
        noise += f" ± {1e3 * error:.2f} nm from {images.n_reference} repeats"
    logger.info(
        f"  {images.n_frames} frames, {len(images.xy)} pixels, {noise}, "
        f"{np.count_nonzero(images.codes == Excluded.DUST)} pixels with dust"
    )
    if images.of_series:
        logger.info(f"  without repeats {COST}")
    if images.repeat_stretch is not None and images.repeat_stretch.told:
        logger.info(f"  WARNING: {images.repeat_stretch.told}")


def tell_contradiction(stated: float, seen: float, chi: FloatArray) -> None:
    """Tell that a stated noise is not that of the images; the arguments as of `contradiction`."""
    told = contradiction(stated, seen, chi)
    if told:
        logger.info(f"  WARNING: {told}")


def tell_regularisation(case: Case, motion: SurfaceMotion) -> None:
    """Tell the meshes, the penalty and the roughness that it grants."""
    for name, basis in (("u, v", motion.basis_uv), ("w", motion.basis_w)):
        logger.info(
            f"  mesh of {name}: {len(basis.mesh.cells)} {basis.mesh.kind}, {len(basis.nodes)} "
            f"nodes, {basis.element_size / case.images.pixel_um:.1f} px"
        )
    if np.isinf(motion.roughness):
        logger.info("  no regularisation")
    else:
        how = "estimated" if case.dic.roughness_px == "estimated" else "as stated"
        logger.info(
            f"  regularisation {case.dic.penalty}, roughness "
            f"{motion.roughness / case.images.pixel_um:.3g} px ({how})"
        )
    if motion.ridge:
        logger.info("  the images do not decide every nodal value: a ridge holds the others")


def tell_readings(single: SurfaceMotion, motion: SurfaceMotion, read: dict[str, Reading]) -> None:
    """How much of the images entered, and how sure the elongation is.

    Args:
        single: motion of each image by itself.
        motion: the same smoothed along stage travel, or `single` itself.
        read: numbers read from it, by name.
    """
    lacking, told = ~single.compared & ~single.lost[:, None], motion.chi > 0
    if lacking.any():
        frames = lacking.any(axis=1)
        logger.info(
            f"  {np.count_nonzero(frames)} frames lack heights on the face, frame "
            f"{int(lacking.sum(axis=1).argmax())} at most, at {lacking.sum(axis=1).max()} pixels: "
            "they are left out there"
        )
    elongation = read["elongation"]
    sigma = 1e3 * np.median(elongation.sigma)
    chi = np.sqrt(np.mean(motion.chi[told] ** 2))
    logger.info(
        f"  χ of free correlation {chi:.3f}, elongation ± {sigma:.1f} "
        f"nm an image, of which {1e3 * elongation.held:.1f} nm are what the penalty may hold back"
    )
    if motion is not single:
        logger.info(
            f"  smoothed along stage travel (± {1e3 * elongation.single:.1f} nm an image without); "
            "neighbouring images are correlated, elongation_covariance says how much"
        )


def tell_frames(
    motion: SurfaceMotion,
    outliers: Sequence[Outlier],
    left: BoolArray,
    elongation: Reading,
) -> None:
    """Frames that are unlike others, lost, not converged, or stretched before the loading.

    Args:
        motion: motion of each image by itself.
        outliers: of the series.
        left: frames whose images are not fitted, shape (T,).
        elongation: against the reference.
    """
    for frame, what in texts_by_frame(outliers).items():
        kept = "its image is not fitted, its load is" if left[frame] else "it is kept"
        logger.info(f"  frame {frame} is unlike its neighbours: {what}; {kept}")
    for frame in np.flatnonzero(motion.lost).tolist():
        logger.info(
            f"  frame {frame}: {motion.reason[frame]}; its image is not fitted, its load is"
        )
    slow = np.flatnonzero(~motion.converged & ~motion.lost)
    for frame in slow[:_TOLD].tolist():
        logger.info(f"  frame {frame}: {motion.reason[frame]}")
    if slow.size > _TOLD:
        logger.info(f"  {slow.size - _TOLD} more frames did not converge: measure.csv says why")
    stretch, sigma = elongation.value[0], elongation.sigma[0]
    if not motion.lost[0] and abs(stretch) > _STRETCHED * sigma:
        longer = "longer" if stretch > 0 else "shorter"
        logger.info(
            f"  frame 0 is {1e3 * abs(stretch):.0f} nm {longer} than the repeats "
            f"({abs(stretch) / sigma:.0f} σ), expected no load on both: look at the order of "
            "images.frames"
        )


def tell_gains(gains: FloatArray, sigma: float) -> None:
    """Tell the frames that show the relief larger or smaller than the reference does.

    Args:
        gains: by which their heights were divided, 1 for those of the others, shape (T,).
        sigma: standard deviation of a gain by noise.
    """
    off = np.flatnonzero(gains != 1.0)
    for frame in off[:_TOLD].tolist():
        logger.info(
            f"  frame {frame} shows the relief {gains[frame]:.3f} ± {sigma:.3f} times as high as "
            "the reference does: its heights are divided by that; focus does the same, and bends "
            "the relief as well"
        )
    if off.size > _TOLD:
        logger.info(f"  {off.size - _TOLD} more frames show the relief larger or smaller")


def tell_wrong_frames(
    images: SurfaceImages,
    motion: SurfaceMotion,
    doubtful: BoolArray,
    elongation: Reading,
    stage: FloatArray,
) -> None:
    """Tell which frames are mirrored, exchanged with another, or far from the one before.

    Args:
        images: the series.
        motion: motion of each image by itself.
        doubtful: frames that cannot be followed or leave too much, shape (T,).
        elongation: against the reference.
        stage: stage travel at each image [µm], shape (T,).
    """
    for frame in np.flatnonzero(doubtful)[:_LOOKED_AT].tolist():
        way = how_turned(images, frame)
        if way:
            logger.info(f"  frame {frame} {way}: save it as the others are")
    followed = ~doubtful
    for first, second in exchanged(elongation.value, stage, elongation.own, followed):
        logger.info(
            f"  frames {first} and {second} look exchanged, for each has the elongation of the "
            "other: look at the order of images.frames and at their rows in the history"
        )
    for frame, (along_x, along_y) in jumps(motion.means()[:, :2] / images.pixel, followed):
        logger.info(
            f"  frame {frame} is shifted by {along_x:.0f} px along X and {along_y:.0f} px along Y "
            "against the one before: was the field of view moved or cropped otherwise?"
        )


def how_turned(images: SurfaceImages, frame: int) -> str:
    """Say how a frame shows the surface, if mirrored or turned, else nothing."""
    seen = samples(images.frames.coefficients[frame])
    valid = on_surface(seen)
    if not valid.any():
        return ""
    region = np.zeros(images.shape, dtype=bool)
    region[images.rows, images.cols] = True
    way = turned(images.reference_image, fill_off_surface(seen, valid), region)
    return f"shows the surface {way}" if way else ""
