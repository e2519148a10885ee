"""What a design says of an experiment, and `design.json`, which holds it.

Times are in s, elongations in nm, loads in µN; a parameter has its unit beside it. A number that
is infinite is null.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.statistics.score_test import PARALLEL, SEEN_AT
from driver.results.files import DESIGN
from driver.results.hdf5 import prismid_version
from driver.results.json_files import json_number, write_json
from meshes.arrays import FloatArray

Pair = tuple[str, str]


@dataclass(frozen=True)
class Knowledge:
    """How well a parameter is known.

    Attributes:
        name: the parameter.
        value: where the model was linearised.
        unit: of the value.
        relative: whether θ is a logarithm, and σ of it a relative one.
        sigma: standard deviation, in the unit; infinite where nothing fixes it.
        theta: the same of θ: relative for a logarithm, else in scales.
        prior: standard deviation of θ before the experiment, infinite where there is no prior.
        alone: standard deviation of θ by the data, were all else known.
        parts: share of the variance by source: images, loads, simulation and prior.
        partner: the parameter or group that would help most, were it known.
        factor: σ with that known over σ.
        limit: what limits it, in words.
    """

    name: str
    value: float
    unit: str
    relative: bool
    sigma: float
    theta: float
    prior: float
    alone: float
    parts: Mapping[str, float]
    partner: str
    factor: float
    limit: str


@dataclass(frozen=True)
class Visible:
    """One parameter of a cause.

    Attributes:
        name: the parameter.
        unit: its unit; "" of a logarithm, whose magnitudes are relative.
        relative: whether it is a logarithm.
        scale: prior scale, in the unit or of the logarithm.
        sigma: standard deviation by the data, the fitted parameters projected out, in the unit.
        seen: smallest magnitude that would be seen, in the unit; infinite where none would.
        named: smallest magnitude that would be named, in the unit.
        left: share of its effect on the data, in σ, that the fitted parameters do not take.
        loads: share of what is left that is in the loads; the rest is in the images.
        hidden_by: fitted parameter or group that takes most of it.
        factor: smallest magnitude if that were known, over that if not.
    """

    name: str
    unit: str
    relative: bool
    scale: float
    sigma: float
    seen: float
    named: float
    left: float
    loads: float
    hidden_by: str
    factor: float

    @property
    def in_scales(self) -> float:
        """Smallest magnitude that would be seen, in prior scales."""
        return self.seen / self.scale


@dataclass(frozen=True)
class Outlook:
    """What would become of a cause.

    Attributes:
        cause: the cause.
        parameters: its parameters.
        cosines: likeness of what it and each other cause do to the data, the cosine for a
            parameter each.
    """

    cause: Cause
    parameters: tuple[Visible, ...]
    cosines: Mapping[str, float]

    @property
    def alike(self) -> dict[str, float]:
        """The causes that could not be told from it, with the cosine between them."""
        return {name: angle for name, angle in self.cosines.items() if angle > PARALLEL}

    @property
    def in_scales(self) -> float:
        """Smallest magnitude of its best visible parameter, in prior scales."""
        return min(parameter.in_scales for parameter in self.parameters)


@dataclass(frozen=True, eq=False)
class PlannedExperiment:
    """An experiment, and what it will say.

    Attributes:
        name: what it is called.
        change: the keys that differ from the case, as `--change` takes them.
        n_images: its images.
        duration: of the test [s].
        elongation: assumed at the turning points [µm], shape (n_knots,).
        load: predicted at the images next to them [µN], shape (n_knots,).
        parameters: the fitted ones.
        causes: those that the specimen can have.
    """

    name: str
    change: str
    n_images: int
    duration: float
    elongation: FloatArray
    load: FloatArray
    parameters: tuple[Knowledge, ...]
    causes: tuple[Outlook, ...]


@dataclass(frozen=True)
class Gain:
    """A changed experiment against that of the case.

    Attributes:
        sigma: standard deviation of θ over that before, by parameter.
        seen: smallest magnitude that would be seen over that before, by cause.
        parted: causes that could not be told apart before and clearly can be now.
        merged: causes that clearly could be told apart before and cannot be now.
        shown: causes that would now show at their usual size.
        lost: causes that would have shown at it before.
    """

    sigma: Mapping[str, float]
    seen: Mapping[str, float]
    parted: tuple[Pair, ...]
    merged: tuple[Pair, ...]
    shown: tuple[str, ...]
    lost: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Design:
    """An experiment and its changes.

    Attributes:
        surface: where the pattern comes from, in words.
        noise: of an image at a pixel [µm].
        load_noise: of the loads at the specimen [µN].
        named_at: projected misfit from which a cause is named [σ].
        experiment: the experiment of the case.
        changes: the changed experiments, and what each would buy.
    """

    surface: str
    noise: float
    load_noise: float
    named_at: float
    experiment: PlannedExperiment
    changes: tuple[tuple[PlannedExperiment, Gain], ...]


def write_design(folder: Path, design: Design) -> None:
    """Write `design.json`, whole or not at all.

    Args:
        folder: where it goes.
        design: what it holds.
    """
    write_json(
        folder / DESIGN,
        {
            "prismid": prismid_version(),
            "surface": design.surface,
            "noise_nm": 1e3 * design.noise,
            "load_noise_uN": design.load_noise,
            "seen_at_sigma": SEEN_AT,
            "named_at_sigma": design.named_at,
            "parallel_cosine": PARALLEL,
            "experiment": _experiment(design.experiment),
            "changes": [
                _experiment(experiment) | {"gain": _gain(gain)}
                for experiment, gain in design.changes
            ],
        },
    )


def _experiment(experiment: PlannedExperiment) -> dict[str, Any]:
    return {
        "name": experiment.name,
        "change": experiment.change,
        "n_images": experiment.n_images,
        "duration_s": experiment.duration,
        "elongation_nm": (1e3 * experiment.elongation).tolist(),
        "load_uN": experiment.load.tolist(),
        "parameters": [_known(p) for p in experiment.parameters],
        "causes": [_outlook(o) for o in experiment.causes],
    }


def _known(p: Knowledge) -> dict[str, Any]:
    return {
        "parameter": p.name,
        "assumed": p.value,
        "unit": p.unit,
        "sigma": json_number(p.sigma),
        "sigma_theta": json_number(p.theta),
        "prior_theta": json_number(p.prior),
        "alone_theta": json_number(p.alone),
        "variance_from": dict(p.parts),
        "correlated_with": p.partner,
        "factor_if_known": p.factor,
        "limited_by": p.limit,
    }


def _outlook(o: Outlook) -> dict[str, Any]:
    return {
        "cause": o.cause.name,
        "category": o.cause.category,
        "sentence": o.cause.sentence,
        "parameters": [_visible(p) for p in o.parameters],
        "cosines": dict(o.cosines),
        "not_told_from": list(o.alike),
    }


def _visible(p: Visible) -> dict[str, Any]:
    return {
        "parameter": p.name,
        "unit": p.unit,
        "relative": p.relative,
        "scale": p.scale,
        "sigma": json_number(p.sigma),
        "smallest_seen": json_number(p.seen),
        "smallest_named": json_number(p.named),
        "left": p.left,
        "in_loads": p.loads,
        "hidden_by": p.hidden_by,
        "factor_if_known": p.factor,
    }


def _gain(gain: Gain) -> dict[str, Any]:
    return {
        "sigma_ratio": {name: json_number(ratio) for name, ratio in gain.sigma.items()},
        "seen_ratio": {name: json_number(ratio) for name, ratio in gain.seen.items()},
        "parted": [list(pair) for pair in gain.parted],
        "merged": [list(pair) for pair in gain.merged],
        "shown": list(gain.shown),
        "lost": list(gain.lost),
    }
