"""What is drawn over the first image: end faces, grains, and slip traces in their direction."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from driver.case.model import Case
from driver.check.picture import draw_grains, draw_slip_traces
from driver.check.slip_traces import slip_traces
from driver.experiment.orientations import orientations_of
from tests.driver.stated_sizes import stated_case


def drawn(case: Case) -> Axes:
    axes = Figure().subplots()
    draw_grains(axes, case)
    draw_slip_traces(axes, case, orientations_of(case))
    return axes


def test_each_grain_has_the_traces_of_two_planes_with_their_schmid_factors() -> None:
    case = stated_case()
    axes, systems = drawn(case), case.material.to_material().slip_systems
    traces = [slip_traces(one, systems)[:2] for one in orientations_of(case)]
    lines = [line for line in axes.lines if line.get_label() != "grain boundary"]
    assert len(lines) == 4
    for line, trace in zip(lines, [one for of_grain in traces for one in of_grain], strict=True):
        along = np.ptp(np.asarray(line.get_xydata()), axis=0)  # Y to the right, X down
        assert along[0] * abs(trace.along[0]) == pytest.approx(along[1] * abs(trace.along[1]))
    texts = [text.get_text() for text in axes.texts]
    for of_grain in traces:
        told = [f"{trace.plane} {trace.schmid:.2f}" for trace in of_grain]
        assert any(all(one in text for one in told) for text in texts)


def test_a_single_crystal_has_its_name_and_its_traces() -> None:
    case = stated_case()
    specimen = case.specimen.model_copy(update={"boundary_point_um": None, "boundary_normal": None})
    single = case.model_copy(update={"grains": case.grains[:1], "specimen": specimen})
    axes = drawn(single)
    assert len(axes.lines) == 2 and axes.texts[2].get_text() == single.grains[0].name


def test_the_end_faces_have_the_names_of_their_groups() -> None:
    texts = {text.get_text().strip(): text.get_position()[0] for text in drawn(stated_case()).texts}
    assert texts["S_MINUS"] == 0.0 and texts["S_PLUS"] == stated_case().specimen.length
