"""What the finished stages of a case hold, read back and checked as a whole."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from driver.results.files import DIAGNOSIS, DIAGNOSIS_H5, IDENTIFY, MEASURE, MESH
from driver.results.hdf5 import damaged, read_hdf5
from driver.results.identification import read_identification
from meshes.arrays import FloatArray
from meshes.files import read_med
from meshes.prism_mesh import PrismMesh

LABELS = ("model", "extended")
# Sizes by letter: T images, P pixels, K free parameters, R rows and C columns of the reference.
_MEASURED = {
    **dict.fromkeys(("time", "stage", "cycle", "force", "chi", "elongation", "tilt"), "T"),
    "motion": "TP3",
    "xy": "P2",
    "rows": "P",
    "cols": "P",
    "reference": "RC",
}
_PREDICTED = {"load": "T", "load_residual": "T", "motion": "TP3", "rho": "TP"}
_DAMAGE = (KeyError, TypeError, ValueError, AttributeError)


@dataclass(frozen=True, eq=False)
class FinishedResults:
    """The results of the stages of a case as it is, T images and n_pix pixels.

    Attributes:
        mesh: the working mesh.
        measured: results of the correlation by name.
        models: the identified model and, after a diagnosis, the extended one.
        start: where the identification started, by free parameter.
    """

    mesh: PrismMesh
    measured: Mapping[str, FloatArray]
    models: tuple[FittedModel, ...]
    start: Mapping[str, float]

    @property
    def diagnosed(self) -> bool:
        """Whether the diagnosis is finished."""
        return len(self.models) > 1


def read_results(results: Path, diagnosed: bool) -> FinishedResults:
    """Read the results of finished stages back.

    Args:
        results: their folder.
        diagnosed: whether the diagnosis is finished.

    Raises:
        ResultError: a result file cannot be read, or is not what its stage writes.
    """
    sizes = {"2": 2, "3": 3}
    measured = read_hdf5(results / MEASURE)
    _expect(results / MEASURE, measured, _MEASURED, sizes)
    identified, start = _identified(results / IDENTIFY, sizes)
    models = [identified]
    if diagnosed:
        models.append(_extended(results, identified, sizes))
    return FinishedResults(_mesh(results / MESH), measured, tuple(models), start)


def _identified(path: Path, sizes: dict[str, int]) -> tuple[FittedModel, dict[str, float]]:
    arrays = read_hdf5(path)
    predicted = _predictions(path, arrays, "final", sizes)
    identification = read_identification(path)
    all_values = identification.values
    by_name = dict(zip(identification.names, identification.units, strict=True))
    _expect(path, arrays, {"sigma": "K", "start": "K"}, {"K": len(by_name)})
    model = FittedModel(
        label=LABELS[0],
        **predicted,
        values=all_values,
        sigma=dict(zip(by_name, arrays["sigma"].tolist(), strict=True)),
        units=by_name,
    )
    return model, dict(zip(by_name, arrays["start"].tolist(), strict=True))


def _extended(results: Path, model: FittedModel, sizes: dict[str, int]) -> FittedModel:
    path = results / DIAGNOSIS
    try:
        fitted = json.loads(path.read_text(encoding="utf-8"))["extended"]["values"]
        values = {name: float(entry["value"]) for name, entry in fitted.items()}
        sigma = {name: float(entry["sigma"]) for name, entry in fitted.items()}
        units = {name: str(entry["unit"]) for name, entry in fitted.items()}
    except _DAMAGE as error:
        raise damaged(path, f"no readable extended model ({error})") from None
    arrays = read_hdf5(results / DIAGNOSIS_H5)
    return FittedModel(
        label=LABELS[1],
        **_predictions(results / DIAGNOSIS_H5, arrays, "after", sizes),
        values={**model.values, **values},
        sigma=sigma,
        units=units,
    )


def _predictions(
    path: Path, arrays: Mapping[str, FloatArray], prefix: str, sizes: dict[str, int]
) -> dict[str, Any]:
    _expect(path, arrays, {f"{prefix}/{name}": s for name, s in _PREDICTED.items()}, sizes)
    return {name: arrays[f"{prefix}/{name}"] for name in _PREDICTED}


def _mesh(path: Path) -> PrismMesh:
    try:
        return read_med(path)
    except ValueError as error:
        raise damaged(path, f"no readable mesh ({error})") from None


def _expect(
    path: Path, arrays: Mapping[str, FloatArray], shapes: Mapping[str, str], sizes: dict[str, int]
) -> None:
    """Raise where a dataset is absent or has not its shape; new letters take the size found."""
    for name, letters in shapes.items():
        if name not in arrays or arrays[name].dtype.kind not in "iuf":
            raise damaged(path, f"no numbers {name}")
        shape = arrays[name].shape
        if len(shape) == len(letters):
            for letter, size in zip(letters, shape, strict=True):
                sizes.setdefault(letter, size)
        wanted = tuple(sizes.get(letter, letter) for letter in letters)
        if shape != wanted:
            words = ", ".join(map(str, wanted))
            raise damaged(path, f"{name} of shape {shape} in place of ({words})")


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A fitted model as its results tell it, T images and n_pix pixels.

    Attributes:
        label: "model" as identified, "extended" with the causes that the diagnosis added.
        load: predicted load [µN], shape (T,).
        load_residual: measured − predicted load [µN], shape (T,).
        motion: predicted motion at the pixels [µm], shape (T, n_pix, 3).
        rho: image residual f + w − g(x + u) [µm], shape (T, n_pix).
        values: value of every parameter.
        sigma: standard deviation of each free parameter.
        units: unit of each free parameter.
    """

    label: str
    load: FloatArray
    load_residual: FloatArray
    motion: FloatArray
    rho: FloatArray
    values: Mapping[str, float]
    sigma: Mapping[str, float]
    units: Mapping[str, str]
