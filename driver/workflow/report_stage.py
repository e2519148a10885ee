"""Stage 6: the report page and its figures."""

from __future__ import annotations

import logging
from datetime import datetime
from pathlib import Path

from driver.case.model import Case
from driver.report import verdict
from driver.report.all_figures import draw
from driver.report.final_parameters import final_columns, final_told
from driver.report.findings import FILES, Findings, read_findings
from driver.report.first_screen import FirstScreen, first_screen_identified
from driver.report.page import report_page
from driver.report.style import png
from driver.report.vector_files import write_measured_vectors, write_vectors
from driver.report.view import view_of_findings
from driver.results.files import IDENTIFY, REPORT, REPORT_CSV, report_figure
from driver.results.hdf5 import prismid_version, write_csv
from driver.results.identification import read_identification
from driver.workflow.engine import StageContext

logger = logging.getLogger(__name__)


def run_report(context: StageContext, vectors: Path | None = None) -> None:
    """Write `report.html`, its figures as `report_….png`, and the parameters of the final model.

    Args:
        context: what the stage works with.
        vectors: a folder for the figures as PDF and SVG files, None for none.

    Raises:
        AbsentError, ResultError: a result is absent or damaged.
        HistoryError: the history cannot be used.
        OSError: a file cannot be written.
    """
    findings = read_findings(context.case, context.results)
    head = verdict.first_screen(findings)
    _write(context, findings, head, vectors)
    logger.info(f"  verdict: {head.kind}. {head.headline}")
    logger.info(f"  {final_told(findings)}")


def run_report_identified(context: StageContext, vectors: Path | None = None) -> None:
    """Write the same of a case that is identified and not diagnosed.

    Args:
        context: what the stage works with.
        vectors: as in `run_report`.

    Raises:
        AbsentError, ResultError, HistoryError, OSError: as in `run_report`.
    """
    findings = read_findings(context.case, context.results, diagnosed=False)
    words = read_identification(context.result(IDENTIFY))
    head = first_screen_identified(findings, words.reason, words.converged)
    _write(context, findings, head, vectors)
    logger.info(f"  not diagnosed. {final_told(findings)}")


def _write(
    context: StageContext, findings: Findings, head: FirstScreen, vectors: Path | None
) -> None:
    images = {}
    for name, figure in draw(findings):
        images[name] = png(figure)
        (context.workdir / report_figure(name)).write_bytes(images[name])
        if vectors is not None:
            write_vectors(name, figure, vectors)
    if vectors is not None:
        write_measured_vectors(findings.motion, vectors)
    write_csv(context.workdir / REPORT_CSV, final_columns(findings))
    there = {REPORT_CSV, *(name for name in FILES if (context.results / name).is_file())}
    page = report_page(
        findings,
        head,
        view_of_findings(findings),
        images | findings.pictures,
        title_of(context.case),
        written_now(),
        prismid_version(),
        {name: what for name, what in FILES.items() if name in there},
    )
    (context.workdir / REPORT).write_text(page, encoding="utf-8")
    logger.info(
        f"  {REPORT}: {len(images) + len(findings.pictures)} figures, {len(page) / 1e6:.1f} MB"
    )


def title_of(case: Case) -> str:
    """Return the name of a case: its folder, and its file if that has a name of its own."""
    path = case.file.resolve()
    return path.parent.name if path.stem == "case" else f"{path.parent.name}/{path.stem}"


def written_now() -> str:
    """Return the date and the time of day as a page tells them."""
    now = datetime.now().astimezone()
    return f"{now.day} {now:%B %Y, %H:%M}"
