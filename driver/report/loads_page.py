"""The report page of a case without images: its law, its loads, and what the loads left open."""

from __future__ import annotations

import json

import h5py
import numpy as np
from numpy.typing import NDArray

from driver.case import Case
from driver.identification.loads_alone import doubts
from driver.identify_stage import IDENTIFY
from driver.report import figures
from driver.report.style import data_uri, png
from driver.report.wording import chi, label, number, reading_unit, with_sigma
from driver.results import prismid_version, read_hdf5
from driver.stages import StageContext
from templates import render

FloatArray = NDArray[np.float64]

REPORT = "report.html"


def run_report_loads(context: StageContext) -> None:
    """Write `report.html`, and its figure as `report_loads.png`.

    Raises:
        StageError, ResultError: a result is absent or damaged.
    """
    found, case = read_hdf5(context.result(IDENTIFY)), context.case
    with h5py.File(context.result(IDENTIFY), "r") as file:
        names, units = json.loads(file.attrs["names"]), json.loads(file.attrs["units"])
        reason, converged = str(file.attrs["reason"]), bool(file.attrs["converged"])
    picture = png(
        figures.loads(
            found["stage"], found["time"], found["force"], {"before": found["final/load"]},
            case.loads.gamma_F, found["initial/load"],
        )
    )  # fmt: skip
    (context.workdir / "report_loads.png").write_bytes(picture)
    rest = found["final/load_residual"]
    page = render(
        "report_loads.html.j2",
        title=context.case_path.resolve().parent.name,
        version=prismid_version(),
        n_loads=len(found["force"]),
        chi=chi(float(found["budget/load"])),
        rms=number(float(np.sqrt(np.mean(rest**2))), 2),
        noise=number(case.loads.gamma_F),
        ratio=_ratio(case),
        reason=reason,
        doubts=doubts(float(found["budget/load"]), len(found["force"]), converged),
        rows=[_row(k, *both, found) for k, both in enumerate(zip(names, units, strict=True))],
        picture=data_uri(picture),
    )
    (context.workdir / REPORT).write_text(page, encoding="utf-8")


def _ratio(case: Case) -> str:
    ratio, sigma = case.boundary.stage_ratio, case.boundary.stage_ratio_uncertainty
    assert ratio is not None and sigma is not None  # the case refuses itself without them
    return f"({with_sigma(1e4 * ratio, 1e4 * sigma)})·10⁻⁴"


def _row(k: int, name: str, unit: str, found: dict[str, FloatArray]) -> dict[str, str]:
    factor, shown = reading_unit(name, unit)
    value, sigma, start = (factor * float(found[key][k]) for key in ("values", "sigma", "start"))
    share = float(found["prior_share"][k])
    return {
        "label": label(name),
        "name": name,
        "unit": shown,
        "start": number(start, 4),
        "value": with_sigma(value, sigma),
        "left": f"{number(100 * share, 2)} %" if share else "no prior",
    }
