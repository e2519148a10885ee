"""Stage 2: the motion of the surface by free correlation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from driver.check_picture import boundary_trace
from driver.dic.basis import Basis
from driver.dic.elongation import edge_motion
from driver.dic.interpolation import variance_gain
from driver.dic.series import SurfaceMotion, measure, sensitivity
from driver.dic.surface_images import SurfaceImages, refine_gradient
from driver.errors import InputError
from driver.experiment import read_experiment
from driver.images.noise import TemporalNoise, temporal_noise
from driver.images.outliers import find_outliers, left_out, noise_levels, told
from driver.images.region import Excluded
from driver.report.measured import measured_motion
from driver.report.measured_figures import write_figures
from driver.results import read_hdf5, write_csv, write_hdf5
from driver.specimen import surface_images
from driver.stages import StageContext

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

_AT_A_TIME = 4096  # pixels, whose rows of a dense matrix fit into memory
_OTHER_SURFACE = 2.0  # χ of a frame that did not converge, beyond which it shows something else
_TOLD = 10  # frames in one line
_STRETCHED = 5.0  # σ of the elongation before loading, beyond which the images are in doubt
MEASURE, MEASURE_CSV = "measure.h5", "measure.csv"


def run_measure(context: StageContext) -> None:
    """Correct the images, correlate every frame, and find the motion of the edges."""
    case = context.case
    experiment = read_experiment(case)
    images = surface_images(case, experiment)
    context.log(
        f"  {images.n_frames} frames, {len(images.xy)} pixels, noise {1e3 * images.sigma:.2f} ± "
        f"{1e3 * images.sigma / np.sqrt(2 * images.noise_dof):.2f} nm from {images.n_reference} "
        f"repeats, {np.count_nonzero(images.codes == Excluded.DUST)} pixels with dust"
    )
    pixel = case.images.pixel_um
    motion = measure(
        images,
        case.dic.element_px * pixel,
        case.dic.height_element_px * pixel,
        workers=case.execution.processes,
    )
    astray = motion.lost | (~motion.converged & (motion.chi > _OTHER_SURFACE))
    if 2 * np.count_nonzero(astray) > images.n_frames:
        raise InputError(
            f"images.frames: found {np.count_nonzero(astray)} of {images.n_frames} frames that "
            f"cannot be followed (frame {np.argmax(astray)} {motion.reason[np.argmax(astray)]}), "
            "expected the surface of images.repeats"
        )
    # The region of interest ends short of the edges: its mean stretch is carried on to them.
    lower, upper = images.bounds[2:]
    reach = case.specimen.length / (upper - lower)
    edges = edge_motion(motion, images, lower, upper)
    at_pixels = motion.at_pixels()
    refined = refine_gradient(images, at_pixels)
    residual = images.residual(at_pixels)
    standardised = residual / np.sqrt(images.expected_residual_variance(at_pixels))
    # The fit has taken its degrees of freedom out of the residual: χ counts them, so does this.
    standardised *= (motion.chi / np.sqrt(np.mean(standardised**2, axis=1)))[:, None]
    mean_w = np.zeros(motion.coefficients.shape[1])
    mean_w[-len(motion.basis_w.nodes) :] = motion.basis_w.values.mean(axis=0)
    variance_w = mean_w @ motion.covariance_one @ mean_w * (1.0 + 1.0 / motion.n_reference)
    history = experiment.history
    rows = history.image_row
    context.log(
        f"  χ of free correlation {np.sqrt(np.mean(motion.chi**2)):.3f}, elongation "
        f"± {1e3 * reach * edges.elongation_sigma:.1f} nm an image, "
        f"{np.count_nonzero(~motion.converged)} frames not converged"
    )
    rigid = at_pixels.mean(axis=1)
    noise = noise_levels(_sampled(images), images.codes == Excluded.USED)
    outliers = find_outliers(motion.chi, noise, rigid, pixel, "σ")
    left = left_out(outliers, images.n_frames) | motion.lost
    for frame, what in told(outliers).items():
        kept = "its image is not fitted, its load is" if left[frame] else "it is kept"
        context.log(f"  frame {frame} is unlike its neighbours: {what}; {kept}")
    for frame in np.flatnonzero(motion.lost).tolist():
        context.log(f"  frame {frame} {motion.reason[frame]}; its image is not fitted, its load is")
    slow = np.flatnonzero(~motion.converged & ~motion.lost)
    if slow.size:
        some = ", ".join(map(str, slow[:_TOLD])) + (", …" if slow.size > _TOLD else "")
        context.log(f"  frame {some}: {motion.reason[slow[0]]}")
    deviation = edges.elongation[0] / edges.elongation_sigma
    if abs(deviation) > _STRETCHED:
        context.log(
            f"  frame 0 is {1e3 * reach * edges.elongation[0]:.0f} nm longer than the repeats "
            f"({deviation:.0f} σ), expected no load on both: look at the order of images.frames"
        )
    later = _temporal(images, refined.gradient, motion, ~left)
    if later is not None:
        context.log(
            f"  noise {1e3 * later.sigma:.2f} nm from frame to frame, larger than that at "
            f"{np.count_nonzero(later.larger)} pixels"
        )
    nowhere = np.full(len(images.xy), np.nan)
    write_hdf5(
        context.workdir / MEASURE,
        {
            "time": (history.time[rows], "s"),
            "stage": (history.stage[rows], "µm"),
            "cycle": (history.cycle, "1"),
            "force": (experiment.force, "µN"),
            "reference": (images.reference_image, "µm"),
            "pixel": (pixel, "µm"),
            "origin": (np.array(experiment.origin), "pixel"),
            "xy": (images.xy, "µm"),
            "rows": (images.rows, "pixel"),
            "cols": (images.cols, "pixel"),
            "gradient": (refined.gradient, "1"),
            "sigma": (images.sigma, "µm"),
            "n_reference": (float(images.n_reference), "1"),
            "noise_dof": (float(images.noise_dof), "1"),
            "sigma_flat": (images.sigma_flat, "µm"),
            "codes": (images.codes, ", ".join(f"{code.value} {code.name}" for code in Excluded)),
            "noise_frame": (noise, "µm"),
            "noise_later": (np.nan if later is None else later.sigma, "µm"),
            "noise_later_dof": (0.0 if later is None else later.dof, "1"),
            "noise_map": (nowhere if later is None else later.map, "µm"),
            "noise_map_dof": (0.0 if later is None else later.map_dof, "1"),
            "noise_larger": (np.zeros(len(nowhere)) if later is None else later.larger, "1"),
            "rigid": (rigid, "µm"),
            "left_out": (left.astype(np.float64), "1"),
            "motion": (at_pixels, "µm"),
            "coefficients": (motion.coefficients, "µm"),
            "covariance_one": (motion.covariance_one, "µm²"),
            "nodes_uv": (motion.basis_uv.nodes, "µm"),
            "nodes_w": (motion.basis_w.nodes, "µm"),
            "cells_uv": (element_corners(motion.basis_uv), "1"),
            "cells_w": (element_corners(motion.basis_w), "1"),
            "residual": (residual.astype(np.float32), "µm"),
            "residual_over_noise": (standardised.astype(np.float32), "1"),
            "chi": (motion.chi, "1"),
            "elongation": (reach * edges.elongation, "µm"),
            "elongation_sigma": (reach * edges.elongation_sigma, "µm"),
            "tilt": (reach * edges.tilt, "µm"),
            "tilt_sigma": (reach * edges.tilt_sigma, "µm"),
            "mean_w": (motion.coefficients @ mean_w, "µm"),
            "mean_w_sigma": (float(np.sqrt(variance_w)), "µm"),
        },
    )
    write_csv(
        context.workdir / MEASURE_CSV,
        {
            "image": range(images.n_frames),
            "time_s": history.time[rows].tolist(),
            "stage_um": history.stage[rows].tolist(),
            "force_uN": experiment.force.tolist(),
            "elongation_nm": (1e3 * reach * edges.elongation).tolist(),
            "tilt_nm": (1e3 * reach * edges.tilt).tolist(),
            "chi": motion.chi.tolist(),
            "shift_X_nm": (1e3 * rigid[:, 0]).tolist(),
            "shift_Y_nm": (1e3 * rigid[:, 1]).tolist(),
            "shift_Z_nm": (1e3 * rigid[:, 2]).tolist(),
            "left_out": left.astype(int).tolist(),
        },
    )
    written = read_hdf5(context.workdir / MEASURE)
    measured = measured_motion(written, case.images.level_um, boundary_trace(case))
    write_figures(measured, context.workdir)


def element_corners(basis: Basis) -> IntArray:
    """Nodes at the corners of each element in order around it, shape (n_elements, n_corners)."""
    corners = 3 if basis.mesh.kind.startswith("tri") else 4
    return basis.mesh.cells[:, :corners]


def _sampled(images: SurfaceImages) -> Iterator[FloatArray]:
    """The corrected frames as sampled, one after the other."""
    x, y = (
        (at - start) * images.pixel
        for at, start in zip(
            np.indices(images.shape, dtype=np.float64), images.frames.origin, strict=True
        )
    )
    return (images.frames.value(t, x, y) for t in range(images.n_frames))


def _temporal(
    images: SurfaceImages, gradient: FloatArray, motion: SurfaceMotion, kept: BoolArray
) -> TemporalNoise | None:
    """Noise of the frames that are kept, from one to the next."""
    frames, at_pixels = np.flatnonzero(kept), motion.at_pixels()[kept]
    moved = (images.xy + at_pixels[..., :2]) / images.pixel + images.frames.origin
    seen = sensitivity(gradient, motion.basis_uv, motion.basis_w)
    starts = range(0, seen.shape[0], _AT_A_TIME)
    some = (seen[first : first + _AT_A_TIME] for first in starts)
    taken = [((rows @ motion.covariance_one) * rows.toarray()).sum(axis=1) for rows in some]
    return temporal_noise(
        images.residual(at_pixels, frames),
        variance_gain(moved[..., 0], moved[..., 1]),
        np.concatenate(taken) / images.sigma**2,
    )
