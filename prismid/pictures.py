"""The figures of a case, as its report shows them."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from driver.forward.geometry import boundary_traces
from driver.report.all_figures import draw, draw_loads_alone
from driver.report.findings import read_findings
from driver.report.measured import measured_motion
from driver.report.measured_figures import FIGURES
from driver.results.files import IDENTIFY, MEASURE, results_of
from driver.results.hdf5 import read_hdf5
from driver.results.mesh_sizes import sized_case
from driver.workflow.engine import finished
from driver.workflow.pipeline import stages
from prismid.cases import CaseLike, file_of


def figures(case: CaseLike) -> dict[str, Figure]:
    """Draw what the finished stages of a case have found; nothing is shown or written.

    Args:
        case: the case, its file or its folder.

    Returns:
        figures of matplotlib by their names in `results/`, without ending: `measure_reference`,
        `measure_fields`, … after the stage measure, and `report_budget`, `report_loads`, … after
        the stage advise; of a case without images `report_loads` alone.

    Raises:
        InputError: the case cannot be used, the stage measure (of a case without images identify)
            has no results of the case as it is, or a file is damaged.

    Examples:
        >>> import prismid
        >>> drawn = prismid.figures("alpha")
        >>> sorted(drawn)[:3]
        ['measure_fields', 'measure_grip', 'measure_noise']
        >>> [axes.get_xlabel() for axes in drawn["measure_travel"].axes][-1]
        'stage travel [µm]'
    """
    stated = sized_case(file_of(case))
    folder = results_of(stated)
    needed = ("measure",) if stated.with_images else ("identify",)
    done = finished(stated, stages(stated), needed)
    if not stated.with_images:
        return {"report_loads": draw_loads_alone(stated, read_hdf5(folder / IDENTIFY))}
    measured = measured_motion(
        read_hdf5(folder / MEASURE), stated.images.level_um, boundary_traces(stated)
    )
    drawn = {Path(name).stem: picture(measured) for name, picture in FIGURES.items()}
    if "advise" in done:
        drawn |= {f"report_{name}": one for name, one in draw(read_findings(stated, folder))}
    return drawn
