"""All figures of the report, in the order of its page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from driver.case.model import Case
from driver.experiment.reading import fitted_loads
from driver.parameters.boundary import LAMBDAS
from driver.parameters.registry import label_of, short_label_of
from driver.report import (
    evidence_figures,
    figures,
    history_figures,
    maps,
    matrix_figures,
    slip_figures,
    stress_figure,
)
from driver.report.findings import Findings, Record
from driver.report.identified_tables import core
from driver.report.labels import cause_label, reading_unit
from driver.report.slip import grain_slips
from driver.report.style import literal
from driver.report.tables import less_corrected, ordered
from meshes.arrays import FloatArray

_STAGE_NAMES = {
    "A": "A: images",
    "B": "B: law, loads",
    "C": "C: all, corrected",
}


def draw(findings: Findings) -> Iterator[tuple[str, Figure]]:
    """All figures with their names, in the order of the page."""
    m, history, sides = findings.measured, findings.history, findings.sides
    budgets = findings.budgets
    yield "budget", figures.budget(budgets["before"]["free"], budgets)

    case, mesh, face = findings.case, findings.mesh, findings.motion.face
    loads = fitted_loads(case, m["force"])
    names = [literal(grain.name) for grain in case.grains]
    yield "specimen", maps.specimen(mesh.points, mesh.cells, mesh.grain, names)

    slips = grain_slips(findings)
    yield "loading_axes", slip_figures.loading_axes(slips)
    if findings.slip is not None:
        yield "slip", slip_figures.activity(findings.slip.images, slips)

    last = sides[-1]
    yield "motion", figures.motion(
        m["stage"], m["cycle"].astype(np.int64), np.column_stack([m["elongation"], m["tilt"]]),
        np.array([findings.motion.elongation.typical, findings.motion.tilt.typical]),
        history.stage, {side: findings.edges(side) for side in sides}, history.turning,
    )  # fmt: skip
    peaks = findings.peaks
    at_peak = {
        "free correlation": m["motion"][peaks[-1]],
        figures.side_labels(sides)[last]: findings.predicted[f"{last}/motion"][peaks[-1]],
    }
    yield "fields", maps.fields(face, at_peak)
    yield "loads", figures.loads(
        m["stage"], m["time"], loads,
        {side: findings.predicted[f"{side}/load"] for side in sides}, findings.load_noise,
        findings.identified["initial/load"],
    )  # fmt: skip

    residual = {side: findings.residual(side) for side in sides}
    yield "residual_maps", maps.residual_maps(
        face,
        [f"peak of cycle {int(m['cycle'][peak])}" for peak in peaks],
        {side: rho[peaks] for side, rho in residual.items()},
        {side: np.sqrt(np.mean(rho**2, axis=0)) for side, rho in residual.items()},
    )  # fmt: skip
    of_images = {side: np.sqrt(np.mean(rho**2, axis=1)) for side, rho in residual.items()}
    yield "residual_over_strain", figures.residual_over_strain(
        findings.edges(last)[history.image_row, 0] / case.specimen.length,
        m["cycle"].astype(np.int64),
        {
            side: (loads - findings.predicted[f"{side}/load"]) / findings.load_noise
            for side in sides
        },
        of_images,
    )  # fmt: skip
    yield "residual_history", figures.residual_history(
        m["time"], m["chi"], of_images, peaks,
    )  # fmt: skip
    for index, step in enumerate(findings.diagnosis.get("steps", ()), start=1):
        yield f"evidence_{index}", _evidence(step)
    if stress := findings.diagnosis.get("critical_stress"):
        yield "critical_stress", stress_figure.critical_stress(stress, names)
    yield from _matrices(findings)
    yield "convergence", _convergence(findings)


def draw_loads_alone(case: Case, identified: Mapping[str, FloatArray]) -> Figure:
    """Measured and predicted loads of an identification without images.

    Args:
        case: the case.
        identified: datasets of `identify.h5`.
    """
    return figures.loads(
        identified["stage"], identified["time"], fitted_loads(case, identified["force"]),
        {"before": identified["final/load"]}, case.loads.gamma_F, identified["initial/load"],
    )  # fmt: skip


def _matrices(findings: Findings) -> Iterator[tuple[str, Figure]]:
    """Kinematic Hessian and correlation of the few that count, and correlation of all."""
    names, matrix = tuple(findings.estimates), findings.identified["correlation"]

    def part(wanted: Sequence[str]) -> FloatArray:
        rows = [names.index(name) for name in wanted]
        return matrix[np.ix_(rows, rows)]

    few = core(names)
    yield (
        "sensitivity",
        matrix_figures.hessian_and_correlation(
            [short_label_of(name) for name in findings.hessian_names],
            findings.identified["kinematic_hessian"],
            [short_label_of(name) for name in few],
            part(few),
        ),
    )
    every = [*few, *(name for name in names if name not in few)]
    yield (
        "correlation",
        matrix_figures.correlation_of_all([short_label_of(name) for name in every], part(every)),
    )


def _evidence(step: Record) -> Figure:
    causes = ordered(step["causes"])
    refits = [c["refit"]["log_evidence"] if c["refit"] else np.nan for c in causes]
    winner = next((k for k, c in enumerate(causes) if c["cause"] in step["named"][:1]), None)
    return evidence_figures.evidence(
        [cause_label(cause["cause"]) for cause in causes],
        [cause["category"] for cause in causes],
        np.array([cause["log_evidence"] for cause in causes]),
        np.array(refits),
        winner,
        [] if winner is None else less_corrected(causes, causes[winner]),
    )


def _convergence(findings: Findings) -> Figure:
    stages = [name for name in _STAGE_NAMES if name in findings.iterations]
    records = [findings.iterations[name]["iterations"] for name in stages]

    def column(name: str, factor: float = 1.0) -> list[FloatArray]:
        return [np.array([factor * r.get(name, np.nan) for r in record]) for record in records]

    def course(name: str) -> history_figures.Course:
        estimate = findings.estimates[name]
        factor, unit = reading_unit(name, estimate.parameter.unit)
        return history_figures.Course(
            label_of(name), unit, column(name, factor), factor * estimate.sigma
        )

    # Where loads are not fitted there is no χ_F.
    fitted_loads_only = [np.where(part > 0.0, part, np.nan) for part in column("chi_load")]
    few = core(tuple(findings.estimates))
    return history_figures.convergence(
        [_STAGE_NAMES[name] for name in stages],
        {
            "χ_F of loads": fitted_loads_only,
            "χ of images, mesh": column("chi_image"),
            "χ_f of images": column("paper_chi_f"),
        },
        [course(name) for name in few if name in LAMBDAS],
        # What starts at zero has no relative course.
        [course(name) for name in few if name not in LAMBDAS and findings.start_of(name)],
    )
