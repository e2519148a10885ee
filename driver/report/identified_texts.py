"""What the page says of the identification: tables, and words around its figures."""

from __future__ import annotations

from typing import Any

import numpy as np

from driver.common.formatting import chi, interval, number, with_sigma, with_unit
from driver.parameters.boundary import LAMBDAS
from driver.parameters.registry import label_of
from driver.report.figures import side_labels
from driver.report.findings import Findings
from driver.report.identified import interval_of
from driver.report.identified_tables import (
    apex_table,
    budget_table,
    core,
    estimate_rows,
    law_table,
    strongest,
    time_table,
)
from driver.report.labels import reading_unit

Row = dict[str, Any]


def identification(findings: Findings) -> Row:
    """Tables and texts of the section on the identification, by name."""
    estimates, results = findings.estimates, findings.identified
    few = core(tuple(estimates))
    names = list(estimates)
    rows = [names.index(name) for name in few]
    free = free_chi_f(findings)
    paper = {
        key: (float(results[f"paper/{key}"][0]), float(results[f"paper/{key}"][1]))
        for key in ("chi", "chi_f", "chi_F")
    }
    budgets, names_of = findings.budgets, side_labels(findings.sides)
    groups, many = estimate_rows(estimates)
    return {
        "groups": groups,
        "many": many,
        "warnings": findings.warnings,
        "strongest": strongest(few, results["correlation"][np.ix_(rows, rows)]),
        "apex": apex_table(_amplitudes(findings), free, paper["chi_f"]),
        "law": law_table(estimates, paper),
        "budget": budget_table(
            (budgets["before"]["free"], free),
            {names_of[side]: budget for side, budget in budgets.items()},
            {names_of["before"]: paper["chi_f"][1]},
            noise_chi_f(findings),
        ),
        "noise": chi(noise_chi_f(findings)),
        "time": time_table(findings.seconds),
        "hessian_alternative": _hessian_alternative(findings),
        "history_alternative": _history_alternative(findings),
    }


def _amplitudes(findings: Findings) -> dict[str, tuple[float, float, float | None]]:
    """Start, value and standard deviation; in the paper's order they are held at the end."""
    first = next(iter(findings.iterations.values()))["iterations"][0]
    estimates = findings.estimates
    return {
        name: (
            first[name],
            findings.values[name],
            estimates[name].sigma if name in estimates else None,
        )
        for name in LAMBDAS
        if name in first
    }


def noise_chi_f(findings: Findings) -> float:
    """χ_f of the paper where noise alone is left: √((1 + 1/n)/2), n repeats in the reference."""
    return float(np.sqrt(0.5 * (1.0 + 1.0 / float(findings.measured["n_reference"]))))


def free_chi_f(findings: Findings) -> float:
    """χ_f of free correlation in the weighting of the paper, over the images that are fitted."""
    m = findings.measured
    kept = m["residual"][m["left_out"] == 0].astype(np.float64)
    return float(np.sqrt(np.mean(kept**2) / (2.0 * float(m["sigma"]) ** 2)))


def law_tiles(findings: Findings) -> list[Row]:
    """Return the parameters of the law as they came out, with their 95 % intervals."""
    last, first = findings.fitted(findings.sides[-1]), findings.fitted("before")
    tiles = []
    for name, estimate in findings.estimates.items():
        if name not in core((name,)) or name in LAMBDAS:
            continue
        factor, unit = reading_unit(name, estimate.parameter.unit)
        value, sigma = last[name]["value"], last[name]["sigma"]
        low, high = interval_of(estimate.parameter, value, sigma / estimate.parameter.slope(value))
        before = ""
        if findings.extended:
            earlier = with_sigma(factor * first[name]["value"], factor * first[name]["sigma"])
            before = f"; before the extension {earlier}"
        tiles.append(
            {
                "title": label_of(name),
                "value": with_unit(with_sigma(factor * value, factor * sigma), unit),
                "note": f"95 %: {interval(factor * low, factor * high, factor * sigma)}{before}; "
                f"start {number(factor * estimate.start, 4)}",
            }
        )
    return tiles


def _hessian_alternative(findings: Findings) -> str:
    size = np.diag(findings.identified["kinematic_hessian"])
    order = np.argsort(-size)[:2]
    # An attribute of the page takes no index.
    first, second = (label_of(findings.hessian_names[k]).replace("_", "") for k in order)
    return (
        "Kinematic Hessian and correlation matrix, a number in each cell; "
        f"{first} and {second} move the images most"
    )


def _history_alternative(findings: Findings) -> str:
    last = findings.iterations["C"]["iterations"]
    return (
        "Curves over the iterations of the stages A, B and C: apex amplitudes, other parameters "
        f"over their start, residuals; stage C ends after {len(last) - 1} iterations"
    )
