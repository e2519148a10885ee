"""The report page of a case without images: its law, its loads, and what the loads left open."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from driver.case.model import Case
from driver.common.formatting import chi, interval, joined, number, with_sigma, with_unit
from driver.experiment.history import History, knot_weights
from driver.experiment.reading import fitted_loads, history_of
from driver.forward.build import parameters_of
from driver.identification.loads_alone import doubts
from driver.parameters.boundary import elongation_names
from driver.parameters.registry import label_of
from driver.report.all_figures import draw_loads_alone
from driver.report.first_screen import FirstScreen, Row, check_row, tile
from driver.report.identified import IdentifiedParameter, estimates
from driver.report.identified_tables import core, estimate_rows
from driver.report.labels import reading_unit
from driver.report.page import rendered
from driver.report.style import data_uri, png
from driver.report.vector_files import write_vectors
from driver.report.view import Loads, view_of_loads
from driver.results.files import IDENTIFY, MESH, REPORT, report_figure
from driver.results.hdf5 import prismid_version, read_hdf5
from driver.results.identification import IdentificationTexts, read_identification
from driver.workflow.engine import StageContext
from driver.workflow.report_stage import title_of, written_now
from meshes.arrays import FloatArray
from meshes.files import read_med

logger = logging.getLogger(__name__)

TEMPLATE = "report_loads.html.j2"


def run_report_loads(context: StageContext, vectors: Path | None = None) -> None:
    """Write `report.html`, and its figure as `report_loads.png`.

    Args:
        context: what the stage works with.
        vectors: a folder for the figure as PDF and SVG files, None for none.

    Raises:
        AbsentError, ResultError: a result is absent or damaged.
        OSError: a file cannot be written.
    """
    results, case = read_hdf5(context.result(IDENTIFY)), context.case
    identified, history = read_identification(context.result(IDENTIFY)), history_of(case)
    declared = parameters_of(case, history.n_knots)
    found = estimates(identified.names, declared, results)
    groups, knots = estimate_rows(found)
    loads = _loads(case, history, results, identified.values)
    figure = draw_loads_alone(case, results)
    picture = png(figure)
    (context.workdir / report_figure("loads")).write_bytes(picture)
    if vectors is not None:
        write_vectors("loads", figure, vectors)
    grains = [grain.name for grain in case.grains]
    head = _first_screen(case, results, identified, found)
    page = rendered(
        TEMPLATE, head, view_of_loads(loads, read_med(context.result(MESH)), grains),
        title_of(case), written_now(), prismid_version(),
        {
            "warnings": identified.warnings,
            "groups": groups,
            "knots": knots,
            "figures": {"loads": data_uri(picture)},
        },
    )  # fmt: skip
    (context.workdir / REPORT).write_text(page, encoding="utf-8")
    logger.info(f"  {REPORT}: {len(page) / 1e6:.1f} MB")


def _loads(
    case: Case, history: History, results: Mapping[str, FloatArray], values: Mapping[str, float]
) -> Loads:
    """Return the loads, and the strain that the knots of the elongation make."""
    knots = np.array([0.0, *(values[name] for name in elongation_names(history.n_knots))])
    elongation = (knot_weights(history) @ knots)[history.image_row]
    return Loads(
        stage=results["stage"],
        cycle=results["cycle"].astype(np.int64),
        strain=elongation / case.specimen.length,
        measured=fitted_loads(case, results["force"]),
        models={"before": results["final/load"]},
        noise=case.loads.gamma_F,
        section=case.section,
    )


def _first_screen(
    case: Case,
    results: Mapping[str, FloatArray],
    identified: IdentificationTexts,
    found: Mapping[str, IdentifiedParameter],
) -> FirstScreen:
    rest = np.delete(results["final/load_residual"], case.loads.left_out)
    of_loads = float(results["budget/load"])
    doubted = doubts(of_loads, rest.size, identified.converged)
    rms = number(float(np.sqrt(np.mean(rest**2))), 2)
    return FirstScreen(
        kind="not diagnosed, loads alone",
        tone="open" if doubted else "between",
        headline="Identified from loads alone"
        + (f", but {doubted[0]}." if doubted else ": they leave no more than noise."),
        tiles=[
            tile("loads: χ_F", chi(of_loads),
                 f"{rms} µN are left (root mean square) of {rest.size} loads with a noise of "
                 f"{number(case.loads.gamma_F)} µN"),
            tile("elongation over stage travel", _ratio(case), "as the case states it"),
        ],
        next="Images of the face would tell an error of the elongation from one of the law: loads "
        "alone cannot.",
        paragraphs=[
            f"There are no images: the elongation of the specimen follows the stage travel, "
            f"{_ratio(case)} of it, and {rest.size} loads{_left_out(case.loads.left_out)} are "
            f"fitted.",
            *(f"{doubt[0].upper()}{doubt[1:]}." for doubt in doubted[1:]),
            "Measured motion and diagnosis are left out. What the elongation carries into the "
            "parameters is in their standard deviations as far as that of the ratio is stated "
            "right.",
        ],
        law=[_law_tile(name, found[name]) for name in core(tuple(found))],
        checks=[
            check_row("fit", identified.converged, f"ended: {identified.reason}"),
            check_row("what is left", not doubted, joined(list(doubted)) if doubted else
                      f"χ_F = {chi(of_loads)}"),
        ],
    )  # fmt: skip


def _law_tile(name: str, found: IdentifiedParameter) -> Row:
    factor, unit = reading_unit(name, found.parameter.unit)
    sigma = factor * found.sigma
    low, high = (factor * end for end in found.interval)
    return tile(
        label_of(name),
        with_unit(with_sigma(factor * found.value, sigma), unit),
        f"95 %: {interval(low, high, sigma)}; start {number(factor * found.start, 4)}",
    )


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
