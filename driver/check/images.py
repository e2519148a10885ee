"""Looks at the images of a case as the measurement will, before they are correlated."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from driver.case.model import Case
from driver.common.errors import InputError
from driver.dic.basis import grid_basis
from driver.dic.resolution_check import refuse_too_fine
from driver.doubts.finding import Finding
from driver.experiment.images.flatfield import FlatField, flat_pattern
from driver.experiment.images.heightmaps import on_surface
from driver.experiment.images.outliers import (
    find_outliers,
    frame_statistics,
    texts_by_frame,
    without,
)
from driver.experiment.images.reference import Reference, corrected
from driver.experiment.images.region import Excluded
from driver.experiment.images.stated_noise import CONTRADICTS, COST
from driver.experiment.reading import Experiment
from driver.forward.build import correlation_meshes, reference_of, used_face
from meshes.plane_mesh import PlaneMesh

# Share of the measured face without a height (a trench) before the origin is in doubt.
_TRENCH_SHARE = 0.05
# Error of the flat pattern over the noise, above which it shows in the residuals (by 5 %).
_FLAT_SHARE = 0.3


def look_at_images(case: Case, experiment: Experiment) -> tuple[list[Finding], Reference | None]:
    """Return what was found, in the order of the measurement, and the reference surface.

    Args:
        case: the case.
        experiment: its measured data.

    Returns:
        No reference surface where the images would stop a run.
    """
    findings = list(_stacks(experiment))
    place = _face(case, experiment)
    findings.append(place)
    if place.level == "error":
        return findings, None
    try:
        flat = None if experiment.flats is None else flat_pattern(experiment.flats)
        reference = reference_of(case, experiment, flat)
    except InputError as error:
        return [*findings, Finding("error", "images", str(error))], None
    findings += _surface(case, reference, flat)
    findings += _elements(case, reference)
    findings += _frames(experiment, reference, flat)
    return findings, reference


def _stacks(experiment: Experiment) -> Iterator[Finding]:
    n_images, rows, columns = experiment.frames.shape
    yield Finding("ok", "images", f"{n_images} frames of {rows} × {columns} px")
    if experiment.clipped:
        yield Finding(
            "warning",
            "images",
            f"images.frames: {experiment.clipped} pixels are at the largest level of their type: "
            "the heights are cut there",
        )
    for remark in experiment.remarks:
        yield Finding("warning", "images", remark)
    if experiment.flats is None:
        yield Finding("warning", "images", "images.flats is not given: no fixed pattern is removed")
    for name in ("flats", "repeats"):
        stack = getattr(experiment, name)
        if stack is not None:
            yield Finding("ok", "images", f"{len(stack)} {name}")


def _face(case: Case, experiment: Experiment) -> Finding:
    _, rows, columns = experiment.frames.shape
    (row, column), pixel = experiment.origin, experiment.pixel_um
    half, length = case.specimen.width / 2 / pixel, case.specimen.length / pixel
    top, bottom, left, right = row - half, row + half, column, column + length
    place = f"rows {top:.1f} … {bottom:.1f}, columns {left:.1f} … {right:.1f}"
    if 2 * half > rows or length > columns:  # wherever it lies
        return Finding(
            "error",
            "images",
            f"images.pixel_size_nm: found {1e3 * pixel:g}, with which the measured face is "
            f"{2 * half:.1f} × {length:.1f} px, expected one that fits into {rows} × {columns} px",
        )
    if top < -0.5 or left < -0.5 or bottom > rows - 0.5 or right > columns - 0.5:
        return Finding(
            "error",
            "images",
            f"images.origin_pixel: found the measured face at {place}, expected it inside "
            f"{rows} × {columns} px",
        )
    face = experiment.frames[0][
        round(max(top, 0)) : round(bottom) + 1, round(max(left, 0)) : round(right) + 1
    ]
    trench = 1.0 - on_surface(face).mean()
    if trench > _TRENCH_SHARE:
        return Finding(
            "warning",
            "images",
            f"images.origin_pixel: {trench:.0%} of the measured face ({place}) carries no height: "
            "look at the picture whether the face lies there",
        )
    return Finding("ok", "images", f"measured face at {place}")


def _surface(case: Case, reference: Reference, flat: FlatField | None) -> Iterator[Finding]:
    count = {reason: reference.count(reason) for reason in Excluded}
    yield Finding(
        "ok",
        "images",
        f"{count[Excluded.USED]} pixels of the face are used; left out are "
        f"{count[Excluded.TRENCH]} at trenches, {count[Excluded.MASK]} by the mask and "
        f"{count[Excluded.DUST]} as dust",
    )
    if case.images.repeats is None:
        yield Finding("warning", "noise", f"{case.images.noise_nm:g} nm as stated: {COST}")
    else:
        yield from _noise_of_repeats(case, reference)
    if flat is not None:
        size = f"{1e3 * np.std(flat.pattern):.2f} ± {1e3 * flat.sigma:.2f} nm rms"
        loud = flat.sigma > _FLAT_SHARE * reference.noise.sigma
        more = ": its error shows in the residuals, take more flats" if loud else ""
        yield Finding(
            "warning" if loud else "ok", "images", f"fixed pattern of {flat.n} flats {size}{more}"
        )


def _noise_of_repeats(case: Case, reference: Reference) -> Iterator[Finding]:
    noise = reference.noise
    sigma, error = 1e3 * noise.sigma, 1e3 * noise.sigma / np.sqrt(2 * noise.dof)
    moved = ", registered: they moved" if reference.registered else ""
    yield Finding(
        "ok",
        "noise",
        f"{sigma:.2f} ± {error:.2f} nm from {reference.n} repeats ({noise.dof} degrees of "
        f"freedom{moved})",
    )
    if reference.stretch is not None and reference.stretch.told:
        yield Finding("warning", "noise", reference.stretch.told)
    nominal = case.images.noise_nm
    if not 1 / CONTRADICTS < sigma / nominal < CONTRADICTS:
        yield Finding(
            "warning",
            "noise",
            f"images.noise_nm: found {nominal:g}, expected about the {sigma:.2f} that the repeats "
            "scatter by; look whether height_per_level_nm is right",
        )


def _elements(case: Case, reference: Reference) -> Iterator[Finding]:
    """Whether the elements of the correlation suit the face."""
    try:
        meshes = correlation_meshes(case)
    except InputError:
        return  # told of the meshes themselves
    pixel, bounds = case.images.pixel_um, used_face(case)
    n_pix = int(np.count_nonzero(reference.region))
    corner = np.array([[bounds[0], bounds[2]]])
    counts = [
        len(mesh.points if isinstance(mesh, PlaneMesh) else grid_basis(corner, bounds, mesh).nodes)
        for mesh in meshes
    ]
    try:
        refuse_too_fine(n_pix, *counts)
    except InputError as error:
        yield Finding("error", "images", str(error))
    longest = max(bounds[1] - bounds[0], bounds[3] - bounds[2]) / pixel
    for key, mesh in zip(("element_px", "height_element_px"), meshes, strict=True):
        if not isinstance(mesh, PlaneMesh) and mesh / pixel > longest:
            yield Finding(
                "warning",
                "images",
                f"dic.{key}: found {mesh / pixel:g}, expected less than the {longest:.0f} px of "
                "the face: one element spans it",
            )


def _frames(
    experiment: Experiment, reference: Reference, flat: FlatField | None
) -> Iterator[Finding]:
    pixel = experiment.pixel_um
    holes = np.array(
        [np.count_nonzero(~on_surface(frame) & reference.region) for frame in experiment.frames]
    )
    if holes.any():
        worst = int(holes.argmax())
        yield Finding(
            "warning",
            "images",
            f"images.frames: {np.count_nonzero(holes)} frames lack heights on the face, frame "
            f"{worst} at most, of {holes[worst]} pixels: they are left out there",
        )
    try:
        frames = (corrected(f, flat, f"frame {t}") for t, f in enumerate(experiment.frames))
        seen = frame_statistics(frames, reference, pixel)
    except InputError as error:
        yield Finding("error", "images", str(error))
        return
    largest = np.abs(seen.shift[:, :2]).max() / pixel
    yield Finding("ok", "images", f"the stage moved the frames by up to {largest:.1f} px")
    found = find_outliers(1e3 * seen.residual, seen.noise, seen.shift, pixel, "nm")
    is_reference = (np.arange(len(seen.noise)) == 0) & (experiment.repeats is None)
    for frame, what in texts_by_frame(without(is_reference, found)).items():
        yield Finding("warning", "images", f"frame {frame} is unlike its neighbours: {what}")
