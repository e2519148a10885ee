"""Slip traces on the face against lines drawn by hand, and against their planes."""

from __future__ import annotations

import numpy as np
import pytest

from driver.check.slip_traces import slip_traces
from solver_adapters.crystal import BCC, FCC, SystemTable, bunge_matrix


def test_a_crystal_along_the_axes_has_the_octahedral_traces_at_45_degrees() -> None:
    """(1 1 1) meets (0 0 1) along [1 −1 0]; in tension along [0 1 0] all factors are 1/√6."""
    traces = slip_traces(np.eye(3), FCC)
    assert [trace.plane for trace in traces] == ["(1 1 1)", "(1 −1 1)", "(−1 1 1)", "(−1 −1 1)"]
    for trace, sign in zip(traces, (-1.0, 1.0, 1.0, -1.0), strict=True):
        assert trace.along[0] * trace.along[1] == pytest.approx(0.5 * sign)
        assert trace.schmid == pytest.approx(6**-0.5)


@pytest.mark.parametrize("systems", [BCC, FCC])
@pytest.mark.parametrize("euler", [(281.0, 8.0, 47.0), (211.0, 45.0, 150.0)])
def test_a_trace_lies_in_its_plane_and_the_largest_schmid_factor_comes_first(
    systems: SystemTable,
    euler: tuple[float, float, float],
) -> None:
    rotation = bunge_matrix(*euler)
    traces = slip_traces(rotation, systems)
    factors = [trace.schmid for trace in traces]
    assert factors == sorted(factors, reverse=True) and 0.4 < factors[0] <= 0.5
    for trace in traces:
        normal = np.array([int(n.replace("−", "-")) for n in trace.plane.strip("()").split()])
        assert rotation @ normal @ [*trace.along, 0.0] == pytest.approx(0.0, abs=1e-12)
        assert np.hypot(*trace.along) == pytest.approx(1.0)


def test_a_plane_in_the_face_leaves_no_trace() -> None:
    one = (((0, 0, 1), (0, 1, 0)), ((0, 1, 0), (0, 0, 1)))
    assert [trace.plane for trace in slip_traces(np.eye(3), one)] == ["(0 1 0)"]
