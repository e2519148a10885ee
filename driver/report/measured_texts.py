"""Captions and alternative texts of the pictures of free correlation, with their numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from driver.common.formatting import chi, joined, number, with_sigma
from driver.report.grip_texts import sentences
from driver.report.measured import BAND, FAR, Curve, MeasuredMotion
from driver.report.measured_maps import COMPONENTS

PENALTIES = {
    "tikhonov": "Tikhonov, its second derivatives",
    "equilibrium_gap": "the equilibrium gap of an elastic sheet",
    "elastic": "the elastic energy",
}
_TOLD = 3  # images at most, of which it is said why they stopped
_FAR_SHARE = 0.0026998  # of a normal distribution, beyond 3 σ


@dataclass(frozen=True)
class PictureText:
    """What a picture shows: a caption for all, and words for those who do not see it."""

    caption: str
    alternative: str


def texts(measured: MeasuredMotion) -> dict[str, PictureText]:
    """Caption and alternative text of each picture, by the name of its file."""
    return {
        "measure_reference": _reference(measured),
        "measure_fields": _fields(measured),
        "measure_travel": _travel(measured),
        "measure_grip": _grip(measured),
        "measure_residuals": _residuals(measured),
        "measure_noise": _noise(measured),
    }


def difference_text(m: MeasuredMotion, rms: tuple[float, float, float]) -> str:
    """Return why measured and modelled motion need not agree, with numbers.

    Args:
        m: the measured motion.
        rms: root mean square of the difference in u, v, w [µm].
    """
    found = joined([number(1e3 * each, 2) for each in rms])
    noise = joined([number(1e3 * each, 2) for each in m.nodal_sigma.tolist()])
    smooth = f"the {len(m.cells_uv)} elements of u and v"
    if np.isfinite(m.regularisation.roughness):
        smooth += " and the penalty that keeps them smooth"
    return (
        f"The difference in u, v and w has a root mean square of {found} nm. Noise alone gives a "
        f"typical node of free correlation a standard deviation of {noise} nm, and {smooth} leave "
        f"out what bends within them: the maps need not agree better than that. Whether the model "
        f"misses the images is judged by the images themselves, in the residual maps."
    )


def _reference(m: MeasuredMotion) -> PictureText:
    rows, columns = m.reference.shape
    spread = 1e3 * float(np.std(m.reference[m.face.rows, m.face.cols]))
    what = "mean of the repeated images" if m.n_reference > 1 else "image 0"
    return PictureText(
        f"The reference: {what}, flat pattern subtracted, heights in nm above "
        f"their median. Inside the yellow line stand the {m.face.rows.size} pixels that are used "
        f"({1e3 * m.face.pixel:g} nm each). Blue: the meshes on which the motion is sought, "
        f"{len(m.cells_uv)} elements for u and v, {len(m.cells_w)} finer ones for w. Trenches "
        f"beside the face are filled from its rim, which draws them as streaks.",
        f"Grey map of {rows} by {columns} pixels with the region of interest outlined, heights "
        f"scattering by {number(spread, 2)} nm, and two meshes over it: {len(m.cells_uv)} elements "
        f"for u and v, {len(m.cells_w)} for w.",
    )


def _fields(m: MeasuredMotion) -> PictureText:
    shown = m.motion
    ranges = joined(
        [
            f"{component[0]} from {number(1e3 * shown[..., k].min())} to "
            f"{number(1e3 * shown[..., k].max())} nm"
            for k, component in enumerate(COMPONENTS)
        ]
    )
    u, v, w = (number(1e3 * sigma, 2) for sigma in m.nodal_sigma)
    images = joined([str(image) for image in m.shown])
    enlarged = "true to scale" if m.exaggeration == 1 else f"enlarged {m.exaggeration:g} times"
    return PictureText(
        f"Measured motion at the end of loading, over the reference image. The mean over the face "
        f"is removed, for the stage re-centres and refocuses at every image. The mesh moves with "
        f"u and v, {enlarged}; dashed: at rest. Each component has one colour scale for all "
        f"images, without its lowest and highest hundredth; in all, {ranges}. Noise alone gives a "
        f"typical node a standard deviation of {u} nm in u, {v} nm in v and {w} nm in w.",
        f"Colour maps of u, v and w at image{'s' if len(m.shown) > 1 else ''} {images} on the "
        f"moved mesh: {ranges}.",
    )


def _travel(m: MeasuredMotion) -> PictureText:
    last = int(m.shown[-1])

    def at_peak(curve: Curve) -> str:
        return f"{with_sigma(1e3 * curve.value[last], 1e3 * float(curve.sigma[last]))} nm"

    half = [number(1e3 * BAND * c.typical, 2) for c in (m.elongation, m.tilt, m.mean_w)]
    return PictureText(
        f"Motion of the ends against each other (the mean stretch of the region of interest "
        f"carried on to them) and mean height change, image by image. Bands: 95 %, ± {BAND} "
        f"standard deviations from the covariance of the correlation (noise of images and "
        f"reference, error of the flat pattern, and what the penalty may hold back), typically "
        f"± {half[0]} nm for the elongation, ± {half[1]} nm for the tilt and ± {half[2]} nm for "
        f"the mean of w. {_regularised(m)} The mean of w holds what the stage refocuses, and "
        f"jumps with it. At the end of the last loading the elongation is {at_peak(m.elongation)} "
        f"and the tilt {at_peak(m.tilt)} (± one standard deviation).{_smoothed(m)}",
        f"Curves over stage travel from {number(m.stage.min())} to {number(m.stage.max())} µm, "
        f"loading solid and unloading dashed: the elongation reaches {at_peak(m.elongation)}, the "
        f"tilt {at_peak(m.tilt)}.",
    )


def _regularised(m: MeasuredMotion) -> str:
    regularisation = m.regularisation
    if not np.isfinite(regularisation.roughness):
        return "The motion is not regularised."
    how = "estimated from the images" if regularisation.estimated else "as the case states"
    return (
        f"In space the motion is regularised ({PENALTIES[regularisation.penalty]}, roughness "
        f"{number(regularisation.roughness, 2)} px, {how}): of the elongation that may hold back "
        f"{number(1e3 * m.elongation.held, 2)} nm (one standard deviation)."
    )


def _smoothed(m: MeasuredMotion) -> str:
    if not m.regularisation.travel:
        return ""
    return (
        f" Changes below {m.regularisation.travel:g} µm of stage travel count as noise, the shifts "
        f"of the stage excepted: the standard deviation of the elongation falls from "
        f"{number(1e3 * m.elongation.single, 2)} to {number(1e3 * m.elongation.typical, 2)} nm, "
        f"and the errors of neighbouring images are correlated."
    )


def _stopped(m: MeasuredMotion) -> str:
    failed = np.flatnonzero(~m.converged)
    if not failed.size:
        return f" The correlation of all {len(m.chi)} images converged."
    listed = "; ".join(f"image {t} {m.stopped[t]}" for t in failed[:_TOLD])
    more = f"; so did {failed.size - _TOLD} others" if failed.size > _TOLD else ""
    return f" Crosses: {failed.size} of {len(m.chi)} images did not converge: {listed}{more}."


def _grip(m: MeasuredMotion) -> PictureText:
    words = sentences(m.grip)
    return PictureText(
        f"Do the grips follow the stage? {' '.join(words)} Left: elongation of each image with "
        f"the line of all of them; dashed, what the distance of the grips makes. Right: what "
        f"that line leaves, image by image.",
        f"Elongation over stage travel with a straight line, and the differences from it. "
        f"{words[0]}",
    )


def _residuals(m: MeasuredMotion) -> PictureText:
    rms = [number(1e3 * _rms(residual)) for residual in m.residual]
    return PictureText(
        f"What free correlation leaves, ρ = f + w − g(x + u, y + v), in nanometres and grey levels "
        f"({number(1e3 * m.level)} nm each), and over the standard deviation that noise gives it "
        f"(height noise of an image: {number(1e3 * m.sigma)} nm; less between pixels, where "
        f"interpolation averages). A map without structure is noise.",
        f"Maps of the residual of images {joined([str(image) for image in m.shown])}: root mean "
        f"square {joined(rms)} nm.",
    )


def _noise(m: MeasuredMotion) -> PictureText:
    spread, worst = m.spread, int(np.argmax(m.chi))
    told = m.chi[m.chi > 0]  # nothing is left of an image that is the reference
    far = 100.0 * spread.far / spread.n
    return PictureText(
        f"Left: all {spread.n} residuals over their noise; with noise alone they follow the "
        f"unit normal. Their standard deviation is {number(spread.deviation)}; "
        f"{number(far, 2)} % lie beyond {FAR:g} σ (normal: {number(100 * _FAR_SHARE, 2)} %), the "
        f"farthest at {number(spread.farthest, 2)} σ. Right: χ of each image, from "
        f"{chi(float(told.min()))} to {chi(float(told.max()))} (image {worst}), "
        f"{chi(_rms(told))} over all.{_stopped(m)}",
        f"Histogram of residuals beside the unit normal, standard deviation "
        f"{number(spread.deviation)}; χ of {len(m.chi)} images between "
        f"{chi(float(told.min()))} and {chi(float(told.max()))}.",
    )


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.nanmean(values.astype(np.float64) ** 2)))
