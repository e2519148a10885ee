"""The report page of a case without images: its law, its loads, and what the loads left open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from driver.case.model import Case
from driver.common.formatting import chi, joined, number, with_sigma
from driver.experiment.reading import history_of
from driver.identification.loads_alone import doubts
from driver.parameters.registry import declared_parameters
from driver.report.all_figures import draw_loads_alone
from driver.report.identified import estimates
from driver.report.identified_tables import estimate_rows
from driver.report.style import data_uri, png
from driver.results.files import IDENTIFY, REPORT, report_figure
from driver.results.hdf5 import prismid_version, read_hdf5
from driver.results.identification import read_identification
from driver.workflow.engine import StageContext
from templates import render


def run_report_loads(context: StageContext) -> None:
    """Write `report.html`, and its figure as `report_loads.png`.

    Raises:
        AbsentError, ResultError: a result is absent or damaged.
    """
    results, case = read_hdf5(context.result(IDENTIFY)), context.case
    identified = read_identification(context.result(IDENTIFY))
    declared = declared_parameters(history_of(case).n_knots, case.material.to_material())
    groups, knots = estimate_rows(estimates(identified.names, declared, results))
    picture = png(draw_loads_alone(case, results))
    (context.workdir / report_figure("loads")).write_bytes(picture)
    rest = np.delete(results["final/load_residual"], case.loads.left_out)
    page = render(
        "report_loads.html.j2",
        title=context.case.file.resolve().parent.name,
        version=prismid_version(),
        n_loads=rest.size,
        left_out=_left_out(case.loads.left_out),
        chi=chi(float(results["budget/load"])),
        rms=number(float(np.sqrt(np.mean(rest**2))), 2),
        noise=number(case.loads.gamma_F),
        ratio=_ratio(case),
        reason=identified.reason,
        doubts=doubts(float(results["budget/load"]), rest.size, identified.converged),
        warnings=identified.warnings,
        groups=groups,
        knots=knots,
        picture=data_uri(picture),
    )
    (context.workdir / REPORT).write_text(page, encoding="utf-8")


def _ratio(case: Case) -> str:
    ratio, sigma = case.boundary.stage_ratio, case.boundary.stage_ratio_uncertainty
    assert ratio is not None and sigma is not None  # the case refuses itself without them
    return f"({with_sigma(1e4 * ratio, 1e4 * sigma)})·10⁻⁴"


def _left_out(loads: Sequence[int]) -> str:
    """Return what follows the word loads where the case leaves some out."""
    if not loads:
        return ""
    word = "number" if len(loads) == 1 else "numbers"
    return f" ({word} {joined([str(n) for n in sorted(loads)])} left out)"
