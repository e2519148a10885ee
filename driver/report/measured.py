"""What free correlation has measured, as the pictures and their captions need it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from driver.grip_motion import GripMotion, grip_motion
from driver.report.maps import Face

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

DATASETS = (
    "stage", "cycle", "reference", "pixel", "origin", "rows", "cols", "motion", "coefficients",
    "covariance_one", "n_reference", "nodes_uv", "nodes_w", "cells_uv", "cells_w", "residual",
    "residual_over_noise", "chi", "sigma", "elongation", "elongation_sigma", "tilt", "tilt_sigma",
    "mean_w", "mean_w_sigma", "phase", "left_out", "grip/nominal",
)  # fmt: skip
BAND = 1.96  # standard deviations of a 95 % band
SHOWN = 4  # images at most that are shown as maps
_LARGEST_SHIFT = 0.08  # of the region's length, that the drawn mesh may move by


@dataclass(frozen=True, eq=False)
class Curve:
    """A measured number of each of T images.

    Attributes:
        value: its values [µm], shape (T,).
        sigma: standard deviation of each, the reference's noise included [µm].
    """

    value: FloatArray
    sigma: float


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """Motion and residuals of free correlation, T images, n_pix pixels.

    Attributes:
        face: where the pixels are.
        level: height of a grey level [µm].
        reference: reference height map [µm], shape (rows, columns).
        stage: stage travel [µm], shape (T,).
        cycle: cycle of each image, from 1, shape (T,).
        motion: u, v, w less their mean over the pixels of each image [µm], shape (T, n_pix, 3).
        nodes_uv: nodes of u and v (X, Y) [µm], shape (n_uv, 2).
        nodes_w: nodes of w [µm], shape (n_w, 2).
        cells_uv: corners of the elements of u and v, shape (n, n_corners).
        cells_w: the same of w.
        nodal_uv: u, v of the nodes less the same mean [µm], shape (T, n_uv, 2).
        residual: ρ [µm], shape (T, n_pix).
        standardised: ρ over the standard deviation that noise gives it, degrees of freedom
            counted: its root mean square over an image is χ, shape (T, n_pix).
        chi: χ of each image, shape (T,).
        nodal_sigma: standard deviation of a nodal value of u, v, w [µm], median over the nodes,
            shape (3,).
        sigma: standard deviation of the height noise at a pixel of one image [µm].
        elongation: v of the end S+ less that of S−.
        tilt: w of the end S+ less that of S−.
        mean_w: mean of w over the region of interest.
        grip: how the elongation follows the stage travel.
    """

    face: Face
    level: float
    reference: FloatArray
    stage: FloatArray
    cycle: IntArray
    motion: FloatArray
    nodes_uv: FloatArray
    nodes_w: FloatArray
    cells_uv: IntArray
    cells_w: IntArray
    nodal_uv: FloatArray
    residual: FloatArray
    standardised: FloatArray
    chi: FloatArray
    nodal_sigma: FloatArray
    sigma: float
    elongation: Curve
    tilt: Curve
    mean_w: Curve
    grip: GripMotion

    @property
    def shown(self) -> IntArray:
        """The images shown as maps: ends of loading phases, at most `SHOWN`, the last included."""
        ends = peaks(self.stage, self.cycle)
        chosen = np.unique(np.linspace(0, len(ends) - 1, min(len(ends), SHOWN)).round())
        return ends[chosen.astype(np.int64)]

    @property
    def exaggeration(self) -> float:
        """1, 2 or 5 times a power of ten, at least 1, by which maps enlarge the motion."""
        largest = float(np.abs(self.motion[self.shown, :, :2]).max())
        length = self.face.pixel * (max(np.ptp(self.face.rows), np.ptp(self.face.cols)) + 1)
        return max(_round_down(_LARGEST_SHIFT * length / largest), 1.0) if largest > 0 else 1.0


def measured_motion(
    datasets: Mapping[str, FloatArray], level: float, trace: FloatArray | None
) -> MeasuredMotion:
    """The motion from the datasets of `measure.h5`.

    Args:
        datasets: value of each of `DATASETS`.
        level: height of a grey level [µm].
        trace: ends (X, Y) of the grain boundary [µm], shape (2, 2), or None.
    """
    m = datasets
    mean = m["motion"].mean(axis=1, keepdims=True)
    n_uv = len(m["nodes_uv"])
    nodal = np.stack([m["coefficients"][:, :n_uv], m["coefficients"][:, n_uv : 2 * n_uv]], axis=-1)
    nodal_sigma = np.sqrt(np.diag(m["covariance_one"]) * (1.0 + 1.0 / float(m["n_reference"])))
    row, column = m["origin"].tolist()
    own = float(m["elongation_sigma"]) / np.sqrt(1.0 + 1.0 / float(m["n_reference"]))
    return MeasuredMotion(
        face=Face(
            m["rows"].astype(np.int64), m["cols"].astype(np.int64), float(m["pixel"]),
            (row, column), trace,
        ),
        level=level,
        reference=m["reference"],
        stage=m["stage"],
        cycle=m["cycle"].astype(np.int64),
        motion=m["motion"] - mean,
        nodes_uv=m["nodes_uv"],
        nodes_w=m["nodes_w"],
        cells_uv=m["cells_uv"].astype(np.int64),
        cells_w=m["cells_w"].astype(np.int64),
        nodal_uv=nodal - mean[..., :2],
        residual=m["residual"],
        standardised=m["residual_over_noise"],
        chi=m["chi"],
        nodal_sigma=np.array([np.median(part) for part in np.split(nodal_sigma, [n_uv, 2 * n_uv])]),
        sigma=float(m["sigma"]),
        elongation=Curve(m["elongation"], float(m["elongation_sigma"])),
        tilt=Curve(m["tilt"], float(m["tilt_sigma"])),
        mean_w=Curve(m["mean_w"], float(m["mean_w_sigma"])),
        grip=grip_motion(
            m["stage"], m["elongation"], own, m["phase"].astype(np.int64), m["left_out"] == 0,
            float(m["grip/nominal"]),
        ),
    )  # fmt: skip


def peaks(stage: FloatArray, cycle: IntArray) -> IntArray:
    """The image at the largest stage travel of each cycle: the end of its loading.

    Args:
        stage: stage travel [µm], shape (T,).
        cycle: cycle of each image, shape (T,).
    """
    of_cycle = [np.flatnonzero(cycle == c) for c in np.unique(cycle)]
    return np.array([images[np.argmax(stage[images])] for images in of_cycle])


def phases(stage: FloatArray, cycle: IntArray) -> list[tuple[bool, IntArray]]:
    """Loading and unloading phases in their order: whether it loads, and its images.

    Each but the first begins with the last image of the one before it, so that curves are
    closed. A cycle without unloading has none.

    Args:
        stage: stage travel [µm], shape (T,).
        cycle: cycle of each image, shape (T,).
    """
    found: list[tuple[bool, IntArray]] = []
    start = 0
    for peak in peaks(stage, cycle).tolist():
        last = int(np.flatnonzero(cycle == cycle[peak])[-1])
        found.append((True, np.arange(start, peak + 1)))
        if last > peak:
            found.append((False, np.arange(peak, last + 1)))
        start = last
    return found


def _round_down(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value * 1.000001))
