from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import prismid

N_KNOTS = 6  # after the first


def knots(*micrometres: float) -> dict[str, float]:
    return {f"elongation_{k}": value for k, value in enumerate(micrometres, start=1)}


STILL = knots(*[0.0] * N_KNOTS)


def test_an_elastic_pull_is_that_of_a_stiffness_between_those_of_the_grains(alpha: Path) -> None:
    """Both ends are held across: the stiffness lies above that of bars of these crystals."""
    case = prismid.load_case(alpha)
    pull = 1e-3  # µm, far from slip
    seen = prismid.simulate(case, knots(*[pull] * N_KNOTS))
    strain = pull / case.specimen.length
    bars = [
        prismid.uniaxial_stress(
            case.material.to_material(), rotation, strain * np.arange(2.0), np.array([0.0, 40.0])
        ).stress_along_Y[-1]
        for rotation in prismid.orientations_of(case)
    ]
    stress = float(seen.load_simulated[-1]) / case.section
    assert min(bars) < stress < 1.2 * max(bars)
    # Held across the ends, the face elongates from end to end by what is asked for.
    v = seen.motion.sel(component="v").isel(image=-1)
    ends = [float(v[(seen.Y - y) ** 2 < 1e-12].mean()) for y in (0.0, case.specimen.length)]
    assert ends[1] - ends[0] == pytest.approx(pull, rel=1e-9)
    assert seen.motion.units == "µm" and seen.load_simulated.units == "µN"


def test_points_of_the_face_are_those_that_are_asked_for(alpha: Path) -> None:
    case = prismid.load_case(alpha)
    points = np.array([[0.0, 6.0], [-1.5, 2.0], [1.0, 11.0]])
    pull = knots(*[1e-3] * N_KNOTS)
    at_points, at_nodes = prismid.simulate(case, pull, points), prismid.simulate(case, pull)
    np.testing.assert_array_equal(np.column_stack([at_points.X, at_points.Y]), points)
    np.testing.assert_allclose(at_points.load_simulated, at_nodes.load_simulated)
    # Between those of the nodes around them, to a twentieth of the whole.
    for point in range(3):
        x, y = points[point]
        near = int(np.argmin((at_nodes.X.values - x) ** 2 + (at_nodes.Y.values - y) ** 2))
        off = at_points.motion[-1, point] - at_nodes.motion[-1, near]
        gap = float(np.hypot(at_nodes.X[near] - x, at_nodes.Y[near] - y))
        assert abs(off).max() < 3e-4 * gap + 1e-9


def test_changes_of_a_case_in_memory_count(alpha: Path) -> None:
    case = prismid.load_case(alpha)
    pull = knots(*[1e-3] * N_KNOTS)
    softer = prismid.changed(case, {"material.elastic_scale": 0.5})
    loads = [prismid.simulate(one, pull).load_simulated for one in (case, softer)]
    np.testing.assert_allclose(loads[1], 0.5 * loads[0], rtol=1e-9)


@pytest.mark.parametrize(("arguments", "said"), [
    (({},), r"^values: found no elongation_1, elongation_2, .*until identify` before$"),
    (({**STILL, "tau_0": 1.0},), r'^values: found the name "tau_0", expected tau0 or '),
    (({**STILL, "tau0": -1.0},), r"^values\.tau0: found -1\.0, expected a positive number$"),
    (({**STILL, "tau0": "soft"},), r'^values\.tau0: found "soft", expected a positive number$'),
    ((STILL, np.zeros(3)), r"^points: found the shape \(3,\), expected numbers X, Y"),
    ((STILL, np.array([[0.0, 13.0]])), r"^points: found X = 0, Y = 13 µm, expected points of the"),
])  # fmt: skip
def test_what_cannot_be_simulated_is_told_in_a_sentence(
    alpha: Path, arguments: tuple[Any, ...], said: str
) -> None:
    with pytest.raises(prismid.InputError, match=said):
        prismid.simulate(alpha, *arguments)
