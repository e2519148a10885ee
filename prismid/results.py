"""Results of a case as labelled arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from driver.case.model import Case
from driver.parameters.registry import label_of
from driver.results.files import DIAGNOSIS, DIAGNOSIS_H5, IDENTIFY, MEASURE, results_of
from driver.results.hdf5 import damaged, open_hdf5, prismid_version
from driver.results.identification import read_identification
from driver.results.json_files import read_json
from driver.results.mesh_sizes import sized_case
from driver.workflow.engine import finished
from driver.workflow.pipeline import stages
from meshes.arrays import AnyArray
from prismid.cases import CaseLike, file_of
from prismid.labelled import Variable, dataset, of_images, of_points, xarray_library

if TYPE_CHECKING:
    import xarray

# Large, and of no use here.
_LEFT_IN_FILE = ("residual_over_noise", "correction/motion", "trajectory/displacement")
# Of each model the stage that fits it, the file of its predictions, and how they begin there.
_MODELS = {
    "model": ("identify", IDENTIFY, "final"),
    "extended": ("diagnose", DIAGNOSIS_H5, "after"),
}
_DAMAGE = (KeyError, TypeError, ValueError, AttributeError)


def read_results(case: CaseLike) -> xarray.DataTree:
    """Read what the finished stages of a case have found.

    Nodes, each with what its stage has found; those of stages that are not finished for the case
    as it is are absent:

    - `images` (image): `load_measured`, `elongation`, `tilt`, `chi`, `left_out`; `load_model` of
      the identified and `load_extended` of the extended model;
    - `surface` (image, point, component): `motion` by free correlation, `motion_model`,
      `motion_extended`; `residual` (image, point), and of the models `residual_model`, …;
      coordinates X, Y of the points;
    - `parameters` (parameter, with_parameter): `value`, `sigma`, `start`, `covariance` and
      `correlation`, `prior_share` of what was identified, `unit` of each;
    - `extended` (parameter): `value` and `sigma` after the diagnosis;
    - `causes` (round, cause): `log_evidence`, `log_evidence_refit`, `statistic`, `degrees`,
      `p_family`, `named`; the verdict in its attributes.

    Lengths are in µm, loads in µN, times in s, stresses in MPa; each variable has its `units`.

    Args:
        case: the case, its file or its folder.

    Raises:
        InputError: the case cannot be used, the stage measure (of a case without images identify)
            has no results of the case as it is, or a file is damaged.
        LibraryError: xarray is not installed, which comes with `prismid[xarray]`.

    Examples:
        >>> import prismid
        >>> found = prismid.read_results("alpha")
        >>> motion = found["surface"].motion
        >>> motion.dims, motion.units
        (('image', 'point', 'component'), 'µm')
        >>> stretched = motion.sel(component="v").isel(image=5)
        >>> stretched.coords["Y"].units
        'µm'
    """
    xarray_library()
    read = sized_case(file_of(case))
    folder = results_of(read)
    needed = ("measure",) if read.with_images else ("identify",)
    done = finished(read, stages(read), needed)
    base = _Results.of(folder / (MEASURE if read.with_images else IDENTIFY))
    models = {
        label: (_Results.of(folder / name), prefix)
        for label, (stage, name, prefix) in _MODELS.items()
        if stage in done
    }
    nodes = {"images": _images(read, base, models)}
    if read.with_images:
        nodes["surface"] = _surface(base, models)
    if "identify" in done:
        nodes["parameters"] = _parameters(models["model"][0])
    if "diagnose" in done:
        path = folder / DIAGNOSIS
        record = read_json(path)
        try:
            nodes["extended"], nodes["causes"] = _extended(record), _causes(record)
        except _DAMAGE as error:
            raise damaged(path, f"no readable diagnosis ({error!r})") from None
    root = dataset({}, {}, {"prismid": prismid_version(), "case": str(read.file)})
    tree: xarray.DataTree = xarray_library().DataTree.from_dict({"/": root, **nodes})
    return tree


@dataclass(frozen=True, eq=False)
class _Results:
    """Datasets of a file by name."""

    path: Path
    datasets: Mapping[str, AnyArray]

    @staticmethod
    def of(path: Path) -> _Results:
        return _Results(path, open_hdf5(path, _LEFT_IN_FILE))

    def __getitem__(self, name: str) -> AnyArray:
        if name not in self.datasets:
            raise damaged(self.path, f"no dataset {name}")
        return self.datasets[name]


_Models = Mapping[str, tuple[_Results, str]]


def _image_coordinates(base: _Results) -> dict[str, Variable]:
    return of_images(base["time"], base["stage"], base["cycle"])


def _images(case: Case, base: _Results, models: _Models) -> xarray.Dataset:
    along = ("image",)
    variables: dict[str, Variable] = {"load_measured": (along, base["force"], "µN", "load")}
    for label, (found, prefix) in models.items():
        variables[f"load_{label}"] = (along, found[f"{prefix}/load"], "µN", f"load, {label}")
    if case.with_images:
        for name, unit, words in (
            ("elongation", "µm", "elongation of the specimen"),
            ("tilt", "µm", "w of the end S+ less that of S−"),
            ("chi", "", "χ of free correlation"),
        ):
            variables[name] = (along, base[name], unit, words)
        variables["left_out"] = (along, base["left_out"] > 0, "", "whether the image is left out")
    made = dataset(variables, _image_coordinates(base))
    made["load_measured"].attrs["sigma"] = case.loads.gamma_F
    if case.with_images:
        for name in ("elongation", "tilt"):
            made[name].attrs["sigma"] = float(base[f"{name}_sigma"])
    return made


def _surface(base: _Results, models: _Models) -> xarray.Dataset:
    along = ("image", "point")
    moved = (*along, "component")
    variables: dict[str, Variable] = {
        "motion": (moved, base["motion"], "µm", "motion by free correlation"),
        "residual": (along, base["residual"], "µm", "residual of free correlation"),
    }
    for label, (found, prefix) in models.items():
        motion, rho = found[f"{prefix}/motion"], found[f"{prefix}/rho"]
        variables[f"motion_{label}"] = (moved, motion, "µm", f"motion, {label}")
        variables[f"residual_{label}"] = (along, rho, "µm", f"residual of an image, {label}")
    made = dataset(variables, _image_coordinates(base) | of_points(base["xy"]))
    made["residual"].attrs["sigma"] = float(base["sigma"])
    return made


def _parameters(found: _Results) -> xarray.Dataset:
    told = read_identification(found.path)
    along, both = ("parameter",), ("parameter", "with_parameter")
    names, sigma = np.array(told.names), found["sigma"]
    correlation = found["correlation"]
    return dataset(
        {
            "value": (along, np.array([told.values[name] for name in told.names]), "", "value"),
            "sigma": (along, sigma, "", "standard deviation"),
            "start": (along, found["start"], "", "start"),
            "prior_share": (along, found["prior_share"], "", "share of the prior in the variance"),
            "covariance": (both, correlation * np.outer(sigma, sigma), "", "covariance"),
            "correlation": (both, correlation, "", "correlation"),
        },
        _of_parameters(told.names, told.units)
        | {"with_parameter": (("with_parameter",), names, "", "")},
        {
            "reason": told.reason,
            "converged": int(told.converged),
            "warnings": list(told.warnings),
        },
    )


def _of_parameters(names: Iterable[str], units: Iterable[str]) -> dict[str, Variable]:
    named, along = list(names), ("parameter",)
    return {
        "parameter": (along, np.array(named), "", ""),
        "unit": (along, np.array(list(units)), "", ""),
        "label": (along, np.array([label_of(name) for name in named]), "", ""),
    }


def _extended(record: Mapping[str, Any]) -> xarray.Dataset:
    fitted = record["extended"]["values"]
    along = ("parameter",)
    return dataset(
        {
            name: (along, np.array([float(one[name]) for one in fitted.values()]), "", words)
            for name, words in (("value", "value"), ("sigma", "standard deviation"))
        },
        _of_parameters(fitted, (one["unit"] for one in fitted.values())),
        {"added": list(record["added"])},
    )


def _causes(record: Mapping[str, Any]) -> xarray.Dataset:
    """Return the causes that were tried, those of the first round first, round by round."""
    rounds = [{cause["cause"]: cause for cause in step["causes"]} for step in record["steps"]]
    tried = {name: cause for one in reversed(rounds) for name, cause in one.items()}
    names = list(dict.fromkeys(name for one in rounds for name in one))
    refits = [
        {name: cause["refit"] for name, cause in one.items() if cause["refit"]} for one in rounds
    ]
    table = {
        "log_evidence": (rounds, "log Bayes factor, to first order"),
        "statistic": (rounds, "score statistic"),
        "degrees": (rounds, "degrees of freedom"),
        "p_family": (rounds, "probability by chance, of all tries"),
    }
    both = ("round", "cause")
    variables: dict[str, Variable] = {
        name: (both, _numbers(found, names, name), "", words)
        for name, (found, words) in table.items()
    }
    variables["log_evidence_refit"] = (
        both, _numbers(refits, names, "log_evidence"), "", "log Bayes factor of the refit"
    )  # fmt: skip
    named = [[name in step["named"] for name in names] for step in record["steps"]]
    variables["named"] = (both, np.array(named, dtype=bool).reshape(-1, len(names)), "", "")
    along = ("cause",)
    return dataset(
        variables,
        {
            "round": (("round",), np.arange(1, len(rounds) + 1), "", "round"),
            "cause": (along, np.array(names, dtype=str), "", ""),
            **{
                name: (along, np.array([tried[cause][name] for cause in names], dtype=str), "", "")
                for name in ("category", "sentence")
            },
        },
        {
            "verdict": record["verdict"],
            "named": list(record["causes"]),
            "text": record["text"],
            "next": record["next"],
        },
    )


def _numbers(
    rounds: Iterable[Mapping[str, Mapping[str, Any]]], names: Iterable[str], key: str
) -> AnyArray:
    """Numbers of each round and cause, NaN where a cause was not tried or has none."""
    columns = list(names)
    rows = [[one.get(name, {}).get(key) for name in columns] for one in rounds]
    return np.array(rows, dtype=np.float64).reshape(-1, len(columns))
