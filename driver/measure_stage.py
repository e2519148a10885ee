"""Stage 2: the motion of the surface by free correlation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from driver.check_picture import boundary_trace
from driver.dic.basis import Basis
from driver.dic.elongation import edge_motion
from driver.dic.series import measure
from driver.dic.surface_images import refine_gradient
from driver.experiment import read_experiment
from driver.report.measured import measured_motion
from driver.report.measured_figures import write_figures
from driver.results import read_hdf5, write_csv, write_hdf5
from driver.specimen import surface_images
from driver.stages import StageContext

MEASURE, MEASURE_CSV = "measure.h5", "measure.csv"


def run_measure(context: StageContext) -> None:
    """Correct the images, correlate every frame, and find the motion of the edges."""
    case = context.case
    experiment = read_experiment(case)
    images = surface_images(case, experiment)
    context.log(
        f"  {images.n_frames} frames, {len(images.xy)} pixels, noise {1e3 * images.sigma:.2f} nm"
    )
    pixel = case.images.pixel_um
    motion = measure(images, case.dic.element_px * pixel, case.dic.height_element_px * pixel)
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
    outliers = np.flatnonzero(motion.chi > 1.5 * np.median(motion.chi))
    if outliers.size:
        context.log(f"  frames unlike the others (look at them): {', '.join(map(str, outliers))}")
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
        },
    )
    written = read_hdf5(context.workdir / MEASURE)
    measured = measured_motion(written, case.images.level_um, boundary_trace(case))
    write_figures(measured, context.workdir)


def element_corners(basis: Basis) -> NDArray[np.int64]:
    """Nodes at the corners of each element in order around it, shape (n_elements, n_corners)."""
    along_x, along_y = basis.cells
    i, j = np.meshgrid(np.arange(along_x), np.arange(along_y), indexing="ij")
    first = (i * (along_y + 1) + j).ravel()
    return np.stack([first, first + 1, first + along_y + 2, first + along_y + 1], axis=1)
