"""Results of a case as labelled arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from driver.case.model import Case
from driver.results.files import DIAGNOSIS, DIAGNOSIS_H5, IDENTIFY, MEASURE, results_of
from driver.results.hdf5 import damaged, open_hdf5, prismid_version
from driver.results.identification import read_identification
from driver.results.json_files import read_json
from driver.results.mesh_sizes import sized_case
from driver.workflow.engine import finished
from driver.workflow.pipeline import stages
from meshes.arrays import AnyArray
from prismid.cases import CaseLike, file_of
from prismid.diagnosed import causes, effects, extended
from prismid.labelled import (
    Variable,
    dataset,
    of_images,
    of_parameters,
    of_points,
    xarray_library,
)

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
      `p_family`, `named`; the verdict in its attributes;
    - `effects` (round, effect): of each parameter of a cause its departure from the null, to first
      order `estimate`, and `smallest_visible`; refitted its `value` and `sigma`.

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
    stated = sized_case(file_of(case))
    folder = results_of(stated)
    needed = ("measure",) if stated.with_images else ("identify",)
    done = finished(stated, stages(stated), needed)
    base = _Results.of(folder / (MEASURE if stated.with_images else IDENTIFY))
    models = {
        label: (_Results.of(folder / name), prefix)
        for label, (stage, name, prefix) in _MODELS.items()
        if stage in done
    }
    nodes = {"images": _images(stated, base, models)}
    if stated.with_images:
        nodes["surface"] = _surface(base, models)
    if "identify" in done:
        nodes["parameters"] = _parameters(models["model"][0])
    if "diagnose" in done:
        path = folder / DIAGNOSIS
        record = read_json(path)
        try:
            nodes |= {
                "extended": extended(record),
                "causes": causes(record),
                "effects": effects(record),
            }
        except _DAMAGE as error:
            raise damaged(path, f"no readable diagnosis ({error!r})") from None
    root = dataset({}, {}, {"prismid": prismid_version(), "case": str(stated.file)})
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
        of_parameters(told.names, told.units)
        | {"with_parameter": (("with_parameter",), names, "", "")},
        {
            "reason": told.reason,
            "converged": int(told.converged),
            "warnings": list(told.warnings),
        },
    )
