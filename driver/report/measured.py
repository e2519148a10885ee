"""What free correlation has measured, as the pictures and their captions need it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from driver.dic.grip_check import GripMotion, WithoutPenalty, grip_motion
from driver.report.maps import Face
from meshes.arrays import BoolArray, FloatArray, IntArray

DATASETS = (
    "stage", "cycle", "reference", "pixel", "origin", "rows", "cols", "motion", "coefficients",
    "covariance_one", "n_reference", "nodes_uv", "nodes_w", "cells_uv", "cells_w", "residual",
    "residual_over_noise", "chi", "sigma", "converged", "stopped", "penalty", "roughness",
    "roughness_estimated", "travel_length", "smoother",
    *(f"{reading}{part}" for reading in ("elongation", "tilt", "mean_w")
      for part in ("", "_covariance", "_held", "_single")),
    "phase", "left_out", "grip/nominal", "grip/sigma",
    "grip/unpenalised_sigma", "elongation_unpenalised",
)  # fmt: skip
FIELDS = ("motion", "residual", "residual_over_noise")  # at all pixels in all images
BINS = np.linspace(-6.0, 6.0, 97)  # of ρ/σ
FAR = 3.0  # σ beyond which residuals are counted
BAND = 1.96  # standard deviations of a 95 % band
SHOWN = 4  # images at most that are shown as maps
_LARGEST_SHIFT = 0.08  # of the region's length, that the drawn mesh may move by


@dataclass(frozen=True, eq=False)
class Curve:
    """A measured number of each of T images.

    Attributes:
        value: its values [µm], shape (T,).
        sigma: standard deviation of each, the reference's noise included [µm], shape (T,).
        held: of what the penalty may hold back, contained in `sigma` [µm].
        single: median of `sigma` without smoothing along stage travel [µm].
    """

    value: FloatArray
    sigma: FloatArray
    held: float
    single: float

    @property
    def typical(self) -> float:
        """Median of `sigma` [µm]."""
        return float(np.median(self.sigma))


@dataclass(frozen=True, eq=False)
class Spread:
    """How ρ/σ of all pixels and images is distributed.

    Attributes:
        counts: residuals in each of `BINS`, what lies beyond them in the last ones.
        far: how many lie beyond `FAR`.
        farthest: the largest distance from 0.
        deviation: standard deviation.
    """

    counts: IntArray
    far: int
    farthest: float
    deviation: float

    @property
    def n(self) -> int:
        """Number of residuals."""
        return int(self.counts.sum())

    @staticmethod
    def of(images: Iterable[FloatArray]) -> Spread:
        """Count the residuals of each image, NaN where it lacks the pixel."""
        counts, far, farthest = np.zeros(BINS.size - 1, dtype=np.int64), 0, 0.0
        total, squares = 0.0, 0.0
        for image in images:
            seen = image[np.isfinite(image)].astype(np.float64)
            counts += np.histogram(np.clip(seen, BINS[0], BINS[-1]), BINS)[0]
            far += int(np.count_nonzero(np.abs(seen) > FAR))
            farthest = max(farthest, float(np.abs(seen).max(initial=0.0)))
            total += float(seen.sum())
            squares += float((seen**2).sum())
        n = max(int(counts.sum()), 1)
        return Spread(counts, far, farthest, float(np.sqrt(squares / n - (total / n) ** 2)))


@dataclass(frozen=True)
class Regularisation:
    """What kept the motion in bounds.

    Attributes:
        penalty: name of it, as in the case.
        roughness: what it grants [px]; infinity for no penalty.
        estimated: whether the images themselves said so.
        travel: stage travel below which changes count as noise [µm]; 0 for no smoothing.
    """

    penalty: str
    roughness: float
    estimated: bool
    travel: float


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """Motion and residuals of free correlation, T images, n_pix pixels.

    Of fields only those of the images that are shown are here, n_shown of them.

    Attributes:
        face: where the pixels are.
        level: height of a grey level [µm].
        reference: reference height map [µm], shape (rows, columns).
        stage: stage travel [µm], shape (T,).
        cycle: cycle of each image, from 1, shape (T,).
        motion: u, v, w less their mean over the pixels [µm], shape (n_shown, n_pix, 3).
        nodes_uv: nodes of u and v (X, Y) [µm], shape (n_uv, 2).
        nodes_w: nodes of w [µm], shape (n_w, 2).
        cells_uv: corners of the elements of u and v, shape (n, n_corners).
        cells_w: the same of w.
        nodal_uv: u, v of the nodes less the same mean [µm], shape (n_shown, n_uv, 2).
        residual: ρ [µm], NaN where an image lacks the pixel, shape (n_shown, n_pix).
        standardised: ρ over the standard deviation that noise gives it, degrees of freedom
            counted: its root mean square over an image is χ, shape (n_shown, n_pix).
        spread: of `standardised` in all images.
        chi: χ of each image, shape (T,).
        converged: whether the correlation of each image did, shape (T,).
        stopped: why it ended, and what to try where it failed, length T.
        regularisation: what kept the motion in bounds.
        nodal_sigma: standard deviation of a nodal value of u, v, w [µm], median over the nodes,
            shape (3,).
        sigma: standard deviation of the height noise at a pixel of one image [µm].
        n_reference: number of images averaged into the reference.
        elongation: v of the end S+ less that of S−.
        tilt: w of the end S+ less that of S−.
        mean_w: mean of w over the region of interest.
        grip: how the elongation follows the stage travel.
        grip_sigma: standard deviation of an elongation there, without what all images share [µm].
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
    spread: Spread
    chi: FloatArray
    converged: BoolArray
    stopped: tuple[str, ...]
    regularisation: Regularisation
    nodal_sigma: FloatArray
    sigma: float
    n_reference: int
    elongation: Curve
    tilt: Curve
    mean_w: Curve
    grip: GripMotion
    grip_sigma: float

    @property
    def shown(self) -> IntArray:
        """The images shown as maps: ends of loading phases, at most `SHOWN`, the last included."""
        return _shown(self.stage, self.cycle)

    @property
    def exaggeration(self) -> float:
        """1, 2 or 5 times a power of ten, at least 1, by which maps enlarge the motion."""
        largest = float(np.abs(self.motion[..., :2]).max())
        length = self.face.pixel * (max(np.ptp(self.face.rows), np.ptp(self.face.cols)) + 1)
        return max(_round_down(_LARGEST_SHIFT * length / largest), 1.0) if largest > 0 else 1.0


def measured_motion(
    datasets: Mapping[str, Any], level: float, traces: FloatArray
) -> MeasuredMotion:
    """Return the motion from the datasets of `measure.h5`.

    Args:
        datasets: value of each of `DATASETS`; of `FIELDS` one image at a time is asked for.
        level: height of a grey level [µm].
        traces: ends (X, Y) of each grain boundary [µm], shape (n, 2, 2).
    """
    m = datasets
    cycle = m["cycle"].astype(np.int64)
    shown = _shown(m["stage"], cycle)
    motion, residual, standardised = (np.stack([m[name][t] for t in shown]) for name in FIELDS)
    mean = motion.mean(axis=1, keepdims=True)
    n_uv = len(m["nodes_uv"])
    nodal = m["coefficients"][shown]
    nodal = np.stack([nodal[:, :n_uv], nodal[:, n_uv : 2 * n_uv]], axis=-1)
    # What smoothing along travel leaves of the noise of an image; nothing of what all share.
    left = float(np.median((m["smoother"] ** 2).sum(axis=1)))
    # Rounding may leave a node that no pixel sees a variance just below zero.
    variance = np.maximum(np.diag(m["covariance_one"]), 0.0)
    nodal_sigma = np.sqrt(variance * (left + 1.0 / float(m["n_reference"])))
    row, column = m["origin"].tolist()
    return MeasuredMotion(
        face=Face(
            m["rows"].astype(np.int64), m["cols"].astype(np.int64), float(m["pixel"]),
            (row, column), traces,
        ),
        level=level,
        reference=m["reference"],
        stage=m["stage"],
        cycle=cycle,
        motion=motion - mean,
        nodes_uv=m["nodes_uv"],
        nodes_w=m["nodes_w"],
        cells_uv=m["cells_uv"].astype(np.int64),
        cells_w=m["cells_w"].astype(np.int64),
        nodal_uv=nodal - mean[..., :2],
        residual=residual,
        standardised=standardised,
        spread=Spread.of(m["residual_over_noise"]),
        chi=m["chi"],
        converged=m["converged"] > 0,
        stopped=tuple(_text(why) for why in m["stopped"]),
        regularisation=Regularisation(
            penalty=_text(m["penalty"]),
            roughness=float(m["roughness"]) / float(m["pixel"]),
            estimated=bool(m["roughness_estimated"]),
            travel=float(m["travel_length"]),
        ),
        nodal_sigma=np.array([np.median(part) for part in np.split(nodal_sigma, [n_uv, 2 * n_uv])]),
        sigma=float(m["sigma"]),
        n_reference=int(m["n_reference"]),
        elongation=_curve(m, "elongation"),
        tilt=_curve(m, "tilt"),
        mean_w=_curve(m, "mean_w"),
        grip=grip_motion(
            m["stage"], m["elongation"], float(m["grip/sigma"]), m["phase"].astype(np.int64),
            m["left_out"] == 0, float(m["grip/nominal"]),
            WithoutPenalty(
                m["elongation_unpenalised"], float(m["grip/unpenalised_sigma"]),
                float(m["elongation_held"]),
            ),
        ),
        grip_sigma=float(m["grip/sigma"]),
    )  # fmt: skip


def _curve(m: Mapping[str, FloatArray], name: str) -> Curve:
    held = float(m[f"{name}_held"])
    sigma = np.sqrt(m[f"{name}_covariance"].diagonal() + held**2)
    return Curve(m[name], sigma, held, float(m[f"{name}_single"]))


def _shown(stage: FloatArray, cycle: IntArray) -> IntArray:
    ends = peaks(stage, cycle)
    chosen = np.unique(np.linspace(0, len(ends) - 1, min(len(ends), SHOWN)).round())
    return ends[chosen.astype(np.int64)]


def _text(value: NDArray[np.generic]) -> str:
    return bytes(value.item()).decode("utf-8")


def peaks(stage: FloatArray, cycle: IntArray) -> IntArray:
    """Return the image at the largest stage travel of each cycle: the end of its loading.

    Args:
        stage: stage travel [µm], shape (T,).
        cycle: cycle of each image, shape (T,).
    """
    of_cycle = [np.flatnonzero(cycle == c) for c in np.unique(cycle)]
    return np.array([images[np.argmax(stage[images])] for images in of_cycle])


def phases(stage: FloatArray, cycle: IntArray) -> list[tuple[bool, IntArray]]:
    """Return loading and unloading phases in their order: whether it loads, and its images.

    Each but the first begins with the last image of the one before it, so that curves are
    closed. A cycle without unloading has none.

    Args:
        stage: stage travel [µm], shape (T,).
        cycle: cycle of each image, shape (T,).
    """
    phases_of_test: list[tuple[bool, IntArray]] = []
    start = 0
    for peak in peaks(stage, cycle).tolist():
        last = int(np.flatnonzero(cycle == cycle[peak])[-1])
        phases_of_test.append((True, np.arange(start, peak + 1)))
        if last > peak:
            phases_of_test.append((False, np.arange(peak, last + 1)))
        start = last
    return phases_of_test


def _round_down(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value * 1.000001))
