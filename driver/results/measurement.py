"""What is written of a measurement: datasets of `measure.h5` with their units, `measure.csv`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from driver.case.model import Case
from driver.dic.derived_quantities import Reading, Unpenalised
from driver.dic.grip_check import GripMotion
from driver.dic.series import SurfaceMotion
from driver.dic.surface_images import SurfaceImages
from driver.experiment.history import phase_of_images
from driver.experiment.images.noise import TemporalNoise
from driver.experiment.images.region import Excluded
from driver.experiment.reading import Experiment
from driver.results.files import MEASURE, MEASURE_CSV
from driver.results.hdf5 import FrameSeries, write_csv, write_hdf5
from meshes.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class MeasuredFields:
    """What free correlation found at n_pix pixels in m images that follow each other.

    Attributes:
        motion: u, v, w [µm], shape (m, n_pix, 3).
        residual: ρ [µm], NaN where an image lacks the pixel, shape (m, n_pix).
        standardised: ρ over its standard deviation by noise, shape (m, n_pix).
    """

    motion: FloatArray
    residual: FloatArray
    standardised: FloatArray


@dataclass(frozen=True, eq=False)
class Measurement:
    """What free correlation found, T images and n_pix pixels.

    Attributes:
        case: the case.
        experiment: history and loads.
        images: the corrected images.
        motion: the surface motion.
        read: elongation, tilt and mean of w by name.
        grip: the elongation beside the stage travel.
        gradient: ∂f/∂X, ∂f/∂Y at the pixels [-], shape (n_pix, 2).
        rigid: mean motion of each image without smoothing [µm], shape (T, 3).
        fields: motion and residuals at the pixels in all images, some images at a time.
        left: images that are left out, shape (T,).
        noise: noise of each image by its own high frequencies [µm], shape (T,).
        later: noise from frame to frame, None where too few images tell it.
        smoother: weights of the images along stage travel, shape (T, T).
        gains: by which the heights of each image were divided, 1 without, shape (T,).
    """

    case: Case
    experiment: Experiment
    images: SurfaceImages
    motion: SurfaceMotion
    read: Mapping[str, Reading]
    free: Unpenalised
    grip: GripMotion
    gradient: FloatArray
    rigid: FloatArray
    fields: Iterable[MeasuredFields]
    left: BoolArray
    noise: FloatArray
    later: TemporalNoise | None
    smoother: FloatArray
    gains: FloatArray


def write_measurement(folder: Path, measured: Measurement) -> None:
    """Write `measure.h5` and `measure.csv`.

    Args:
        folder: where they go.
        measured: what was found.
    """
    m, case, images, motion = measured, measured.case, measured.images, measured.motion
    experiment, history, grip = m.experiment, m.experiment.history, m.grip
    read, rows, pixel = m.read, history.image_row, case.images.pixel_um
    rigid, left, later = m.rigid, m.left, m.later
    nominal = case.specimen.length / case.history.grip_distance
    nowhere = np.full(len(images.xy), np.nan)
    write_hdf5(
        folder / MEASURE,
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
            "gradient": (m.gradient, "1"),
            "sigma": (images.sigma, "µm"),
            "n_reference": (float(images.n_reference), "1"),
            "noise_dof": (float(images.noise_dof), "1"),
            "sigma_flat": (images.sigma_flat, "µm"),
            "codes": (images.codes, ", ".join(f"{code.value} {code.name}" for code in Excluded)),
            "noise_frame": (m.noise, "µm"),
            "noise_later": (np.nan if later is None else later.sigma, "µm"),
            "noise_later_dof": (0.0 if later is None else later.dof, "1"),
            "noise_map": (nowhere if later is None else later.map, "µm"),
            "noise_map_dof": (0.0 if later is None else later.map_dof, "1"),
            "noise_larger": (np.zeros(len(nowhere)) if later is None else later.larger, "1"),
            "rigid": (rigid, "µm"),
            "left_out": (left.astype(np.float64), "1"),
            "phase": (phase_of_images(history), "1"),
            "grip/nominal": (nominal, "1"),
            "grip/sigma": (read["elongation"].own, "µm"),
            "elongation_unpenalised": (m.free.value, "µm"),
            "grip/unpenalised_sigma": (m.free.sigma, "µm"),
            "grip/ratio": (grip.ratio.value, "1"),
            "grip/ratio_sigma": (grip.ratio.sigma, "1"),
            "grip/scatter": (grip.scatter, "1"),
            "coefficients": (motion.coefficients, "µm"),
            "covariance_one": (motion.covariance_one, "µm²"),
            "nodes_uv": (motion.basis_uv.nodes, "µm"),
            "nodes_w": (motion.basis_w.nodes, "µm"),
            "cells_uv": (motion.basis_uv.mesh.corners, "1"),
            "cells_w": (motion.basis_w.mesh.corners, "1"),
            "chi": (motion.chi, "1"),
            "iterations": (motion.iterations, "1"),
            "gain": (m.gains, "1"),
            "converged": (motion.converged.astype(np.float64), "1"),
            "stopped": (np.char.encode(motion.reason, "utf-8"), "text"),
            "penalty": (np.array(case.dic.penalty.encode()), "text"),
            "roughness": (motion.roughness, "µm"),
            "roughness_estimated": (float(case.dic.roughness_px == "estimated"), "1"),
            "travel_length": (case.dic.travel_um or 0.0, "µm"),
            "smoother": (m.smoother, "1"),
            **_of_readings(read),
        },
        series=FrameSeries(
            n_frames=images.n_frames,
            units={"motion": "µm", "residual": "µm", "residual_over_noise": "1"},
            blocks=(
                {
                    "motion": some.motion,
                    "residual": some.residual.astype(np.float32),
                    "residual_over_noise": some.standardised.astype(np.float32),
                }
                for some in m.fields
            ),
        ),
    )
    write_csv(
        folder / MEASURE_CSV,
        {
            "image": range(images.n_frames),
            "time_s": history.time[rows].tolist(),
            "stage_um": history.stage[rows].tolist(),
            "force_uN": experiment.force.tolist(),
            "elongation_nm": (1e3 * read["elongation"].value).tolist(),
            "tilt_nm": (1e3 * read["tilt"].value).tolist(),
            "chi": motion.chi.tolist(),
            "shift_X_nm": (1e3 * rigid[:, 0]).tolist(),
            "shift_Y_nm": (1e3 * rigid[:, 1]).tolist(),
            "shift_Z_nm": (1e3 * rigid[:, 2]).tolist(),
            "gain": m.gains.tolist(),
            "left_out": left.astype(int).tolist(),
            "converged": motion.converged.astype(int).tolist(),
            "stopped": motion.reason,
        },
    )


def _of_readings(read: Mapping[str, Reading]) -> dict[str, tuple[FloatArray | float, str]]:
    datasets: dict[str, tuple[FloatArray | float, str]] = {}
    for name, reading in read.items():
        datasets[name] = (reading.value, "µm")
        datasets[f"{name}_sigma"] = (float(np.median(reading.sigma)), "µm")
        datasets[f"{name}_covariance"] = (reading.covariance, "µm²")
        datasets[f"{name}_single"] = (reading.single, "µm")
        datasets[f"{name}_held"] = (reading.held, "µm")
    return datasets
