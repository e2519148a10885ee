"""The errors of the correlation against mesh size, and the files that hold them.

`noise_floor.json` has a number for each motion, `noise_floor.csv` a mesh a row. Motions, elongation
and noise are in nm, ε_YY is a pure number, elements are in pixels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from driver.results.files import NOISE_FLOOR, NOISE_FLOOR_CSV
from driver.results.hdf5 import prismid_version, write_csv
from driver.results.json_files import write_json
from meshes.arrays import FloatArray

QUANTITIES = ("u", "v", "w", "strain", "elongation")
"""Motions and elongation [µm], ε_YY at a pixel [-]."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of one mesh, root mean square over the pixels, m motions.

    Attributes:
        bias: what noise does not explain, by quantity, each of shape (m,).
        scatter: standard deviation from noise of image and reference, by quantity, (m,).
        predicted: standard deviation of the elongation by its covariance [µm].
        converged: share of the images for which the correlation converged.
    """

    bias: Mapping[str, FloatArray]
    scatter: Mapping[str, FloatArray]
    predicted: float
    converged: float

    def total(self, quantity: str) -> float:
        """Root mean square error over all motions, of bias and scatter together."""
        return float(np.sqrt(np.mean(self.bias[quantity] ** 2 + self.scatter[quantity] ** 2)))


@dataclass(frozen=True, eq=False)
class Row:
    """One mesh.

    Attributes:
        size: element of u and v [px].
        size_w: element of w [px].
        errors: what the laboratory found.
        measured: standard deviation of the elongation of an image by the repeats [µm].
    """

    size: float
    size_w: float
    errors: Errors
    measured: float


@dataclass(frozen=True, eq=False)
class NoiseFloor:
    """The noise floor of the images of a case.

    Attributes:
        rows: the meshes.
        take: the mesh to take.
        rule: by which rule, in words.
        noise: of an image [µm], by the repeats.
        relief: root mean square of the reference about its plane [µm].
        n_reference: images averaged into the reference.
        interpolation_error: root mean square error with which the reference is moved [µm].
        noise_in_slopes: share of the squared slopes of the reference that is noise.
        series: series of the laboratory.
        draws: images of each motion in a series.
        paper_gamma_u: γ_u of the paper [µm].
        freedom: degrees of freedom of γ_u by the repeats.
        motions: name and kind of each motion.
    """

    rows: tuple[Row, ...]
    take: Row
    rule: str
    noise: float
    relief: float
    n_reference: int
    interpolation_error: float
    noise_in_slopes: float
    series: int
    draws: int
    paper_gamma_u: float
    freedom: int
    motions: tuple[tuple[str, str], ...]


def over_motions(values: FloatArray) -> float:
    """Root mean square of an error over the motions."""
    return float(np.sqrt(np.mean(values**2)))


def write_noise_floor(folder: Path, floor: NoiseFloor) -> None:
    """Write `noise_floor.json` and `noise_floor.csv`.

    Args:
        folder: where they go.
        floor: what they hold.
    """
    record = {
        "prismid": prismid_version(),
        "element_px": floor.take.size,
        "height_element_px": floor.take.size_w,
        "rule": floor.rule,
        "noise_nm": 1e3 * floor.noise,
        "relief_nm": 1e3 * floor.relief,
        "n_reference": floor.n_reference,
        "interpolation_error_nm": 1e3 * floor.interpolation_error,
        "share_of_noise_in_slopes": floor.noise_in_slopes,
        "series": floor.series,
        "draws": floor.draws,
        "gamma_u_paper_nm": 1e3 * floor.paper_gamma_u,
        "gamma_u_measured_freedom": floor.freedom,
        "motions": [{"name": name, "kind": kind} for name, kind in floor.motions],
        "meshes": [_mesh(row) for row in floor.rows],
    }
    write_json(folder / NOISE_FLOOR, record, indent=2)
    write_csv(folder / NOISE_FLOOR_CSV, _columns(floor.rows))


def _mesh(row: Row) -> dict[str, Any]:
    """Return a mesh for the JSON file; lists run over the motions."""
    record: dict[str, Any] = {
        "element_px": row.size,
        "height_element_px": row.size_w,
        "gamma_u_predicted_nm": 1e3 * row.errors.predicted,
        "gamma_u_laboratory_nm": 1e3 * over_motions(row.errors.scatter["elongation"]),
        "gamma_u_measured_nm": 1e3 * row.measured,
        "converged": row.errors.converged,
    }
    for quantity in QUANTITIES:
        factor, name = _labelled(quantity)
        record[name] = {
            "bias": (factor * row.errors.bias[quantity]).tolist(),
            "scatter": (factor * row.errors.scatter[quantity]).tolist(),
            "total": factor * row.errors.total(quantity),
        }
    return record


def _columns(rows: Sequence[Row]) -> dict[str, list[float]]:
    columns = {
        "element_px": [row.size for row in rows],
        "height_element_px": [row.size_w for row in rows],
    }
    for quantity in QUANTITIES:
        factor, name = _labelled(quantity)
        for part in ("bias", "scatter"):
            columns[f"{name}_{part}"] = [
                factor * over_motions(getattr(row.errors, part)[quantity]) for row in rows
            ]
    columns["gamma_u_predicted_nm"] = [1e3 * row.errors.predicted for row in rows]
    columns["gamma_u_measured_nm"] = [1e3 * row.measured for row in rows]
    return columns


def _labelled(quantity: str) -> tuple[float, str]:
    """Factor and name with unit of a quantity in files."""
    return (1.0, "strain") if quantity == "strain" else (1e3, f"{quantity}_nm")
