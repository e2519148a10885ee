"""Stage 2: the motion of the surface by free correlation."""

from __future__ import annotations

import numpy as np

from driver.dic.elongation import edge_motion
from driver.dic.series import measure
from driver.dic.surface_images import refine_gradient
from driver.experiment import read_experiment
from driver.results import write_csv, write_hdf5
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
    motion = measure(
        images,
        case.dic.element_px * pixel,
        case.dic.height_element_px * pixel,
        workers=case.execution.processes,
    )
    # The region of interest ends short of the edges: its mean stretch is carried on to them.
    lower, upper = images.bounds[2:]
    reach = case.specimen.length / (upper - lower)
    edges = edge_motion(motion, images, lower, upper)
    refined = refine_gradient(images, motion.at_pixels())
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
            "motion": (motion.at_pixels(), "µm"),
            "coefficients": (motion.coefficients, "µm"),
            "covariance_one": (motion.covariance_one, "µm²"),
            "nodes_uv": (motion.basis_uv.nodes, "µm"),
            "nodes_w": (motion.basis_w.nodes, "µm"),
            "chi": (motion.chi, "1"),
            "elongation": (reach * edges.elongation, "µm"),
            "elongation_sigma": (reach * edges.elongation_sigma, "µm"),
            "tilt": (reach * edges.tilt, "µm"),
            "tilt_sigma": (reach * edges.tilt_sigma, "µm"),
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
