"""Virtual experiments: a specimen with a known truth, measured as a user would measure his own.

Nothing of the analysis is shared with what identifies it. The specimen has a finer mesh and
smaller time steps of its own; the relief is a closed formula of the material point, not an
interpolated picture; every image has its own stage position, and all noise has its own seed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import tifffile
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from driver.case import Case, write_case
from driver.case_tables import (
    DiagnosisTable,
    Grain,
    Images,
    LambdaStart,
    MaterialTable,
    Solver,
    Specimen,
)
from driver.history import History, turning_points
from driver.specimen import adapter_of, build_model, geometry_of
from meshes.prism import generate
from meshes.surface import SurfaceMesh, trace

FloatArray = NDArray[np.float64]
Scene = Callable[[FloatArray, FloatArray], FloatArray]
Program = tuple[tuple[float, float, bool], ...]

ROWS, RIM = 48, 12  # rows of an image; columns beyond each end of the specimen [px]
N_REPEATS, N_FLATS = 10, 100
STAGE_SPEED, STOP, HOLD = 0.5, 5.0, 30.0  # µm/s, µm between two images, s before each
RECENTRING, REFOCUSING = 0.3, 0.03  # the stage's error [px], [µm]
GROUND = 0.65  # mean height of the face [µm]: level 100
DOT_HEIGHT, DOT_RADIUS, DOTS_PER_UM2 = 0.020, 0.4, 0.9  # platinum dots [µm]
ROUGHNESS, FIXED_PATTERN = 0.003, 0.008  # rms of the polish and of the optics [µm]
FIXED_POINT = 8  # iterations; strains of a percent gain two digits with each


@dataclass(frozen=True, eq=False)
class Course:
    """What happened to a specimen: T images, n nodes of the measured face.

    Attributes:
        program: time [s], stage travel [µm] and whether an image was taken, row by row.
        face: the measured face.
        motion: motion of its nodes as the images show it [µm], shape (T, n, 3).
        load: load reading without noise [µN], shape (T,).
        length, width: of the face [µm].
    """

    program: Program
    face: SurfaceMesh
    motion: FloatArray
    load: FloatArray
    length: float
    width: float


def small_case() -> Case:
    """A short prism of two grains on a mesh of some hundred cells; starts as a user would."""
    return Case(
        specimen=Specimen(
            length_um=8.0,
            mesh_size_um=2.0,
            fine_mesh_size_um=1.0,
            boundary_point_um=(0.0, 3.6, 0.0),
            boundary_normal=(0.15, 1.0, 0.3),
        ),
        grains=(
            Grain(name="grain 1", euler_deg=(281.0, 8.0, 47.0)),
            Grain(name="grain 2", euler_deg=(211.0, 45.0, 150.0)),
        ),
        material=MaterialTable(strain_measure="small"),
        images=Images(
            frames="images.tif",
            flats="flats.tif",
            repeats="repeats.tif",
            origin_pixel=((ROWS - 1) / 2, float(RIM)),
        ),
        solver=Solver(steps_per_interval=1, fine_steps_per_interval=2),
        diagnosis=DiagnosisTable(refit=3, held_out_cycle="none"),
    )


def true_case(case: Case) -> Case:
    """The specimen of a case as it is: another law, other apex amplitudes; no hidden effect.

    Its working mesh and steps are those of the truth, finer than any that the case knows.
    """
    mesh = {"mesh_size_um": 0.9, "fine_mesh_size_um": 0.8}
    law = {"tau0_MPa": 25.0, "c_MPa": 44e3, "d": 1140.0}
    amplitudes = LambdaStart(plus_Y=0.81, plus_Z=1.02, minus_Y=0.98, minus_Z=1.02)
    return case.model_copy(
        update={
            "specimen": case.specimen.model_copy(update=mesh),
            "material": case.material.model_copy(update=law),
            "boundary": case.boundary.model_copy(update={"lambda_start": amplitudes}),
            "solver": Solver(steps_per_interval=3),
        }
    )


def pull(
    truth: Case,
    cycles: Sequence[tuple[int, int]],
    elongation: Sequence[float],
    effect: Mapping[str, float],
) -> Course:
    """Simulate a test.

    Args:
        truth: the specimen as it is, on the mesh and with the steps of its working model.
        cycles: images during loading and during unloading of each cycle.
        elongation: elongation at the turning points after the start [µm], two for each cycle;
            the ends tilt by a quarter of it.
        effect: parameters of the general model that are not at their null.
    """
    program = _stage_program(cycles)
    time, stage, taken = (np.array(column) for column in zip(*program, strict=True))
    images = np.flatnonzero(taken)
    none = np.zeros(images.size)
    history = History(time, stage, images, none, turning_points(stage), none.astype(np.int64))
    mesh = generate(geometry_of(truth), truth.specimen.mesh_size)
    model = build_model(
        truth, mesh, history, np.zeros((0, 2)), adapter_of(truth), truth.solver.steps_per_interval
    )
    start = truth.boundary.lambda_start.model_dump()
    values = model.null_values() | {f"lambda_{name}": value for name, value in start.items()}
    values |= {f"elongation_{k}": e for k, e in enumerate(elongation, start=1)}
    values |= {f"tilt_{k}": e / 4 for k, e in enumerate(elongation, start=1)}
    seen = model.predict(values | dict(effect))
    specimen = truth.specimen
    return Course(program, trace(mesh), seen.surface, seen.load, specimen.length, specimen.width)


def record(folder: Path, case: Case, course: Course, seed: int) -> Path:
    """Write the folder that a user would have after the test.

    Args:
        folder: where to write; it exists.
        case: what the user knows and believes.
        course: what happened.
        seed: of the relief, of the stage and of all noise.

    Returns:
        The case file.
    """
    rng = np.random.default_rng(seed)
    write_case(case, folder / "case.toml")
    load = course.load + case.loads.gamma_F * rng.normal(size=course.load.size)
    _write_history(folder / "history.csv", course.program, load / case.force_scale)
    relief, optics = _Relief.random(rng, course.length), _Optics.random(rng, case)
    moving = _Moving(course, relief)
    frames = [optics.photograph(rng, partial(moving, now)) for now in course.motion]
    # Noise is known from pictures between which nothing moves.
    repeats = [optics.photograph(rng, relief, still=True) for _ in range(N_REPEATS)]
    flats = [optics.photograph(rng, None) for _ in range(N_FLATS)]
    for name, stack in (("images", frames), ("repeats", repeats), ("flats", flats)):
        tifffile.imwrite(folder / f"{name}.tif", np.stack(stack), photometric="minisblack")
    return folder / "case.toml"


def _stage_program(cycles: Sequence[tuple[int, int]]) -> Program:
    time, stage, rows = 0.0, 0.0, [(0.0, 0.0, True)]
    for up, down in cycles:
        for step in up * [STOP] + down * [-STOP]:
            time, stage = time + STOP / STAGE_SPEED, stage + step
            rows.append((time, stage, False))
            time += HOLD
            rows.append((time, stage, True))
    return tuple(rows)


def _write_history(path: Path, program: Program, force: FloatArray) -> None:
    lines, image = ["time_s,stage_um,image,force_N"], 0
    for time, stage, taken in program:
        lines.append(f"{time:g},{stage:g}," + (f"{image},{force[image]:.4f}" if taken else ","))
        image += taken
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@dataclass(frozen=True, eq=False)
class _Relief:
    """Heights of the undeformed face [µm]: dots on a polished surface."""

    dots: FloatArray
    waves: FloatArray

    @staticmethod
    def random(rng: np.random.Generator, length: float) -> _Relief:
        low, high = np.array([-3.5, -2.5]), np.array([3.5, length + 2.5])
        number = round(DOTS_PER_UM2 * float(np.prod(high - low)))
        return _Relief(rng.uniform(low, high, (number, 2)), _waves(rng, 0.8, 4.0))

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        height = ROUGHNESS * _sum_of(self.waves, x, y)
        for centre_x, centre_y in self.dots:
            squared = ((x - centre_x) ** 2 + (y - centre_y) ** 2) / DOT_RADIUS**2
            # A cap with a rounded foot: what a lens makes of a hemisphere.
            height = height + DOT_HEIGHT * np.maximum(1.0 - squared, 0.0) ** 2
        return height


@dataclass(frozen=True, eq=False)
class _Moving:
    """The relief carried along by the motion of the nodes of a quadratic mesh."""

    course: Course
    relief: _Relief

    def __call__(self, nodal: FloatArray, x_now: FloatArray, y_now: FloatArray) -> FloatArray:
        """g(x') = f(x) + w(x) at x' = x + u(x), the material point x found by fixed point."""
        x, y = x_now, y_now
        for _ in range(FIXED_POINT):
            u, v, w = self._motion(nodal, x, y)
            x, y = x_now - u, y_now - v
        return np.asarray(self.relief(x, y) + w)

    def _motion(self, nodal: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """u, v, w; beyond the edges of the face the motion of the edge."""
        points, cells = self.course.face.points, self.course.face.cells
        half, inside = self.course.width / 2, 1 - 1e-9
        x = np.clip(x, -inside * half, inside * half)
        y = np.clip(y, (1 - inside) * self.course.length, inside * self.course.length)
        triangles = Triangulation(points[:, 0], points[:, 1], cells[:, :3])
        cell = np.asarray(triangles.get_trifinder()(x, y), dtype=np.int64)
        origin, one, two = (points[cells[cell, k]] for k in range(3))
        (ax, ay), (bx, by) = np.moveaxis(one - origin, -1, 0), np.moveaxis(two - origin, -1, 0)
        dx, dy = np.moveaxis(np.stack([x, y], axis=-1) - origin, -1, 0)
        b, c = np.stack([dx * by - dy * bx, dy * ax - dx * ay]) / (ax * by - ay * bx)
        a = 1 - b - c
        shapes = np.stack(
            [a * (2 * a - 1), b * (2 * b - 1), c * (2 * c - 1), 4 * a * b, 4 * b * c, 4 * c * a]
        )
        return np.asarray(np.einsum("krc,rckd->drc", shapes, nodal[cells[cell]]))


@dataclass(frozen=True, eq=False)
class _Optics:
    """The microscope: where its pixels look, its fixed pattern, its noise and its levels.

    The specimen lies within half a pixel of where the case says.
    """

    x: FloatArray
    y: FloatArray
    face: NDArray[np.bool_]
    pattern: FloatArray
    images: Images

    @staticmethod
    def random(rng: np.random.Generator, case: Case) -> _Optics:
        pixel, (row, column) = case.images.pixel_um, case.images.origin_pixel
        columns = round(case.specimen.length / pixel) + 1 + 2 * RIM
        row, column = np.array([row, column]) + rng.uniform(-0.5, 0.5, 2)
        x, y = np.meshgrid(
            (np.arange(ROWS) - row) * pixel, (np.arange(columns) - column) * pixel, indexing="ij"
        )
        pattern = FIXED_PATTERN * _sum_of(_waves(rng, 1.5, 6.0), x, y)
        return _Optics(x, y, np.abs(x) <= case.specimen.width / 2, pattern, case.images)

    def photograph(
        self, rng: np.random.Generator, scene: Scene | None, still: bool = False
    ) -> NDArray[np.uint8]:
        """An 8-bit picture of heights over X, Y; None is a flat surface, trenches are at 0."""
        shift = RECENTRING * self.images.pixel_um * rng.uniform(-1, 1, 2) * (not still)
        height = GROUND + self.pattern + self.images.gamma_f * rng.normal(size=self.x.shape)
        height += REFOCUSING * rng.uniform(-1, 1) * (not still)
        if scene is not None:
            height += scene(self.x - shift[0], self.y - shift[1])
        levels = np.clip(np.round(height / self.images.level_um), 1, 255)
        on_face = self.face | (scene is None)
        return np.asarray(np.where(on_face, levels, 0), dtype=np.uint8)


def _waves(rng: np.random.Generator, shortest: float, longest: float) -> FloatArray:
    """Wave vectors [1/µm] and phases of 40 waves, shape (40, 3)."""
    number = 2 * np.pi / rng.uniform(shortest, longest, 40)
    angle, phase = rng.uniform(0, 2 * np.pi, (2, 40))
    return np.column_stack([number * np.cos(angle), number * np.sin(angle), phase])


def _sum_of(waves: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Sum of the waves with unit rms."""
    total = sum(np.cos(kx * x + ky * y + phase) for kx, ky, phase in waves)
    return np.asarray(total * np.sqrt(2 / len(waves)))
