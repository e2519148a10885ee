"""A design as `design.json` holds it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from driver.design.comparison import gain
from driver.design.detectability import NAMED_AT, Outlook, Visible
from driver.design.forecast import Forecast
from driver.design.information import Knowledge
from driver.diagnosis.statistics.score_test import PARALLEL, SEEN_AT
from driver.results.hdf5 import prismid_version
from driver.results.json_files import json_number


def design_record(
    base: Forecast, surface: str, noise: float, others: Sequence[Forecast]
) -> dict[str, Any]:
    """Return the record of a design.

    Args:
        base: the experiment of the case.
        surface: where its surface comes from.
        noise: of an image at a pixel [µm].
        others: the changed experiments.
    """
    return {
        "prismid": prismid_version(),
        "surface": surface,
        "noise_nm": 1e3 * noise,
        "load_noise_uN": base.variant.case.loads.noise_uN,
        "seen_at_sigma": SEEN_AT,
        "named_at_sigma": NAMED_AT,
        "parallel_cosine": PARALLEL,
        "experiment": _forecast(base),
        "changes": [_forecast(other) | {"gain": _gain(base, other)} for other in others],
    }


def _forecast(found: Forecast) -> dict[str, Any]:
    return {
        "name": found.variant.name,
        "change": found.variant.change,
        "n_images": found.n_images,
        "duration_s": found.duration,
        "elongation_nm": (1e3 * found.elongation).tolist(),
        "load_uN": found.load.tolist(),
        "parameters": [_known(p) for p in found.parameters],
        "causes": [_outlook(o) for o in found.causes],
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


def _gain(base: Forecast, other: Forecast) -> dict[str, Any]:
    won = gain(base, other)
    return {
        "sigma_ratio": {name: json_number(ratio) for name, ratio in won.sigma.items()},
        "seen_ratio": {name: json_number(ratio) for name, ratio in won.seen.items()},
        "parted": [list(pair) for pair in won.parted],
        "merged": [list(pair) for pair in won.merged],
        "shown": list(won.shown),
        "lost": list(won.lost),
    }
