"""Stage 6: the report page and its figures."""

from __future__ import annotations

import logging
from datetime import datetime

from driver.report.all_figures import draw
from driver.report.findings import FILES, read_findings
from driver.report.page import report_page
from driver.report.style import png
from driver.results.files import REPORT, report_figure
from driver.results.hdf5 import prismid_version
from driver.workflow.engine import StageContext

logger = logging.getLogger(__name__)


def run_report(context: StageContext) -> None:
    """Write `report.html`, and its figures as `report_….png`.

    Raises:
        AbsentError, ResultError: a result is absent or damaged.
        HistoryError: the history cannot be used.
    """
    findings = read_findings(context.case, context.results)
    images = {name: png(figure) for name, figure in draw(findings)}
    for name, image in images.items():
        (context.workdir / report_figure(name)).write_bytes(image)
    path, now = context.case.file.resolve(), datetime.now().astimezone()
    page = report_page(
        findings,
        images | findings.pictures,
        path.parent.name if path.stem == "case" else f"{path.parent.name}/{path.stem}",
        f"{now.day} {now:%B %Y, %H:%M}",
        prismid_version(),
        {name: what for name, what in FILES.items() if (context.results / name).is_file()},
    )
    (context.workdir / REPORT).write_text(page, encoding="utf-8")
    logger.info(
        f"  {REPORT}: {len(images) + len(findings.pictures)} figures, {len(page) / 1e6:.1f} MB"
    )
