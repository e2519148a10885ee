"""What the page shows image by image: motion and residual of the face, loads, the specimen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from driver.experiment.reading import fitted_loads
from driver.report.face_blocks import FaceBlocks
from driver.report.figures import side_labels
from driver.report.findings import Findings
from driver.report.maps import GRAINS
from driver.report.measured import phases
from driver.report.measured_maps import LIMIT, field_limits
from driver.report.packed_arrays import PackedArrays, pack
from driver.report.specimen_surface import specimen_surface
from meshes.arrays import FloatArray, IntArray
from meshes.prism_mesh import PrismMesh

MOST_IMAGES, MOST_BLOCKS = 120, 1200  # whose fields a page holds
_COMPONENTS = "uvw"
_NM, _OF_NOISE = 0.02, 0.02  # steps to which fields are rounded
_DIGITS = 6
_FREE = "free"
Arrays = dict[str, tuple[FloatArray, float]]


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads of T images, or of T instants where there are none.

    Attributes:
        stage: stage travel [µm], shape (T,).
        cycle: cycle of each, from 1, shape (T,).
        strain: identified elongation over the length [1], shape (T,).
        measured: load [µN], NaN where it is left out, shape (T,).
        models: load of "before" (and "after") [µN], each of shape (T,).
        noise: standard deviation γ_F [µN].
        section: cross-section of the specimen [µm²].
    """

    stage: FloatArray
    cycle: IntArray
    strain: FloatArray
    measured: FloatArray
    models: Mapping[str, FloatArray]
    noise: float
    section: float


@dataclass(frozen=True, eq=False)
class View:
    """What a page shows image by image.

    Attributes:
        settings: numbers and names, as JSON holds them.
        arrays: the fields, and the surface of the specimen.
    """

    settings: dict[str, Any]
    arrays: PackedArrays

    @property
    def content(self) -> dict[str, Any]:
        """The settings with the entries of the arrays."""
        return self.settings | {"entries": self.arrays.entries}


def view_of_loads(loads: Loads, mesh: PrismMesh, grains: Sequence[str]) -> View:
    """Return the view of a case without images.

    Args:
        loads: its loads.
        mesh: the working mesh.
        grains: names of the grains.
    """
    settings = _settings(loads, np.arange(loads.stage.size))
    surface = specimen_surface(mesh) or {}
    return View(settings | {"face": None, "grains": _grains(grains)}, pack(surface))


def view_of_findings(findings: Findings) -> View:
    """Return the view of a case with images."""
    m, case = findings.measured, findings.case
    sides, face = findings.sides, findings.motion.face
    last = sides[-1]
    loads = Loads(
        stage=m["stage"],
        cycle=m["cycle"].astype(np.int64),
        strain=findings.edges(last)[findings.history.image_row, 0] / case.specimen.length,
        measured=fitted_loads(case, m["force"]),
        models={side: findings.predicted[f"{side}/load"] for side in sides},
        noise=findings.load_noise,
        section=case.section,
    )
    images = shown_images(loads.stage.size, findings.peaks, MOST_IMAGES)
    blocks = FaceBlocks.of(face, MOST_BLOCKS)
    fields = _fields(findings, blocks, images)
    settings = _settings(loads, images) | {
        "start": int(np.flatnonzero(images == findings.peaks[-1])[0]),
        "face": {
            "x": _rounded(blocks.x),
            "y": _rounded(blocks.y),
            "side": blocks.side,
            "step": face.pixel * blocks.side,
            "traces": face.traces.tolist(),
            "noise": _rounded(1e3 * findings.motion.nodal_sigma),
            "limits": _limits(fields, sides),
        },
        "grains": _grains([grain.name for grain in case.grains]),
    }
    return View(settings, pack(fields | _surface(findings)))


def shown_images(n: int, peaks: IntArray, most: int) -> IntArray:
    """Return all of n images, or evenly some of them with the peaks of the cycles, ascending."""
    if n <= most:
        return np.arange(n)
    evenly = np.round(np.linspace(0, n - 1, max(most - peaks.size, 2))).astype(np.int64)
    return np.unique(np.concatenate([evenly, peaks]))


def _settings(loads: Loads, images: IntArray) -> dict[str, Any]:
    loading = np.zeros(loads.stage.size, dtype=np.bool_)
    for up, of_phase in phases(loads.stage, loads.cycle):
        loading[of_phase[int(of_phase[0] > 0) :]] = up
    return {
        "models": side_labels(tuple(loads.models)),
        "images": images.tolist(),
        "start": len(images) - 1,
        "cycle": loads.cycle.tolist(),
        "loading": loading.tolist(),
        "stage": _rounded(loads.stage),
        "strain": _rounded(loads.strain),
        "load": {
            name: _rounded(load)
            for name, load in {"measured": loads.measured, **loads.models}.items()
        },
        "noise": loads.noise,
        "section": loads.section,
    }


def _fields(findings: Findings, blocks: FaceBlocks, images: IntArray) -> Arrays:
    """Motion [nm], its mean over the face removed, and residuals over their noise, by block."""
    m, predicted = findings.measured, findings.predicted
    motions = {_FREE: m["motion"]} | {s: predicted[f"{s}/motion"] for s in findings.sides}
    residuals = {_FREE: m["residual_over_noise"]}
    residuals |= {side: findings.residual(side) for side in findings.sides}
    fields: Arrays = {}
    for name, motion in motions.items():
        for k, component in enumerate(_COMPONENTS):
            values = np.stack([blocks.mean(_centred(motion[image, :, k])) for image in images])
            fields[f"{name}/{component}"] = (1e3 * values, _NM)
    for name, residual in residuals.items():
        values = np.stack([blocks.mean_over_noise(residual[image]) for image in images])
        fields[f"{name}/residual"] = (values, _OF_NOISE)
    return fields


def _surface(findings: Findings) -> Arrays:
    slip = findings.slip
    of_cells = None if slip is None else 100.0 * slip.of_cells
    return specimen_surface(findings.mesh, of_cells) or {}


def _centred(values: FloatArray) -> FloatArray:
    return np.asarray(values - np.mean(values, dtype=np.float64), dtype=np.float64)


def _limits(fields: Arrays, sides: Sequence[str]) -> dict[str, list[float]]:
    """Return ends of the colour scales of each component, of all images and models together."""
    limits = {"residual": [-LIMIT, LIMIT]}
    for component in _COMPONENTS:
        every = [fields[f"{name}/{component}"][0] for name in (_FREE, *sides)]
        seen = np.concatenate([values[np.isfinite(values)] for values in every])
        limits[component] = list(field_limits(seen))
    return limits


def _grains(names: Sequence[str]) -> list[dict[str, str]]:
    return [
        {"name": name, "colour": GRAINS[index % len(GRAINS)]} for index, name in enumerate(names)
    ]


def _rounded(values: FloatArray) -> list[float | None]:
    """Values with six digits, none where there is no number."""
    return [float(f"{v:.{_DIGITS}g}") if np.isfinite(v) else None for v in values.tolist()]
