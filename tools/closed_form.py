"""A small specimen with a solver in closed form: identification and diagnosis in milliseconds.

The solver strains a bar uniformly between its ends, with a one-dimensional hysteresis law for
the load. Parameters of the crystal change the motion of the face by shapes that are quadratic in
X and Y, which the quadratic face elements hold exactly: data made with it have no mesh error.
Some parameters are parallel on purpose: load gain, elastic scale and depth all scale the load.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tifffile

from driver.case.model import Case, default_case, write_case
from driver.dic.basis import grid_basis
from driver.dic.surface_images import SurfaceImages, prepare
from driver.experiment.history import History, turning_points
from driver.forward.build import build_model, geometry_of
from driver.forward.model import ForwardModel
from driver.identification.data import Data
from driver.identification.image_data import build_image_data
from driver.identification.objective import Objective
from driver.parameters.boundary import elongation_names, tilt_names
from driver.parameters.registry import declared_parameters
from meshes.arrays import FloatArray
from meshes.prism import generate
from meshes.prism_mesh import PrismMesh
from solver_adapters.crystal import rotation_vector_matrix
from solver_adapters.interface import Capabilities, Direction, Progress, Response, Simulation
from solver_adapters.material import MATERIAL_PARAMETERS, Material

LENGTH, WIDTH = 4.0, 2.0
PIXEL = 0.11
ORIGIN = (13.5, 6.0)
SHAPE = (28, 49)
BOUNDS = (PIXEL - WIDTH / 2, WIDTH / 2 - PIXEL, PIXEL, LENGTH - PIXEL)
SIGMA, N_REPEATS = 0.002, 10
LOAD_NOISE = 1.0
KNOTS = (0.020, 0.0176, 0.048, 0.0455)
TILTS = (0.004, 0.003, 0.010, 0.009)
LAW = ("tau0", "c", "d")
SIZES = (1.2, 1.0)
_STEP = 1e-6


class ClosedFormSolver:
    """Motion and load in closed form; derivatives by central differences along directions.

    Attributes:
        finer: by how much each time step in an interval changes the answer, as those of a finer
            simulation do: the load [relative], and the motion in the middle of the face
            [µm for a plastic strain of one].
    """

    name = "closed form"

    def __init__(self, finer: float = 0.0) -> None:
        self.finer = finer

    def capabilities(self) -> Capabilities:
        """Return what the closed form honours: every parameter, with derivatives."""
        law, measures = frozenset(MATERIAL_PARAMETERS), frozenset({"small", "finite"})
        return Capabilities(law, measures, derivatives=True, times=True, in_process=True)

    def version(self) -> str:
        """Return the same for ever."""
        return "1"

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        """Evaluate the closed form, and its directions by central differences."""
        u, force = self.answer(simulation)
        n = len(simulation.directions)
        du, df = np.zeros((n, *u.shape)), np.zeros((n, *force.shape))
        for k, direction in enumerate(simulation.directions):
            h = _STEP * _size(simulation.material, direction)
            above, below = (self.answer(stepped(simulation, direction, s)) for s in (h, -h))
            du[k], df[k] = (above[0] - below[0]) / (2 * h), (above[1] - below[1]) / (2 * h)
        return Response(u, force, du, df)

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        """Displacement of the output nodes (T, n, 3) and load (T,)."""
        signals, load = time_signals(simulation)
        points = simulation.mesh.points[simulation.output_nodes]
        change = self.finer * simulation.steps_per_interval
        signals["contrast"] = signals["contrast"] + change * signals["plastic"]
        return field(signals, points[:, 0], points[:, 1]), (1 - change) * load


def _size(material: Material, direction: Direction) -> float:
    return max([1.0, *(abs(float(getattr(material, name))) for name in direction.material)])


def stepped(simulation: Simulation, direction: Direction, step: float) -> Simulation:
    """Return the simulation a step along a direction."""
    material, mesh = simulation.material, simulation.mesh
    changed = {n: getattr(material, n) + step * s for n, s in direction.material.items()}
    simulation = replace(simulation, material=replace(material, **changed))
    if direction.rotation is not None:
        turned = [
            rotation_vector_matrix(step * rate) @ rotation
            for rate, rotation in zip(direction.rotation, simulation.orientations, strict=True)
        ]
        simulation = replace(simulation, orientations=np.stack(turned))
    if direction.motion is not None:
        simulation = replace(simulation, motion=simulation.motion + step * direction.motion)
    if direction.points is not None:
        moved = replace(mesh, points=mesh.points + step * direction.points)
        simulation = replace(simulation, mesh=moved)
    if direction.times is not None:
        simulation = replace(simulation, times=simulation.times + step * direction.times)
    return simulation


def field(signals: Mapping[str, FloatArray], x: FloatArray, y: FloatArray) -> FloatArray:
    """Motion of the measured face [µm] at (n,) points or at (T, n) points, shape (T, n, 3)."""
    s = {name: signal[:, None] for name, signal in signals.items()}
    eta = y / LENGTH
    bubble = 4 * eta * (1 - eta)
    u = s["side"] * eta + x * (s["bend_Z"] * eta - 0.3 * s["strain"] + s["lateral"])
    v = (
        s["minus"] * (1 - eta)
        + s["plus"] * eta
        + s["turn"] * x * eta
        + bubble * (s["contrast"] + s["skew"])
    )
    w = (
        s["minus_Z"] * (1 - eta)
        + s["plus_Z"] * eta
        + s["bend"] * bubble
        + s["out_1"] * (1 - eta) ** 2
        + s["out_2"] * eta**2
        + s["dish"] * x**2
    )
    return np.stack(np.broadcast_arrays(u, v, w), axis=-1)


def time_signals(simulation: Simulation) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return what multiplies each shape of `field` at the output instants, and the load (T,)."""
    mesh, m = simulation.mesh, simulation.material
    depth = -float(mesh.points[:, 2].min())
    ends = {}
    for name in ("MINUS", "PLUS"):
        rows = np.isin(simulation.motion_nodes, mesh.nodes[f"S_{name}"])
        at = mesh.points[simulation.motion_nodes[rows]]
        plane = np.column_stack([np.ones(len(at)), -at[:, 2] / depth, at[:, 0]])
        # Value at the middle of the edge, slope towards the apex, slope across.
        ends[name] = np.einsum("fn,tnc->tfc", np.linalg.pinv(plane), simulation.motion[:, rows])
    minus, plus = ends["MINUS"], ends["PLUS"]
    stretch = (plus[:, 0, 1] - minus[:, 0, 1]) + (plus[:, 1, 1] - minus[:, 1, 1]) / 3
    strain = stretch / LENGTH
    axial = np.array([np.sum(r[1] ** 4) for r in simulation.orientations])
    along = np.array([np.sum(r[1] ** 3 * r[2]) for r in simulation.orientations])
    across = np.array([np.sum(r[1] ** 3 * r[0]) for r in simulation.orientations])
    first = _share_of_first_grain(mesh)
    tau = m.tau0 * (first + (1 - first) * m.tau0_grain2) * (0.8 + 0.2 * axial.mean())
    modulus = m.elastic_scale * 0.6 * (m.C11 + m.C44 * m.C44_scale)
    stress = _hysteresis(strain, simulation.times, modulus, tau, m)
    plastic = strain - stress / modulus
    load = WIDTH * depth / 2 * stress
    contrast = 0.5 * np.log(m.tau0_grain2) + 0.3 * (axial[0] - axial[-1]) + 0.4 * (first - 0.5)
    signals = {
        "minus": minus[:, 0, 1],
        "plus": plus[:, 0, 1],
        "minus_Z": minus[:, 0, 2],
        "plus_Z": plus[:, 0, 2],
        "side": plus[:, 0, 0],
        "turn": plus[:, 2, 1],
        "strain": strain,
        "plastic": plastic,
        "bend": 0.5 * (plus[:, 1, 1] - minus[:, 1, 1]),
        "skew": 0.3 * (plus[:, 1, 1] + minus[:, 1, 1]),
        "bend_Z": 0.3 * plus[:, 1, 2] - 0.2 * minus[:, 1, 2],
        "contrast": LENGTH * plastic * contrast,
        "lateral": plastic * (across[0] + 0.5 * across[-1]),
        "out_1": LENGTH * plastic * along[0],
        "out_2": LENGTH * plastic * along[-1],
        "dish": plastic * (np.log(m.tau0_112) + 0.05 * m.Q_latent)
        + 0.1 * strain * np.log(m.C44_scale),
    }
    return {name: s[simulation.output] for name, s in signals.items()}, load[simulation.output]


def _share_of_first_grain(mesh: PrismMesh) -> float:
    corners = mesh.points[mesh.cells[:, :4]]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    return float(volume[mesh.grain == 0].sum() / volume.sum())


def _hysteresis(
    strain: FloatArray, times: FloatArray, modulus: float, tau: float, m: Material
) -> FloatArray:
    """Two elements in parallel, elastic on unloading and saturating on loading."""
    stress, back, path = 0.0, 0.0, 0.0
    total = np.zeros(len(strain))
    for k in range(1, len(strain)):
        step = strain[k] - strain[k - 1]
        path += abs(step)
        rate = np.hypot(step / (times[k] - times[k - 1]), 1e-7) / 1e-5
        flow = 2.2 * tau * m.tau0_112**0.3 + 0.5 * m.K * rate ** (1 / m.n)
        flow += 2.2 * (m.Q + 2 * m.Q_latent) * (1 - np.exp(-m.b * path))
        stress = _saturating(stress, step, modulus, flow)
        back = _saturating(back, step, 0.3 * m.c, 2.2 * m.c / m.d)
        total[k] = stress + back
    return total


def _saturating(stress: float, step: float, modulus: float, limit: float) -> float:
    sign = 1.0 if step >= 0 else -1.0
    stress, length = sign * stress, abs(step)
    if stress < 0:
        elastic = min(length, -stress / modulus)
        stress, length = stress + modulus * elastic, length - elastic
    if length > 0:
        stress = limit + (stress - limit) * float(np.exp(-modulus * length / limit))
    return sign * stress


@dataclass(frozen=True, eq=False)
class ClosedFormSpecimen:
    """The specimen, its model and the truth of its parameters."""

    case: Case
    mesh: PrismMesh
    history: History
    model: ForwardModel
    truth: dict[str, float]


def history() -> History:
    """Two cycles with a hold at each peak, an image at each instant."""
    stage = np.concatenate(
        [
            np.linspace(0, 40, 11), [40.0, 40.0], np.linspace(40, 28, 6)[1:],
            np.linspace(28, 96, 18)[1:], [96.0, 96.0], np.linspace(96, 82, 8)[1:],
        ]
    )  # fmt: skip
    rows = np.arange(stage.size)
    turning = turning_points(stage)
    return History(
        time=np.asarray(10.0 * rows, dtype=np.float64),
        stage=stage,
        image_row=rows,
        force=np.zeros(stage.size),
        turning=turning,
        cycle=np.where(rows <= turning[2], 1, 2),
    )


def small_case() -> Case:
    """Two grains, 4 × 2 µm."""
    case = default_case()
    specimen = case.specimen.model_copy(
        update={
            "length_um": LENGTH, "width_um": WIDTH,
            "cells": "tet10", "mesh_size_um": SIZES[0], "fine_mesh_size_um": SIZES[1],
            "boundary_point_um": (0.0, 2.0, 0.0), "boundary_normal": (0.1, 1.0, 0.2),
        }
    )  # fmt: skip
    grains = (
        case.grains[0].model_copy(update={"euler_deg": (281.0, 8.0, 47.0)}),
        case.grains[1].model_copy(update={"euler_deg": (211.0, 45.0, 150.0)}),
    )
    return case.model_copy(
        update={
            "specimen": specimen,
            "grains": grains,
            "images": case.images.model_copy(update={"origin_pixel": ORIGIN}),
            "loads": case.loads.model_copy(update={"noise_uN": LOAD_NOISE}),
            "dic": case.dic.model_copy(update={"element_px": 12, "height_element_px": 8}),
            "execution": case.execution.model_copy(update={"processes": 1}),
        }
    )


def pixels() -> FloatArray:
    """X, Y of the pixels of the face [µm], shape (n, 2)."""
    row, col = np.indices(SHAPE)
    xy = np.column_stack([(row.ravel() - ORIGIN[0]) * PIXEL, (col.ravel() - ORIGIN[1]) * PIXEL])
    x0, x1, y0, y1 = BOUNDS
    inside = (xy[:, 0] >= x0) & (xy[:, 0] <= x1) & (xy[:, 1] >= y0) & (xy[:, 1] <= y1)
    return np.asarray(xy[inside])


def problem(case: Case | None = None, past: History | None = None) -> ClosedFormSpecimen:
    """Return specimen with every parameter at its null but the knots.

    Args:
        case: the case, None for `small_case`.
        past: its history of two cycles, None for `history`.
    """
    case, h = case or small_case(), past or history()
    mesh = generate(geometry_of(case), case.specimen.mesh_size)
    model = build_model(case, mesh, h, pixels(), ClosedFormSolver(), 1)
    n = len(KNOTS) + 1
    knots = dict(zip((*elongation_names(n), *tilt_names(n)), (*KNOTS, *TILTS), strict=True))
    return ClosedFormSpecimen(case, mesh, h, model, model.null_values() | knots)


def relief(x: FloatArray, y: FloatArray) -> FloatArray:
    """Heights [µm] of a smooth random relief, 50 nm rms, 6 to 14 px wavelength, closed form."""
    rng = np.random.default_rng(11)
    height = np.full(np.broadcast_shapes(x.shape, y.shape), 0.5)
    for angle, wavelength, phase in rng.uniform((0, 6, 0), (np.pi, 14, 2 * np.pi), (50, 3)):
        k = 2 * np.pi / (wavelength * PIXEL)
        height = height + 0.01 * np.cos(k * (np.cos(angle) * x + np.sin(angle) * y) + phase)
    return height


def height_maps(
    b: ClosedFormSpecimen, values: Mapping[str, float], seed: int
) -> tuple[FloatArray, FloatArray]:
    """Frames (T, rows, cols) and repeats [µm] of a specimen with these parameters."""
    signals, _ = time_signals(b.model.simulation(values))
    row, col = np.indices(SHAPE)
    seen_x = np.asarray((row.ravel() - ORIGIN[0]) * PIXEL, dtype=np.float64)
    seen_y = np.asarray((col.ravel() - ORIGIN[1]) * PIXEL, dtype=np.float64)
    centre = np.array(b.model.instrument.centre)

    def appearance(x: FloatArray, y: FloatArray) -> FloatArray:
        x, y = np.add(x, values["origin_X"]), np.add(y, values["origin_Y"])
        motion = field(signals, x, y)
        p = b.model.instrument.progress[:, None]
        drift = {n: values[n] * p for n in ("magnification_drift", "scan_shear_drift")}
        motion[..., 2] *= 1 + values["height_scale"]
        motion[..., 0] += drift["magnification_drift"] * (x - centre[0])
        motion[..., 0] += drift["scan_shear_drift"] * (y - centre[1])
        motion[..., 1] += drift["magnification_drift"] * (y - centre[1])
        motion[..., 2] += values["tilt_drift"] * p * (x - centre[0]) + values["height_drift"] * p
        return np.asarray(motion + stage_error(b)[:, None])

    x = np.broadcast_to(seen_x, (b.history.n_images, seen_x.size))
    y = np.broadcast_to(seen_y, x.shape)
    for _ in range(8):
        motion = appearance(x, y)
        x = np.asarray(seen_x - motion[..., 0], dtype=np.float64)
        y = np.asarray(seen_y - motion[..., 1], dtype=np.float64)
    frames = (relief(x, y) + appearance(x, y)[..., 2]).reshape(-1, *SHAPE)
    repeats = np.repeat(relief(seen_x, seen_y).reshape(1, *SHAPE), N_REPEATS, axis=0)
    rng = np.random.default_rng(seed)
    return (
        frames + SIGMA * rng.standard_normal(frames.shape),
        repeats + SIGMA * rng.standard_normal(repeats.shape),
    )


def stage_error(b: ClosedFormSpecimen) -> FloatArray:
    """Rigid motion of each frame after the stage has re-centred and refocused [µm], (T, 3)."""
    error = np.random.default_rng(77).uniform(-0.3, 0.3, (b.history.n_images, 3))
    return error * [PIXEL, PIXEL, 0.1]


def readings(b: ClosedFormSpecimen, values: Mapping[str, float], seed: int) -> FloatArray:
    """Measured loads [µN], shape (T,)."""
    simulation = b.model.simulation(values)
    _, force = time_signals(simulation)
    at = b.model.clock(values)[b.history.image_row] + values["load_lag"]
    force = np.interp(at, simulation.times[simulation.output], force)
    noise = np.random.default_rng(seed + 1).standard_normal(force.size)
    gain = 1 + values["load_gain"]
    drift = values["load_offset"] + values["load_drift"] * b.model.instrument.progress
    return gain * force + drift + LOAD_NOISE * noise


def surface_images(b: ClosedFormSpecimen, values: Mapping[str, float], seed: int) -> SurfaceImages:
    """Return the images of a specimen with these parameters, gradient from the relief itself."""
    frames, repeats = height_maps(b, values, seed)
    images = prepare(frames, repeats, None, PIXEL, ORIGIN, BOUNDS).kept()
    x, y = images.xy.T
    h = 1e-5
    gradient = np.column_stack(
        [relief(x + h, y) - relief(x - h, y), relief(x, y + h) - relief(x, y - h)]
    )
    return replace(images, gradient=gradient / (2 * h))


def objective(b: ClosedFormSpecimen, values: Mapping[str, float], seed: int = 0) -> Objective:
    """Return what is minimised for data made with these parameters, without priors."""
    images = surface_images(b, values, seed)
    motion = b.model.predict(values).motion + stage_error(b)[:, None]
    image = build_image_data(
        images,
        grid_basis(images.xy, images.bounds, 12 * PIXEL),
        grid_basis(images.xy, images.bounds, 8 * PIXEL),
        motion.mean(axis=1),
        "translation",
        motion[:, ::200, :2],
    )
    load = readings(b, values, seed)
    data = Data(image, load, LOAD_NOISE, 0.0, np.arange(b.history.n_images))
    return Objective(b.model, data, declared_parameters(len(KNOTS) + 1))


def write_files(folder: Path, injected: Mapping[str, float]) -> None:
    """Case, images and history of the specimen with some parameters off their null."""
    b = problem()
    case = b.case.model_copy(
        update={
            "images": b.case.images.model_copy(update={"flats": None}),
            "identification": b.case.identification.model_copy(update={"max_iterations": 15}),
            "diagnosis": b.case.diagnosis.model_copy(update={"refit": 2}),
        }
    )
    write_case(case, folder / "case.toml")
    truth = {**b.truth, **injected}
    frames, repeats = height_maps(b, truth, 0)
    for name, heights in (("images", frames), ("repeats", repeats)):
        levels = (heights / case.images.level_um).astype(np.float32)
        tifffile.imwrite(folder / f"{name}.tif", levels)
    force = readings(b, truth, 0) / case.force_scale
    rows = zip(b.history.time, b.history.stage, range(force.size), force, strict=True)
    lines = ["time_s,stage_um,image,force_N", *(",".join(map(str, row)) for row in rows)]
    (folder / "history.csv").write_text("\n".join(lines), encoding="utf-8")
