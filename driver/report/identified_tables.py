"""Rows of the tables of the identification, every number already a text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from driver.common.formatting import (
    chi,
    duration,
    interval,
    joined,
    number,
    percent,
    signed,
    with_sigma,
)
from driver.identification.identifiability import INSENSITIVE
from driver.parameters.boundary import LAMBDAS
from driver.parameters.registry import label_of, short_label_of
from driver.report.identified import IdentifiedParameter
from driver.report.labels import reading_unit
from meshes.arrays import FloatArray
from solver_adapters.grain_scalars import as_honoured
from solver_adapters.material import MATERIAL_DECLARATIONS

Row = dict[str, Any]
Groups = list[tuple[str, list[Row]]]


@dataclass(frozen=True)
class Table:
    """A small table, every cell a text.

    Attributes:
        head: names of the columns.
        rows: cells of each row, the first its name.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


ELONGATION, TILT, ORIGIN = "ΔU_Y knots", "ΔU_Z knots", "origin"
_STRONG = 0.7  # correlations that are named
_MOST_NAMED = 5
_LAW = frozenset(parameter.name for parameter in MATERIAL_DECLARATIONS)


def group_of(name: str) -> str:
    """Group in which a parameter is shown among many."""
    what, _, count = name.partition("_")
    if count.isdigit() and what in ("elongation", "tilt"):
        return ELONGATION if what == "elongation" else TILT
    return ORIGIN if what == "origin" else ""


def core(names: Sequence[str]) -> list[str]:
    """Return parameters that are shown one by one: apex amplitudes, law, then others but knots."""
    alone = [name for name in names if not group_of(name)]
    order = {True: 0, False: 1}
    return sorted(alone, key=lambda n: (order[n in LAMBDAS], order[as_honoured(n) in _LAW]))


def estimate_rows(found: Mapping[str, IdentifiedParameter]) -> tuple[Groups, Groups]:
    """Rows of the parameters that count, and of the knots and the origin, in groups."""
    alone: dict[str, list[Row]] = {}
    many: dict[str, list[Row]] = {}
    for name in core(tuple(found)):
        of_law = as_honoured(name) in _LAW
        where = "Apex amplitudes" if name in LAMBDAS else "Law" if of_law else "Others"
        alone.setdefault(where, []).append(_estimate_row(name, found[name]))
    titles = {ELONGATION: "Elongation knots", TILT: "Tilt knots", ORIGIN: "Position in the images"}
    for name, estimate in found.items():
        if group_of(name):
            many.setdefault(titles[group_of(name)], []).append(_estimate_row(name, estimate))
    return list(alone.items()), [(t, many[t]) for t in titles.values() if t in many]


def _estimate_row(name: str, found: IdentifiedParameter) -> Row:
    factor, unit = reading_unit(name, found.parameter.unit)
    low, high = (factor * end for end in found.interval)
    prior, bound, share = found.prior_interval, found.at_bound, found.prior_share
    sigma = factor * found.sigma
    return {
        "label": label_of(name),
        "name": name,
        "unit": unit or "1",
        "start": number(factor * found.start, 4),
        "prior": "none" if prior is None else _prior(prior, factor),
        "value": with_sigma(factor * found.value, sigma),
        "interval": interval(low, high, sigma),
        "share": "–" if prior is None else percent(share),
        "decided": share > INSENSITIVE,
        "bound": "" if bound is None else f"at {number(factor * bound)}",
    }


def _prior(ends: tuple[float, float], factor: float) -> str:
    low, high = (number(float(f"{factor * end:.2g}"), 2) for end in ends)
    return f"{low} to {high}"


def strongest(names: Sequence[str], correlation: FloatArray) -> str:
    """Return the strongest correlations, in a sentence.

    Args:
        names: the parameters, length k.
        correlation: shape (k, k).
    """
    rows, columns = np.triu_indices(len(names), 1)
    values = correlation[rows, columns]
    order = [k for k in np.argsort(-np.abs(values)) if abs(values[k]) >= _STRONG][:_MOST_NAMED]
    if not order:
        return f"No two of these parameters are correlated beyond ± {_STRONG:g}."
    pairs = [
        f"{short_label_of(names[rows[k]])} and {short_label_of(names[columns[k]])} "
        f"({signed(float(values[k]), 2)})"
        for k in order
    ]
    return f"Strongest: {joined(pairs)}."


def apex_table(
    amplitudes: Mapping[str, tuple[float, float, float | None]],
    free: float,
    chi_f: tuple[float, float],
) -> Table:
    """χ_f and apex amplitudes of free correlation, start and result (table 4 of Bertin 2016).

    Args:
        amplitudes: start, value and standard deviation (None where held in the end) by name.
        free: χ_f of free correlation.
        chi_f: χ_f at the start and at the result.
    """
    starts = (number(start) for start, _, _ in amplitudes.values())
    values = (with_sigma(value, sigma) for _, value, sigma in amplitudes.values())
    return Table(
        ("", "χ_f", *map(label_of, amplitudes)),
        (
            ("free correlation (DIC)", chi(free), *("–" for _ in amplitudes)),
            ("start", chi(chi_f[0]), *starts),
            ("identified", chi(chi_f[1]), *values),
        ),
    )


def law_table(
    found: Mapping[str, IdentifiedParameter], paper: Mapping[str, tuple[float, float]]
) -> Table:
    """χ, χ_f, χ_F and parameters of the law at start and result (table 5 of Bertin 2016).

    Args:
        found: the estimates.
        paper: "chi", "chi_f" and "chi_F" at the start and at the result.
    """
    names = [name for name in core(tuple(found)) if name not in LAMBDAS]
    heads = []
    for name in names:
        unit = reading_unit(name, found[name].parameter.unit)[1]
        heads.append(f"{label_of(name)} [{unit}]" if unit else label_of(name))
    starts = [
        number(reading_unit(n, found[n].parameter.unit)[0] * found[n].start, 4) for n in names
    ]
    rows = (("start", 0, starts), ("identified", 1, [_value(n, found[n]) for n in names]))
    return Table(
        ("", "χ", "χ_f", "χ_F over γ_F alone", *heads),
        tuple(
            (what, *(chi(paper[key][end]) for key in ("chi", "chi_f", "chi_F")), *texts)
            for what, end, texts in rows
        ),
    )


def _value(name: str, found: IdentifiedParameter) -> str:
    factor, _ = reading_unit(name, found.parameter.unit)
    return with_sigma(factor * found.value, factor * found.sigma)


def budget_table(
    free: tuple[float, float],
    sides: Mapping[str, Mapping[str, float]],
    paper: Mapping[str, float],
    noise: float,
) -> Table:
    """Return the error budget in numbers, from noise to the models.

    Args:
        free: χ of free correlation, pixel by pixel, and as χ_f over 2γ_f².
        sides: χ by name of the model: "model" (pixel by pixel), "basis", "load".
        paper: χ_f over 2γ_f² of the models for which it is known.
        noise: the same where noise alone is left.
    """
    unit, none = chi(1.0), "–"
    rows = [
        ("noise alone", unit, chi(noise), unit, unit),
        ("free correlation (DIC)", chi(free[0]), chi(free[1]), none, none),
    ]
    for name, of_side in sides.items():
        weighed = chi(paper[name]) if name in paper else none
        rows.append(
            (name, chi(of_side["model"]), weighed, chi(of_side["basis"]), chi(of_side["load"]))
        )
    return Table(("", "χ, pixels", "χ_f", "χ, correlation mesh", "χ_F, loads"), tuple(rows))


def time_table(seconds: Mapping[str, float]) -> Table:
    """Duration of each stage and its share of the whole.

    Args:
        seconds: by what was done, in order [s].
    """
    total = sum(seconds.values())
    rows = [
        (what, duration(spent), percent(spent / total if total else 0.0))
        for what, spent in [*seconds.items(), ("all", total)]
    ]
    return Table(("", "time", "share"), tuple(rows))
