"""Looks at the orientations of the grains: their angles, their maps, and what is in doubt."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import pi

import numpy as np

from driver.case.grains import EULER_AXES, Grain
from driver.case.model import Case
from driver.common.errors import InputError, show
from driver.diagnosis.causes.ebsd_flips import SAME, disorientation
from driver.doubts.finding import Finding
from driver.experiment.ebsd.picking import PickedGrain
from driver.experiment.ebsd.segmentation import THRESHOLD
from driver.experiment.orientations import (
    GrainOrientation,
    grain_orientations,
    map_files,
    map_traces,
    rotation_scales,
)
from driver.parameters.microstructure import ROTATION_SCALE
from solver_adapters.crystal import bunge_angles, bunge_matrix

_SUBJECT = "orientation"
_FLAT = 0.2  # sine of the angle between a boundary and the map, below which it has no clear trace
_MISALIGNED = 8.0  # degrees by which a map and a face may be put in beside one another
_FEW = 10  # points, of which a mean says little


def look_at_orientations(case: Case) -> list[Finding]:
    """Return what was found of the grains, in their order.

    Args:
        case: the case.

    Returns:
        One error where the orientations cannot be known.
    """
    try:
        found = grain_orientations(case)
    except InputError as error:
        return [Finding("error", _SUBJECT, str(error))]
    findings = [*_frames(case), *_of_another_maker(case, found)]
    scales = rotation_scales(case)
    for number, (grain, orientation) in enumerate(zip(case.grains, found, strict=True), start=1):
        along = " ".join(f"{component:+.3f}" for component in orientation.rotation[1])
        message = f"{grain.name}: loading axis along crystal [{along}]"
        findings.append(Finding("ok", _SUBJECT, message))
        if orientation.of_map is None:
            findings += _angles(f"grains.{number}.euler_deg", orientation.euler_deg)
        else:
            scale = scales.get(f"rotation_grain{number}_x", ROTATION_SCALE)
            findings += _of_map(case, number, grain, orientation, orientation.of_map, scale)
    if case.labelled_by_map:  # which has them in no row
        return findings
    findings += [*_alike(case, found), *_out_of_order(case, found)]
    return [*findings, *_other_boundaries(case)]


def _angles(key: str, angles: tuple[float, float, float]) -> Iterator[Finding]:
    """Yield what is odd about stated Bunge angles."""
    if _like_radians(angles):
        degrees = [round(float(angle), 3) for angle in np.rad2deg(angles)]
        yield Finding(
            "warning",
            _SUBJECT,
            f"{key} = {show(angles)} looks like radians and is taken as degrees; if it is radians, "
            f"write {key.split('.')[-1]} = {show(degrees)}",
        )
    phi1, capital_phi, phi2 = angles
    if 0.0 <= capital_phi <= 180.0 and all(-360.0 <= angle <= 360.0 for angle in (phi1, phi2)):
        return
    same = [round(angle % 360.0, 6) for angle in bunge_angles(bunge_matrix(*angles))]
    yield Finding(
        "warning",
        _SUBJECT,
        f"{key} = {show(angles)} is beyond its range (φ1 and φ2 to 360, Φ from 0 to 180) and is "
        f"taken as {show(same)}, the same rotation",
    )


def _like_radians(angles: tuple[float, float, float]) -> bool:
    small = all(abs(angle) <= 2 * pi for angle in angles)
    return small and any(angle != round(angle) for angle in angles)


def _frames(case: Case) -> Iterator[Finding]:
    """Yield how a map lies on the specimen, and what of it is not stated."""
    orientation = case.orientation
    if orientation.ebsd_frame is None:
        if map_files(case):
            yield Finding(
                "warning",
                _SUBJECT,
                "orientation.ebsd_frame: found nothing, so that x and y of the map are taken as "
                'the axes of its Euler angles; expected "edax", "oxford" or "bruker", whose '
                "Euler angles refer to other axes than the map (docs/ebsd.md)",
            )
        return
    x, y, z = (_axis(column) for column in orientation.rotation.T)
    yield Finding(
        "ok",
        _SUBJECT,
        f'Euler angles of "{orientation.ebsd_frame}"; of the map x is along {x}, y along {y} and '
        f"z, into its surface, along {z} of the specimen",
    )
    if orientation.rotation[2, 2] > 0.5:
        yield Finding(
            "warning",
            _SUBJECT,
            "orientation.ebsd_to_specimen: found z of the map, which points into its surface, "
            "along +Z, out of the measured face; expected it along −Z for a map of that face, as "
            "[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]] with x of the map along Y and y "
            "along X",
        )


def _of_another_maker(case: Case, found: Sequence[GrainOrientation]) -> Iterator[Finding]:
    """Yield maps that the software of another maker has written than the stated frame is of."""
    stated = case.orientation.ebsd_frame
    makers = {
        case.path(grain.ebsd): orientation.of_map.makers
        for grain, orientation in zip(case.grains, found, strict=True)
        if grain.ebsd is not None and orientation.of_map is not None
    }
    for file, known in makers.items():
        # Those of Oxford and Bruker are one frame.
        if stated is None or not known or any(EULER_AXES[m] == EULER_AXES[stated] for m in known):
            continue
        expected = " or ".join(f'"{maker}"' for maker in known)
        yield Finding(
            "warning",
            _SUBJECT,
            f'{file}: orientation.ebsd_frame: found "{stated}" for a map with the header of '
            f"another maker's software, expected {expected}, unless a third program has written "
            "it; the grains are turned by a quarter about the normal if that is wrong "
            "(docs/ebsd.md)",
        )


def _axis(direction: Sequence[float]) -> str:
    components = np.asarray(direction)
    largest = int(np.abs(components).argmax())
    if abs(components[largest]) > 1 - 1e-6:
        return f"{'+' if components[largest] > 0 else '−'}{'XYZ'[largest]}"
    return "[" + " ".join(f"{component:+.3f}" for component in components) + "]"


def _of_map(
    case: Case,
    number: int,
    grain: Grain,
    orientation: GrainOrientation,
    picked: PickedGrain,
    scale: float,
) -> Iterator[Finding]:
    """Yield what a map tells of a grain, and what of it is in doubt."""
    assert grain.ebsd is not None
    file, key = case.path(grain.ebsd), f"grains.{number}.ebsd"
    indexed, everything = picked.surroundings
    angles = ", ".join(f"{angle % 360.0:.2f}" for angle in orientation.euler_deg)
    by = (
        f"grain {grain.ebsd_grain} of the file"
        if grain.ebsd_grain is not None
        else f"the grain at [{picked.place[0]:g}, {picked.place[1]:g}] µm, whose neighbours differ "
        f"by less than {THRESHOLD:g}°,"
    )
    yield Finding(
        "ok",
        _SUBJECT,
        f"{grain.name}: {by} in {file} ({indexed} of {everything} points indexed): "
        f"{picked.points} points, mean φ1, Φ, φ2 = {angles}°, spread "
        f"{np.rad2deg(picked.spread):.2f}° rms; a turn about an axis has a prior of "
        f"{np.rad2deg(scale):.2g}°",
    )
    if picked.points < _FEW:
        yield Finding(
            "warning",
            _SUBJECT,
            f"{file}: {key}: found a grain of {picked.points} point(s), expected one of "
            f"{_FEW} or more: it may be indexed wrongly",
        )
    if picked.like_radians:
        yield Finding(
            "warning",
            _SUBJECT,
            f"{file}: {key}: all Euler angles of the map look like radians and are taken as "
            "degrees, as the file has them; if they are radians, write them in degrees into the "
            "file, or the grain's own as euler_deg",
        )
    if any(picked.surface):
        surface = ", ".join(f"{angle:g}" for angle in picked.surface)
        yield Finding(
            "warning",
            _SUBJECT,
            f"{file}: {key}: the map was acquired on a surface turned by AcqE1 to AcqE3 = "
            f"{surface}°, which some versions of its software have put into the Euler angles; "
            "export it anew with 0, or see that orientation.ebsd_to_specimen holds it",
        )


def _alike(case: Case, found: Sequence[GrainOrientation]) -> Iterator[Finding]:
    """Yield neighbouring grains that are the same crystal."""
    for (first, one), (second, other) in pairwise(zip(case.grains, found, strict=True)):
        angle = disorientation(other.rotation @ one.rotation.T, one.rotation)
        if angle < SAME:
            yield Finding(
                "warning",
                _SUBJECT,
                f"grains: {first.name} and {second.name} are the same crystal within "
                f"{SAME:g}° ({angle:.2f}°, symmetry considered); expected two orientations at a "
                "grain boundary, or a single grain without one",
            )


def _out_of_order(case: Case, found: Sequence[GrainOrientation]) -> Iterator[Finding]:
    """Yield neighbours that one map shows the other way round along the loading axis."""
    along_y = np.asarray(case.orientation.ebsd_to_specimen)[1, :2]
    for (first, one), (second, other) in pairwise(zip(case.grains, found, strict=True)):
        if one.of_map is None or other.of_map is None or first.ebsd != second.ebsd:
            continue
        if along_y @ np.asarray(one.of_map.place) > along_y @ np.asarray(other.of_map.place):
            yield Finding(
                "warning",
                _SUBJECT,
                f"grains: by orientation.ebsd_to_specimen {first.name} lies farther along +Y than "
                f"{second.name} in {first.ebsd}; expected grains in their order from S− (Y = 0) "
                "on: exchange what picks them, or turn the matrix",
            )


def _other_boundaries(case: Case) -> Iterator[Finding]:
    """Yield grain boundaries whose trace on the face a map shows in another direction."""
    frame, planes = case.orientation.rotation, case.specimen.planes
    for number, trace in map_traces(case).items():
        if number >= len(planes):
            continue
        normal = np.asarray(planes[number].normal) / np.linalg.norm(planes[number].normal)
        into, seen = frame[:, 2], frame[:, :2] @ trace.along
        stated = np.cross(normal, into)
        steep = float(np.linalg.norm(stated))
        if steep < _FLAT:
            continue  # nearly the plane of the map itself
        angle = float(np.rad2deg(np.arccos(min(abs(float(stated @ seen)) / steep, 1.0))))
        error = np.rad2deg(max(3 * trace.sigma, 2 * trace.resolution))
        if angle <= max(_MISALIGNED, error):
            continue
        across = np.cross(into, seen)
        across *= np.sign(across @ normal)
        shown = [round(float(c), 3) for c in (normal @ into) * into + steep * across]
        key = "boundary_normal" if case.specimen.boundary_normal else f"boundaries.{number + 1}"
        first, second = case.grains[number : number + 2]
        yield Finding(
            "warning",
            _SUBJECT,
            f"specimen.{key}: found a plane whose trace on the face is {angle:.0f}° from that of "
            f"{first.name} and {second.name} in {first.ebsd} (± {np.rad2deg(trace.sigma):.1f}°), "
            f"expected about {show(shown)}; look at the normal, and at "
            "orientation.ebsd_to_specimen",
        )
