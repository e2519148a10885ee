from __future__ import annotations

import numpy as np
import pytest
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from driver.report.slip import (
    SHOWN,
    grain_slips,
    measured_told,
    schmid_factors,
    slip_section,
)
from driver.report.slip_figures import activity, in_triangle, loading_axes, stereographic
from meshes.arrays import FloatArray
from solver_adapters.crystal import BCC, FCC, N_110, system_name
from tests.driver.invented_results import Results


def unit(axis: ArrayLike) -> FloatArray:
    return np.asarray(np.array(axis, dtype=np.float64) / np.linalg.norm(axis))


def ends(line: Line2D) -> FloatArray:
    return np.asarray(line.get_xydata(), dtype=np.float64)


@pytest.mark.parametrize(
    ("axis", "of_110", "of_112"),
    [
        # By hand: along 010 cos λ = 1/√3, cos φ = 1/√2 and 2/√6; along 111 cos λ = 1/3,
        # cos φ = √2/√3 and 4/√18.
        ((0, 1, 0), 1 / np.sqrt(6), np.sqrt(2) / 3),
        ((1, 1, 1), np.sqrt(2 / 3) / 3, 4 / np.sqrt(18) / 3),
    ],
)
def test_schmid_factors_are_those_of_cos_phi_cos_lambda(
    axis: tuple[int, int, int], of_110: float, of_112: float
) -> None:
    factors = schmid_factors(unit(axis), BCC)
    assert factors[:N_110].max() == pytest.approx(of_110)
    assert factors[N_110:].max() == pytest.approx(of_112)


def test_axes_fall_into_the_triangle_at_the_places_of_its_corners() -> None:
    # 45° from 001 to 011, arccos 1/√3 to 111: the tangents of their halves are the distances.
    assert stereographic(in_triangle(unit((0, -1, 0)))) == pytest.approx([0.0, 0.0])
    assert stereographic(in_triangle(unit((1, 0, -1)))) == pytest.approx([np.tan(np.pi / 8), 0.0])
    corner = stereographic(in_triangle(unit((1, -1, 1))))
    assert np.hypot(*corner) == pytest.approx(np.tan(np.arccos(1 / np.sqrt(3)) / 2))
    assert corner[0] == corner[1]
    for axis in np.random.default_rng(0).standard_normal((200, 3)):
        inside = in_triangle(unit(axis))
        # Right of the diagonal, below the arc from 011 to 111.
        assert inside[2] >= inside[0] >= inside[1] >= 0.0
        # Of the 48 equivalents each has the same Schmid factor.
        assert schmid_factors(inside, BCC).max() == pytest.approx(
            schmid_factors(unit(axis), BCC).max()
        )


def test_the_systems_of_fcc_have_the_schmid_factors_of_those_of_110_in_bcc() -> None:
    """Planes and directions change places."""
    for axis in np.random.default_rng(1).standard_normal((20, 3)):
        fcc = np.sort(schmid_factors(unit(axis), FCC))
        assert fcc == pytest.approx(np.sort(schmid_factors(unit(axis), BCC)[:N_110]))


def test_a_system_is_called_by_plane_and_direction() -> None:
    assert system_name(FCC, 0) == "(1 1 1) [−1 0 1]"
    assert system_name(BCC, 0) == "(0 1 1) [1 1 −1]" and system_name(BCC, 23) == "(1 1 −2) [1 1 1]"


def test_systems_stand_in_the_order_of_their_slip(written: Results) -> None:
    first, second = grain_slips(written.findings())
    assert first.order[:3] == [23, 22, 21] and second.order[:3] == [0, 1, 2]
    section = slip_section(written.findings())
    assert len(section["grains"][1]["rows"]) == SHOWN
    assert "(1 1 −2) [1 1 1] most, 2.40 %" in section["activity_alternative"]


def test_systems_measured_to_slip_stand_below_those_of_the_model_with_their_uncertainty(
    written: Results,
) -> None:
    first, second = (grain["rows"] for grain in slip_section(written.findings())["grains"])
    assert len(first) == SHOWN + 1 and len(second) == SHOWN
    assert first[0]["measured"] == "1.20 ± 0.20 %" and first[0]["without"] == "no other"
    assert first[1]["measured"] == "0 %" and first[1]["without"] == "–"
    assert first[-1]["system"] == "(1 −1 0) [1 1 −1]"
    assert first[-1]["measured"] == "0.50 ± 0.10 %" and first[-1]["without"] == "+8.0 %"
    assert {row["measured"] for row in second} == {"–"}


def test_a_sentence_tells_the_sum_of_measured_slips_and_whether_it_is_noise(
    written: Results,
) -> None:
    findings = written.findings()
    measured = findings.measured_slip
    assert measured is not None
    assert measured_told(0, measured) == (
        f"Measured at image {measured.image}: the slips add up to (1.7 ± 0.3) %, more than noise "
        "alone makes (0.60 % at most, in 95 of 100 measurements); mean strain on the face ε_XX = "
        "(−0.40 ± 0.10) %, ε_YY = (0.80 ± 0.05) %, 2 ε_XY = (0.10 ± 0.20) %, 0.030 % of ε_YY "
        "elastic."
    )
    measured.total[0] = 0.004, 0.003, 0.006
    assert "(0.4 ± 0.3) %, which may be noise alone" in measured_told(0, measured)
    assert measured_told(1, measured).startswith("No slip is measured")


def test_the_activity_has_a_line_a_system_and_one_of_the_rest(written: Results) -> None:
    slip = written.findings().slip
    assert slip is not None
    left, right = activity(slip.images, grain_slips(written.findings())).axes
    assert ends(left.get_lines()[0])[-1, 1] == pytest.approx(2.4)
    # 1 + 2 + … + 19 per mille.
    assert ends(left.get_lines()[-1])[-1, 1] == pytest.approx(19.0)
    assert len(right.get_lines()) == SHOWN + 1


def test_the_loading_axis_of_each_grain_is_a_dot_in_the_triangle(written: Results) -> None:
    grains = grain_slips(written.findings())
    axes = loading_axes(grains).axes[0]
    dots = [line for line in axes.get_lines() if line.get_marker() == "o"]
    for dot, grain in zip(dots, grains, strict=True):
        x, y, z = sorted(np.abs(grain.axis))
        assert ends(dot)[0] == pytest.approx([y / (1 + z), x / (1 + z)])
