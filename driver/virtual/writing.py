"""A virtual experiment on disk: the folder that a user would have after a test, and the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from driver.case.history import HistoryTable
from driver.case.model import CASE_FILE, SCHEMA_FILE, Case, schema_text, write_case
from driver.common.errors import InputError
from driver.parameters.registry import declared_parameters
from driver.results.files import FLATS_TIF, HISTORY_CSV, IMAGES_TIF, LABELS_TIF, REPEATS_TIF
from driver.results.virtual_experiment import (
    Truth,
    write_history,
    write_images,
    write_labels,
    write_truth,
)
from driver.virtual.microscope.camera import Camera
from driver.virtual.microscope.face_motion import Face, NodalMotion
from driver.virtual.microscope.relief import Relief, Waves
from driver.virtual.microscope.series import Stage, Subject, flats, frames, repeats
from driver.virtual.microscope.slip_steps import slip_steps
from driver.virtual.settings import Face as FaceTable
from driver.virtual.settings import Virtual
from driver.virtual.truth import Course
from meshes.arrays import FloatArray
from meshes.surface_grains import grains_at

_AROUND = 1.5  # µm beyond the face on which there are dots
_PATTERN = (1.5, 6.0)  # wavelengths of the fixed pattern [µm]


def record(
    folder: Path,
    case: Case,
    course: Course,
    seed: int,
    settings: Virtual | None = None,
) -> Path:
    """Write images, history, case and truth.

    Relief, stage, load noise and image noise have a stream each: with one seed they are the same
    whatever happens to the specimen.

    Args:
        folder: where to write; it exists.
        case: what the user knows and believes; images, history and labels are replaced.
        course: what happened.
        seed: of relief, stage and noise.
        settings: of the microscope and the face, or None for the defaults.

    Returns:
        The case file.

    Raises:
        InputError: heights beyond the range of the levels.
    """
    settings = settings or Virtual()
    on_face, on_place, on_stage, on_load, on_image = (
        np.random.default_rng([seed, stream]) for stream in range(5)
    )
    scope, pixel, n_images = settings.microscope, case.images.pixel_um, len(course.motion)
    subject = _subject(case, course, settings, on_face)
    lens = _lens(case, course, settings, on_place)
    stage = Stage(scope.recentring_px * pixel, scope.refocusing_nm * 1e-3)
    at_images = stage.errors(on_stage, n_images)
    at_flats = stage.errors(on_stage, scope.flats)
    # The pattern has changed since the flats were taken.
    left = course.values["fixed_pattern"] * lens.camera.pattern
    camera = replace(lens.camera, pattern=lens.camera.pattern + left)
    try:
        # One stream of noise runs through all three, in this order.
        of_repeats = repeats(camera, subject, scope.repeats, on_image)
        of_flats = flats(lens.camera, at_flats, on_image)
        of_test = list(frames(camera, subject, at_images, on_image))
    except ValueError as error:
        raise InputError(f"microscope.bits: {error}") from None
    write_images(folder, of_test, of_repeats, of_flats)
    noise = case.loads.gamma_F * correlated(on_load, n_images, case.loads.autocorrelation)
    if case.specimen.labels is not None:
        x, y = lens.camera.x, lens.camera.y
        grain = grains_at(course.mesh, np.column_stack([x.ravel(), y.ravel()]))
        write_labels(folder, 1 + grain.reshape(x.shape))
    write_history(folder, course.history, (course.load + noise) / case.force_scale)
    write_case(_stated(case, settings, lens), folder / CASE_FILE)
    (folder / SCHEMA_FILE).write_text(schema_text(), encoding="utf-8")
    write_truth(folder, _truth(case, course, settings, seed, lens, subject, at_images))
    return folder / CASE_FILE


@dataclass(frozen=True, eq=False)
class _Lens:
    """The camera, and where the case says that it looks.

    Attributes:
        camera: the instrument.
        origin: stated (row, column) of X = 0, Y = 0.
        error: by how much the pixels lie further along X and Y than stated [µm], shape (2,).
    """

    camera: Camera
    origin: tuple[float, float]
    error: FloatArray


def _shape(case: Case, settings: Virtual) -> tuple[int, int]:
    """Rows and columns of an image."""
    pixel, (rim_x, rim_y) = case.images.pixel_um, settings.microscope.rim_px
    rows = round(case.specimen.width / pixel) + 1 + 2 * rim_x
    return rows, round(case.specimen.length / pixel) + 1 + 2 * rim_y


def _level(case: Case, settings: Virtual) -> float:
    """Height of a level [nm]; 16 bits have 256 times as many over the same range."""
    given = settings.microscope.height_per_level_nm
    share = 256.0 if settings.microscope.bits == 16 else 1.0
    return case.images.height_per_level_nm / share if given is None else given


def _lens(case: Case, course: Course, settings: Virtual, rng: np.random.Generator) -> _Lens:
    scope, pixel = settings.microscope, case.images.pixel_um
    rows, columns = _shape(case, settings)
    origin = ((rows - 1) / 2, float(scope.rim_px[1]))
    error = scope.origin_error_px * pixel * rng.uniform(-1, 1, 2)
    error += [course.values["origin_X"], course.values["origin_Y"]]
    x, y = np.meshgrid(
        (np.arange(rows) - origin[0]) * pixel + error[0],
        (np.arange(columns) - origin[1]) * pixel + error[1],
        indexing="ij",
    )
    pattern = scope.pattern_nm * 1e-3 * Waves.random(rng, *_PATTERN)(x, y)
    sigma = case.images.gamma_f if scope.noise_nm is None else scope.noise_nm * 1e-3
    growing = scope.noise_ratio ** np.linspace(-0.5, 0.5, columns)
    noise = np.tile(sigma * growing / np.sqrt(np.mean(growing**2)), (rows, 1))
    level = _level(case, settings) * 1e-3
    camera = Camera(x, y, pixel, pattern, noise, scope.bits, level, scope.samples)
    return _Lens(camera, origin, error)


def random_relief(case: Case, look: FaceTable, rng: np.random.Generator) -> Relief:
    """Return the relief of a face as the settings describe it, also on the rim around it."""
    half = case.specimen.width / 2
    bounds = (-half - _AROUND, half + _AROUND, -_AROUND, case.specimen.length + _AROUND)
    return Relief.random(
        rng,
        bounds,
        look.dot_height_nm * 1e-3,
        look.dot_radius_um,
        look.dots_per_um2,
        look.roughness_nm * 1e-3,
    )


def _subject(case: Case, course: Course, settings: Virtual, rng: np.random.Generator) -> Subject:
    look, face = settings.face, Face(course.face)
    half = case.specimen.width / 2
    relief = random_relief(case, look, rng)
    steps = None
    if look.slip_spacing_um:
        if course.slip is None:
            raise InputError(
                "face.slip_spacing_um: found slip steps for a response without the slip of the "
                "cells, expected 0, or a simulation that asks for cell_fields"
            )
        steps = slip_steps(
            course.mesh,
            face,
            course.slip,
            course.orientations,
            course.systems,
            look.slip_spacing_um,
            settings.microscope.resolution_nm * 1e-3,
            rng,
        )
    trench = half if settings.microscope.trench else np.inf
    return Subject(face, course.motion, relief, steps, trench)


def _stated(case: Case, settings: Virtual, lens: _Lens) -> Case:
    """Return the case with the images and the history that were written."""
    images = case.images.model_copy(
        update={
            "frames": IMAGES_TIF, "flats": FLATS_TIF, "repeats": REPEATS_TIF, "mask": None,
            "noise_map": None,
            "height_per_level_nm": _level(case, settings), "height_offset_nm": 0.0,
            # Floats have no number there.
            "off_surface_level": "none" if settings.microscope.bits == 32 else 0.0,
            "origin_pixel": lens.origin,
            "rows_along": "+X", "columns_along": "+Y", "heights": "+Z",
        }
    )  # fmt: skip
    history = HistoryTable(file=HISTORY_CSV, grip_distance_mm=case.history.grip_distance_mm)
    tables = {
        "images": images, "history": history,
        "loads": case.loads.model_copy(update={"left_out": ()}),
    }  # fmt: skip
    if case.specimen.labels is not None:
        own = {"labels": LABELS_TIF, "labels_pixel_nm": None, "labels_point_um": None}
        tables["specimen"] = case.specimen.model_copy(update=own)
    return case.model_copy(update=tables)


def correlated(rng: np.random.Generator, number: int, correlation: float) -> FloatArray:
    """Noise of unit variance whose neighbours are correlated, AR(1)."""
    noise = rng.normal(size=number)
    for k in range(1, number):
        noise[k] = correlation * noise[k - 1] + np.sqrt(1 - correlation**2) * noise[k]
    return noise


def _truth(
    case: Case,
    course: Course,
    settings: Virtual,
    seed: int,
    lens: _Lens,
    subject: Subject,
    stage: FloatArray,
) -> Truth:
    # A part of a grain that differs from the rest is one more of the simulation, none of the case.
    declared = declared_parameters(course.history.n_knots, n_grains=len(case.grains))
    x, y = lens.camera.x, lens.camera.y
    seen = [NodalMotion(subject.face, nodal)(x.ravel(), y.ravel())[0] for nodal in course.motion]
    return Truth(
        seed=seed,
        values=course.values,
        units={name: declared[name].unit for name in course.values},
        origin_error=lens.error,
        n_cells=len(course.mesh.cells),
        settings=settings.model_dump(mode="json"),
        x=x,
        y=y,
        relief=subject.relief(x, y),
        pattern=lens.camera.pattern,
        noise=lens.camera.noise,
        stage=stage,
        motion=np.reshape(seen, (len(seen), *x.shape, 3)),
        load=course.load,
        nodes=course.face.points,
        nodal_motion=course.motion,
    )
