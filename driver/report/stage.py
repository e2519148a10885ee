"""Stage 5: the report page and its figures."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from driver.boundary import LAMBDAS
from driver.report import figures, inference_figures, maps
from driver.report.findings import FILES, Findings, Record, read_findings
from driver.report.page import report_page
from driver.report.style import png
from driver.report.tables import ordered
from driver.report.wording import cause_label, label
from driver.results import prismid_version
from driver.stages import StageContext
from solver_adapters.material import MATERIAL_DECLARATIONS

FloatArray = NDArray[np.float64]

REPORT = "report.html"
_STAGE_NAMES = {
    "A": "A: images",
    "B": "B: law, loads",
    "C": "C: corrected",
}


def run_report(context: StageContext) -> None:
    """Write `report.html`, and its figures as `report_….png`.

    Raises:
        StageError, ResultError: a result is absent or damaged.
        HistoryError: the history cannot be used.
    """
    findings = read_findings(context)
    images = {name: png(figure) for name, figure in draw(findings)}
    for name, image in images.items():
        (context.workdir / f"report_{name}.png").write_bytes(image)
    path, now = context.case_path.resolve(), datetime.now().astimezone()
    page = report_page(
        findings,
        images | findings.pictures,
        path.parent.name if path.stem == "case" else f"{path.parent.name}/{path.stem}",
        f"{now.day} {now:%B %Y, %H:%M}",
        prismid_version(),
        {name: what for name, what in FILES.items() if (context.results / name).is_file()},
    )
    (context.workdir / REPORT).write_text(page, encoding="utf-8")
    context.log(
        f"  {REPORT}: {len(images) + len(findings.pictures)} figures, {len(page) / 1e6:.1f} MB"
    )


def draw(findings: Findings) -> Iterator[tuple[str, Figure]]:
    """All figures with their names, in the order of the page."""
    m, history, sides = findings.measured, findings.history, findings.sides
    budgets = {side: findings.diagnosis["gain"][f"budget_{side}"] for side in sides}
    yield "budget", figures.budget(budgets["before"]["free"], budgets)

    case, mesh, face = findings.case, findings.mesh, findings.motion.face
    names = [grain.name for grain in case.grains]
    yield "specimen", maps.specimen(mesh.points, mesh.cells, mesh.grain, names)

    last = sides[-1]
    yield "motion", figures.motion(
        m["stage"], m["cycle"].astype(np.int64), np.column_stack([m["elongation"], m["tilt"]]),
        np.array([findings.motion.elongation.typical, findings.motion.tilt.typical]),
        history.stage, {side: findings.edges(side) for side in sides}, history.turning,
    )  # fmt: skip
    peaks = findings.peaks
    at_peak = {
        "free correlation": m["motion"][peaks[-1]],
        figures.side_labels(sides)[last]: findings.fitted[f"{last}/motion"][peaks[-1]],
    }
    yield "fields", maps.fields(face, at_peak)
    yield "loads", figures.loads(
        m["stage"], m["time"], m["force"],
        {side: findings.fitted[f"{side}/load"] for side in sides}, findings.load_noise,
    )  # fmt: skip

    residual = {side: findings.residual(side) for side in sides}
    yield "residual_maps", maps.residual_maps(
        face,
        [f"peak of cycle {int(m['cycle'][peak])}" for peak in peaks],
        {side: rho[peaks] for side, rho in residual.items()},
        {side: np.sqrt(np.mean(rho**2, axis=0)) for side, rho in residual.items()},
    )  # fmt: skip
    yield "residual_history", figures.residual_history(
        m["time"], m["chi"],
        {side: np.sqrt(np.mean(rho**2, axis=1)) for side, rho in residual.items()}, peaks,
    )  # fmt: skip
    for index, step in enumerate(findings.diagnosis["steps"], start=1):
        yield f"evidence_{index}", _evidence(step)
    identified = [label(name) for name in findings.names]
    yield "correlation", inference_figures.correlation(identified, findings.correlation)
    yield "convergence", _convergence(findings.iterations)


def _evidence(step: Record) -> Figure:
    causes = ordered(step["causes"])
    refits = [c["refit"]["log_evidence"] if c["refit"] else np.nan for c in causes]
    return inference_figures.evidence(
        [cause_label(cause["cause"]) for cause in causes],
        [cause["category"] for cause in causes],
        np.array([cause["log_evidence"] for cause in causes]),
        np.array(refits),
    )


def _convergence(iterations: Record) -> Figure:
    stages = [name for name in _STAGE_NAMES if name in iterations]
    records = [iterations[name]["iterations"] for name in stages]
    last = records[-1][-1]
    law = [parameter.name for parameter in MATERIAL_DECLARATIONS]
    names = [name for name in (*law, *LAMBDAS) if last.get(name, 0.0) != 0.0]

    def column(name: str, scale: float) -> list[FloatArray]:
        return [np.array([r.get(name, np.nan) / scale for r in record]) for record in records]

    loads = [np.where(chi > 0, chi, np.nan) for chi in column("chi_load", 1.0)]
    return inference_figures.convergence(
        column("chi_image", 1.0), loads, [_STAGE_NAMES[name] for name in stages],
        {label(name): column(name, last[name]) for name in names},
    )  # fmt: skip
