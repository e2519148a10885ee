"""Rows of the tables of the report, every number already a text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_args

from driver.common.formatting import interval, number, probability, signed, with_sigma, with_unit
from driver.diagnosis.answer.result_types import Corrected
from driver.diagnosis.statistics.goodness_of_fit import FAMILY_LEVEL
from driver.parameters.boundary import LAMBDAS, knot_number
from driver.parameters.covariance import COVARIANCE_PARAMETERS
from driver.parameters.registry import label_of
from driver.report.evidence_figures import signed_evidence
from driver.report.findings import Findings
from driver.report.identified import interval_of
from driver.report.labels import cause_label, change, reading_unit, smallest
from solver_adapters.grain_scalars import as_honoured
from solver_adapters.material import MATERIAL_DECLARATIONS
from solver_adapters.parameter import Parameter

Row = dict[str, Any]
_LAW = frozenset(parameter.name for parameter in MATERIAL_DECLARATIONS)
Declared = Mapping[str, Parameter]


def cause_rows(step: Row, declared: Declared) -> list[Row]:
    """Return the causes of a round: refitted ones first, then by their screening.

    Args:
        step: a round of `diagnosis.json`.
        declared: the parameters of the general model.
    """
    return [_cause_row(cause, step, declared) for cause in ordered(step["causes"])]


def ordered(causes: Sequence[Row]) -> list[Row]:
    """Refitted causes by their evidence, then the others by their screening."""
    return sorted(causes, key=lambda cause: (cause["refit"] is None, -evidence_of(cause)))


def evidence_of(cause: Row) -> float:
    """Return the log evidence of a cause of a round: by its refit, or else by its screening."""
    refit = cause["refit"]
    return float((cause if refit is None else refit)["log_evidence"])


def less_corrected(causes: Sequence[Row], winner: Row) -> list[int]:
    """Places of refits whose correction was taken farther from their end than that of the winner.

    Args:
        causes: of a round.
        winner: the one that it added.
    """
    order = get_args(Corrected)
    known = {k: order.index(c["refit"]["corrected"]) for k, c in enumerate(causes) if c["refit"]}
    own = next((known[k] for k in known if causes[k] is winner), 0)
    return [k for k, at in known.items() if at < own]


def _cause_row(cause: Row, step: Row, declared: Declared) -> Row:
    named, refit = step["named"], cause["refit"]
    declared = {**declared, **COVARIANCE_PARAMETERS}
    parameters = []
    for name, unit, estimate, visible in zip(
        cause["parameters"], cause["units"], cause["estimate"], cause["smallest_visible"],
        strict=True,
    ):  # fmt: skip
        logarithmic = name in declared and declared[name].logarithmic
        parameters.append(
            {
                "label": label_of(name),
                "estimate": change(name, unit, estimate, logarithmic),
                "refit": None if refit is None else _refitted(name, unit, refit),
                "visible": smallest(name, unit, visible, logarithmic),
            }
        )
    return {
        "name": cause["cause"],
        "label": cause_label(cause["cause"]),
        "sentence": cause["sentence"],
        "category": cause["category"],
        "p": "–" if cause["p_family"] is None else probability(cause["p_family"]),
        "score": signed_evidence(cause["log_evidence"]),
        "refit": None if refit is None else signed_evidence(refit["log_evidence"]),
        # A flip of the EBSD frame has no parameter.
        "parameters": parameters or [{"label": "–", "estimate": "", "refit": "", "visible": ""}],
        "winner": bool(named) and cause["cause"] == named[0],
        "in_set": cause["cause"] in named[1:],
        "left_something": cause["cause"] in step["left_something"],
    }


def _refitted(name: str, unit: str, refit: Row) -> str:
    return measure(name, unit, refit["values"][name], refit["sigma"][name])


def measure(name: str, unit: str, value: float, sigma: float | None) -> str:
    """“value ± σ unit” in the unit in which the parameter is read."""
    factor, shown = reading_unit(name, unit)
    text = with_sigma(factor * value, None if sigma is None else factor * sigma)
    return with_unit(text, shown)


def added_rows(findings: Findings) -> list[Row]:
    """Return the parameters that the extension has freed."""
    rows = []
    for name, record in findings.diagnosis["added"].items():
        # A level of noise is none of the values of the model.
        noise = COVARIANCE_PARAMETERS.get(name)
        unit, null = record["unit"], findings.values[name] if noise is None else noise.null
        factor, shown = reading_unit(name, unit)
        off = findings.diagnosis["numerics"]["off_by_mesh"].get(name)
        rows.append(
            {
                "label": label_of(name),
                "name": name,
                "value": measure(name, unit, record["value"], record["sigma"]),
                "null": with_unit(number(factor * null, 4), shown),
                "sigmas": number(abs(record["value"] - null) / record["sigma"], 2),
                "off_by_mesh": "" if off is None else with_unit(number(factor * off, 2), shown),
            }
        )
    return rows


def parameter_rows(findings: Findings) -> list[tuple[str, list[Row]]]:
    """Return groups of parameters: start, value before and after, its interval, shift in σ."""
    before, after = (findings.fitted(side) for side in ("before", "after"))
    declared = findings.declared
    groups: dict[str, list[Row]] = {}
    for name in dict.fromkeys((*before, *after)):
        unit = (before.get(name) or after[name])["unit"]
        factor, shown = reading_unit(name, unit)
        start = findings.start_of(name)
        groups.setdefault(_group(name, findings.diagnosis["added"]), []).append(
            {
                "label": label_of(name),
                "name": name,
                "unit": shown,
                "start": number(factor * start, 4),
                "before": _pair(before.get(name), factor),
                "after": _pair(after.get(name), factor),
                "interval": _interval(declared[name], after.get(name), factor),
                "shift": _shift(before.get(name), after.get(name)),
            }
        )
    order = ("Law", "Added", "Apex amplitudes", "Elongation knots", "Tilt knots",
             "Instrument and geometry")  # fmt: skip
    return [(group, groups[group]) for group in order if group in groups]


def localisation_rows(where: Mapping[str, Any]) -> tuple[list[str], list[Row]]:
    """Places as columns, and a row for each phase: misfits before and after, and which are seen.

    Args:
        where: `whereabouts` of `diagnosis.json`.
    """
    before, after = (
        {(one["place"], one["phase"]): one for one in where[side]} for side in ("before", "after")
    )
    places = list(dict.fromkeys(place for place, _ in before))

    def cell(key: tuple[str, str]) -> list[Row]:
        ends = [side[key] for side in (before, after) if key in side]
        return [
            {"text": f"{one['misfit_sigma']:.1f}", "seen": one["p_family"] < FAMILY_LEVEL}
            for one in ends
        ]

    phases = list(dict.fromkeys(phase for _, phase in before))
    rows = [
        {"phase": phase, "cells": [cell((place, phase)) for place in places]} for phase in phases
    ]
    return [place.removeprefix("the ") for place in places], rows


def _group(name: str, added: Mapping[str, Any]) -> str:
    if name in added:
        return "Added"
    if name in LAMBDAS:
        return "Apex amplitudes"
    if knot_number(name) is not None:
        return "Elongation knots" if name.startswith("elongation") else "Tilt knots"
    return "Law" if as_honoured(name) in _LAW else "Instrument and geometry"


def _pair(record: Row | None, factor: float) -> str:
    if record is None:
        return "–"
    return with_sigma(factor * record["value"], factor * record["sigma"])


def _interval(parameter: Parameter, record: Row | None, factor: float) -> str:
    if record is None:
        return "–"
    value, sigma = record["value"], record["sigma"]
    low, high = interval_of(parameter, value, sigma / parameter.slope(value))
    return interval(factor * low, factor * high, factor * sigma)


def _shift(before: Row | None, after: Row | None) -> str:
    if before is None or after is None or before["sigma"] <= 0:
        return "–"
    return signed((after["value"] - before["value"]) / before["sigma"], 2)
