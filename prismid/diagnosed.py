"""What `diagnosis.json` tells of fits and causes, as labelled arrays.

A record that is damaged raises KeyError, TypeError, ValueError or AttributeError.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from meshes.arrays import AnyArray
from prismid.labelled import Variable, dataset, of_parameters

if TYPE_CHECKING:
    import xarray

Key = TypeVar("Key")


def extended(record: Mapping[str, Any]) -> xarray.Dataset:
    """Return what the free parameters are with the causes that were added."""
    fitted = record["extended"]["values"]
    along = ("parameter",)
    return dataset(
        {
            name: (along, np.array([float(one[name]) for one in fitted.values()]), "", words)
            for name, words in (("value", "value"), ("sigma", "standard deviation"))
        },
        of_parameters(fitted, (one["unit"] for one in fitted.values())),
        {"added": list(record["added"])},
    )


def causes(record: Mapping[str, Any]) -> xarray.Dataset:
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


def effects(record: Mapping[str, Any]) -> xarray.Dataset:
    """Return the parameters of the causes that were tried, in their order, round by round."""
    rounds: list[dict[tuple[str, str], dict[str, Any]]] = []
    units: dict[tuple[str, str], str] = {}
    for step in record["steps"]:
        rounds.append({})
        for cause in step["causes"]:
            refit = cause["refit"] or {"values": {}, "sigma": {}}
            each = zip(
                cause["parameters"], cause["units"], cause["estimate"], cause["smallest_visible"],
                strict=True,
            )  # fmt: skip
            for name, unit, estimate, visible in each:
                units[cause["cause"], name] = unit
                rounds[-1][cause["cause"], name] = {
                    "estimate": estimate,
                    "smallest_visible": visible,
                    "value": refit["values"].get(name),
                    "sigma": refit["sigma"].get(name),
                }
    along, both = ("effect",), ("round", "effect")
    words = {
        "estimate": "departure from the null, to first order",
        "smallest_visible": "smallest departure that would have been seen",
        "value": "value of the refit",
        "sigma": "standard deviation of the refit",
    }
    return dataset(
        {name: (both, _numbers(rounds, units, name), "", said) for name, said in words.items()},
        {
            "round": (("round",), np.arange(1, len(rounds) + 1), "", "round"),
            "cause": (along, np.array([cause for cause, _ in units], dtype=str), "", ""),
            "parameter": (along, np.array([name for _, name in units], dtype=str), "", ""),
            "unit": (along, np.array(list(units.values()), dtype=str), "", ""),
        },
    )


def _numbers(
    rounds: Iterable[Mapping[Key, Mapping[str, Any]]], names: Iterable[Key], key: str
) -> AnyArray:
    """Numbers of each round and cause or effect, NaN where a cause was not tried or has none."""
    columns = list(names)
    rows = [[one.get(name, {}).get(key) for name in columns] for one in rounds]
    return np.array(rows, dtype=np.float64).reshape(-1, len(columns))
