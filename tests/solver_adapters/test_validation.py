"""Each bad input is refused in one sentence; the figures follow from boxes of 12 cells."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from meshes.prism_mesh import PrismMesh
from solver_adapters.interface import (
    BadSimulationError,
    Direction,
    FloatArray,
    Simulation,
    UnsupportedError,
)
from solver_adapters.material import MATERIAL_PARAMETERS, Material
from solver_adapters.validation import _RULES, refuse_bad_simulation
from tests.solver_adapters.boxes import BOXES, ORIENTATIONS, box, moved, pulled, skin

GOOD = pulled(box(), Material(), (0.002, 0.004))
MESH = GOOD.mesh
N = len(MESH.points)
S_PLUS = MESH.nodes["S_PLUS"]
NAN, INF = float("nan"), float("inf")


def with_value(array: Any, index: Any, value: Any) -> Any:
    changed = np.array(array)
    changed[index] = value
    return changed


def of_mesh(**changes: Any) -> Simulation:
    return replace(GOOD, mesh=replace(MESH, **changes))


def of_material(**changes: Any) -> Simulation:
    return replace(GOOD, material=replace(Material(), **changes))


def along(**changes: Any) -> Simulation:
    return replace(GOOD, directions=(Direction("a", **changes),))


def held(holds: Callable[[FloatArray], Any]) -> Simulation:
    """The good simulation with a mask that is made from the positions of the moved nodes."""
    mask = np.zeros(GOOD.motion_mask.shape, dtype=np.bool_)
    mask[:] = holds(MESH.points[GOOD.motion_nodes])
    return replace(GOOD, motion_mask=mask)


def at(points: FloatArray, *place: float) -> Any:
    return (points == np.array(place)).all(axis=1, keepdims=True)


def twice(mesh: PrismMesh) -> PrismMesh:
    """The mesh and, far away, a copy of it."""
    return replace(
        mesh,
        points=np.concatenate([mesh.points, mesh.points + [50.0, 0.0, 0.0]]),
        cells=np.concatenate([mesh.cells, mesh.cells + N]),
        grain=np.tile(mesh.grain, 2),
    )


ALL_MODES = (
    "translation along X and translation along Y and translation along Z "
    "and rotation about X and rotation about Y and rotation about Z"
)
FREE = "the prescribed motion leaves the specimen free in {}; expected motion_mask to hold all"
DIRECTION = Direction("a")

UNSUPPORTED: list[tuple[Simulation, str]] = [
    (of_mesh(cells=MESH.cells[:, :4]), "mesh.cells has shape (12, 4); expected (n, 10) for tet10"),
    (of_mesh(cells=MESH.cells[:0]), "mesh.cells has shape (0, 10); expected (n, 10) for tet10"),
    (of_material(tau0=0.0), "tau0 is 0; expected a positive number"),
    (of_material(C44=-1.0), "C44 is -1; expected a positive number"),
    (of_material(C44_scale=0.0), "C44_scale is 0; expected a positive number"),
    (of_material(elastic_scale=-2.0), "elastic_scale is -2; expected a positive number"),
    (of_material(K=NAN), "K is nan; expected a positive number"),
    (of_material(C11=NAN), "C11 is nan; expected a finite number"),
    (of_material(n=0.5), "n is 0.5; expected one or more"),
    (of_material(d=-1.0), "d is -1; expected zero or more"),
    (of_material(c2=-3.0), "c2 is -3; expected zero or more"),
    (of_material(d2=-4.0), "d2 is -4; expected zero or more"),
    (of_material(x0=-1e-3), "x0 is -0.001; expected less than 1/d in size"),
    (of_material(a1=INF), "a1 is inf; expected a finite number"),
    (of_material(eigenstrain=NAN), "eigenstrain is nan; expected a finite number"),
    (of_material(tau0_antitwinning=0.0), "tau0_antitwinning is 0; expected a positive number"),
    (of_material(skin_tau0=0.0), "skin_tau0 is 0; expected a positive number"),
    (of_material(skin_thickness=0.0), "skin_thickness is 0; expected a positive number"),
    (of_material(tau0_grains=(1.0, -1.0)), "tau0_grains holds -1; expected positive numbers"),
    (
        of_material(interaction=((1.0, 2.0),) * 3),
        "interaction has 3 rows of [2] numbers; expected 24 rows of 24",
    ),
    (
        of_material(interaction=((NAN,) * 24,) * 24),
        "interaction holds a number that is not finite; expected 24 × 24 finite numbers",
    ),
    (
        of_material(interaction=((1.0,) * 23 + (-1.5,),) * 24),
        "interaction holds -1.5; expected -1 or more",
    ),
    (of_material(h_latent=-1.1), "h_latent is -1.1; expected -1 or more"),
    (
        of_material(C11=100e3, C12=120e3),
        "C11 = 100000, C12 = 120000 MPa do not make a positive definite stiffness; expected C11 >",
    ),
    (
        of_material(C11=100e3, C12=-60e3),
        "C11 = 100000, C12 = -60000 MPa do not make a positive definite stiffness; expected C11 >",
    ),
    (
        of_material(strain_measure="log"),
        "strain_measure is 'log'; expected 'small' or 'finite'",
    ),
    (
        replace(GOOD, integration="midpoint"),  # type: ignore[arg-type]
        "integration is 'midpoint'; expected 'backward_euler' or 'exponential'",
    ),
    (
        along(material={"tau1": 1.0}),
        "direction 'a' changes 'tau1', which the material does not have; expected one of C11",
    ),
]

BROKEN: list[tuple[Simulation, str]] = [
    (
        of_mesh(nodes={**MESH.nodes, "S_PLUS": np.append(S_PLUS, S_PLUS[2])}),
        f"the group S_PLUS of mesh.nodes holds node {S_PLUS[2]} twice; expected each node once",
    ),
    (
        of_mesh(nodes={**MESH.nodes, "S_PLUS": S_PLUS.tolist()}),
        "mesh.nodes['S_PLUS'] is a list; expected an array",
    ),
    (
        of_mesh(points=MESH.points[:, :2]),
        f"mesh.points has shape ({N}, 2); expected (n, 3)",
    ),
    (
        of_mesh(points=with_value(MESH.points, (3, 1), NAN)),
        "mesh.points holds 1 values that are not finite; expected finite numbers",
    ),
    (
        of_mesh(cells=with_value(MESH.cells, (2, 3), N)),
        f"mesh.cells holds {N}, but there are {N} nodes; expected 0 to {N - 1}",
    ),
    (
        of_mesh(cells=with_value(MESH.cells, (2, 3), -1)),
        f"mesh.cells holds -1, but there are {N} nodes; expected 0 to {N - 1}",
    ),
    (of_mesh(cells=MESH.cells * 1.0), "mesh.cells holds float64; expected integers"),
    (
        of_mesh(
            cells=with_value(
                MESH.cells, slice(7, 9), MESH.cells[7:9][:, [0, 2, 1, 3, 6, 5, 4, 7, 9, 8]]
            )
        ),
        "2 of 12 cells are inverted, the first is cell 7 in grain 2; expected positive Jacobians",
    ),
    (of_mesh(grain=MESH.grain[:5]), "mesh.grain has shape (5,); expected (12,)"),
    (of_mesh(grain=MESH.grain * 1.0), "mesh.grain holds float64; expected integers"),
    (
        of_mesh(grain=with_value(MESH.grain, slice(4, 7), -1)),
        "3 of 12 cells have no grain, the first is cell 4 with grain -1; expected a grain index",
    ),
    (
        of_mesh(grain=2 * MESH.grain),
        "grain index 1 has no cell though the largest is 2; expected grain indices without a hole",
    ),
    (
        of_mesh(nodes={"S_MINUS": MESH.nodes["S_MINUS"]}),
        "mesh.nodes has no group S_PLUS (it has S_MINUS); expected S_PLUS and S_MINUS",
    ),
    (
        of_mesh(nodes={"S_PLUS": MESH.nodes["S_PLUS"]}),
        "mesh.nodes has no group S_MINUS (it has S_PLUS); expected S_PLUS and S_MINUS",
    ),
    (
        of_mesh(nodes={}),
        "mesh.nodes has no group S_PLUS (it has none); expected S_PLUS and S_MINUS",
    ),
    (
        of_mesh(nodes={**MESH.nodes, "S_MINUS": np.zeros(0, dtype=np.int64)}),
        "the group S_MINUS of mesh.nodes is empty; expected one node or more",
    ),
    (
        of_mesh(nodes={**MESH.nodes, "S_PLUS": np.array([N])}),
        f"mesh.nodes['S_PLUS'] holds {N}, but there are {N} nodes; expected 0 to {N - 1}",
    ),
    (
        of_mesh(points=np.concatenate([MESH.points, np.ones((2, 3))])),
        f"2 of {N + 2} nodes belong to no cell, the first is node {N}; expected every node in a",
    ),
    (
        replace(GOOD, mesh=twice(MESH)),
        "the mesh falls into 2 pieces that share no node, of 12, 12 cells; expected one connected",
    ),
    (
        replace(GOOD, orientations=np.eye(3)),
        "orientations has shape (3, 3); expected (2, 3, 3)",
    ),
    (
        replace(GOOD, orientations=ORIENTATIONS[:1]),
        "there are 1 orientations for 2 grains; expected one for each grain",
    ),
    (
        replace(GOOD, orientations=with_value(ORIENTATIONS, (1, 0, 0), NAN)),
        "orientations holds 1 values that are not finite; expected finite numbers",
    ),
    (
        replace(GOOD, orientations=ORIENTATIONS * [[[1.0]], [[2.0]]]),
        "the orientation of grain 2 is no rotation (RᵀR is 3 off the identity); expected an ortho",
    ),
    (
        replace(GOOD, orientations=ORIENTATIONS * [[[1.0]], [[-1.0]]]),
        "the orientation of grain 2 is a reflection, left-handed (determinant -1); expected a",
    ),
    (
        replace(GOOD, lattice_gradient=np.zeros((1, 3))),
        "lattice_gradient has shape (1, 3); expected (2, 3)",
    ),
    (
        replace(GOOD, lattice_gradient=np.full((2, 3), INF)),
        "lattice_gradient holds 6 values that are not finite; expected finite numbers",
    ),
    (
        replace(GOOD, times=GOOD.times[:1]),
        "times has shape (1,); expected two instants or more in a row",
    ),
    (
        replace(GOOD, times=np.array([0.0, NAN, 2.0])),
        "times holds 1 values that are not finite; expected finite numbers",
    ),
    (
        replace(GOOD, times=np.array([0.0, 1.0, 1.0])),
        "times goes from 1 to 1 at place 2; expected increasing values",
    ),
    *[
        (
            replace(GOOD, steps_per_interval=value),  # type: ignore[arg-type]
            f"steps_per_interval is {value!r}; expected a whole number, 1 or more",
        )
        for value in (0, 2.0, True, "two")
    ],
    (of_material(tau0="40"), "tau0 is '40'; expected a number"),
    (of_material(Q=None), "Q is None; expected a number"),
    (of_material(tau0_grains=1.0), "tau0_grains is 1.0; expected a tuple of numbers"),
    (of_material(tau0_grains=("1",)), "tau0_grains is '1'; expected a number"),
    (
        of_material(tau0_grains=(1.1,)),
        "tau0_grains has 1 ratios for 2 grains; expected at most 0, those of the third and later",
    ),
    (replace(GOOD, tolerance="1e-7"), "tolerance is '1e-7'; expected a number"),  # type: ignore[arg-type]
    (replace(GOOD, accuracy="1"), "accuracy is '1'; expected a number"),  # type: ignore[arg-type]
    *[
        (replace(GOOD, **{name: list(getattr(GOOD, name))}), f"{name} is a list; expected an array")
        for name in (
            "orientations",
            "times",
            "motion_nodes",
            "motion_mask",
            "motion",
            "output",
            "output_nodes",
        )
    ],  # fmt: skip
    (replace(GOOD, steps=[1.0, 2.0]), "steps is a list; expected an array"),  # type: ignore[arg-type]
    (
        replace(GOOD, times=np.array(["0", "1", "2"])),
        "times holds <U1; expected real numbers",
    ),
    (of_mesh(points=MESH.points.tolist()), "mesh.points is a list; expected an array"),
    (of_mesh(cells=MESH.cells.tolist()), "mesh.cells is a list; expected an array"),
    (along(motion=3.0), "motion of direction 'a' is a float; expected an array"),
    *[
        (
            replace(GOOD, tolerance=value),
            f"tolerance is {value:g}; expected more than 0 and at most 0.01",
        )
        for value in (0.0, 0.02, NAN)
    ],
    (replace(GOOD, accuracy=0.0), "accuracy is 0 µN; expected a positive number or None"),
    (
        replace(GOOD, steps=np.array([1.0, 0.5, 2.0])),
        "steps goes from 1 to 0.5 at place 1; expected increasing values",
    ),
    (
        replace(GOOD, steps=np.array([0.5, 2.0])),
        "steps pass over 1 of 2 instants, the first is 1 s; expected a step that ends at every",
    ),
    (replace(GOOD, steps=np.ones((2, 2))), "steps has shape (2, 2); expected (n,)"),
    (
        replace(GOOD, steps=np.array([1.0, INF])),
        "steps holds 1 values that are not finite; expected finite numbers",
    ),
    (
        replace(GOOD, motion_nodes=GOOD.motion_nodes[:, None]),
        "motion_nodes has shape (18, 1); expected (n,)",
    ),
    (
        replace(GOOD, motion_nodes=with_value(GOOD.motion_nodes, 0, N)),
        f"motion_nodes holds {N}, but there are {N} nodes; expected 0 to {N - 1}",
    ),
    (
        replace(GOOD, motion_nodes=with_value(GOOD.motion_nodes, 1, GOOD.motion_nodes[0])),
        f"1 nodes are prescribed twice in motion_nodes, the first is node {GOOD.motion_nodes[0]}",
    ),
    (
        replace(GOOD, motion_mask=GOOD.motion_mask[:5]),
        "motion_mask has shape (5, 3); expected (18, 3)",
    ),
    (
        replace(GOOD, motion_mask=GOOD.motion_mask * 1.0),  # type: ignore[arg-type]
        "motion_mask holds float64; expected true or false",
    ),
    (
        replace(GOOD, motion=GOOD.motion[:2]),
        "motion has shape (2, 18, 3); expected (3, 18, 3)",
    ),
    (
        replace(GOOD, motion=with_value(GOOD.motion, (1, 4), NAN)),
        "motion holds 3 values that are not finite; expected finite numbers",
    ),
    (
        replace(GOOD, motion=GOOD.motion + 0.25),
        "motion is 0.25 µm at the first instant, where the specimen is at rest; expected zero",
    ),
    (held(lambda points: False), FREE.format(ALL_MODES)),
    (
        held(lambda points: [True, True, False]),
        FREE.format("translation along Z"),
    ),
    (
        held(lambda points: [False, True, False]),
        FREE.format("translation along X and translation along Z and rotation about Y"),
    ),
    (
        held(lambda points: at(points, 0, 0, 0)),
        FREE.format("rotation about X and rotation about Y and rotation about Z"),
    ),
    (
        held(lambda points: at(points, 0, 0, 0) | at(points, 0, 4, 0)),
        FREE.format("rotation about Y"),
    ),
    (
        held(lambda points: at(points, 0, 0, 0) | at(points, 2, 4, 0)),
        FREE.format("a rigid motion"),
    ),
    (
        replace(GOOD, output=np.array([0, 3])),
        "output holds 3, but there are 3 instants; expected 0 to 2",
    ),
    (
        replace(GOOD, output=np.array([2, 1])),
        "output goes from 2 to 1 at place 1; expected increasing values",
    ),
    (
        replace(GOOD, output_nodes=np.array([-1])),
        f"output_nodes holds -1, but there are {N} nodes; expected 0 to {N - 1}",
    ),
    (replace(GOOD, output=np.zeros((1, 1), dtype=int)), "output has shape (1, 1); expected (n,)"),
    (
        replace(GOOD, output_nodes=np.zeros((1, 1), dtype=int)),
        "output_nodes has shape (1, 1); expected (n,)",
    ),
    (
        replace(GOOD, directions=(DIRECTION, DIRECTION)),
        "two directions have the name 'a'; expected different names",
    ),
    (
        along(material={"tau0": NAN}),
        "direction 'a' changes tau0 by nan; expected a finite number",
    ),
    (
        along(material={"tau0": None}),
        "the change of tau0 in direction 'a' is None; expected a number",
    ),
    (
        along(material={"tau0": "a"}),
        "the change of tau0 in direction 'a' is 'a'; expected a number",
    ),
    (
        along(material={"tau0": 1j}),
        "the change of tau0 in direction 'a' is 1j; expected a number",
    ),
    (
        along(material=["tau0"]),
        "material of direction 'a' is ['tau0']; expected numbers by the names of parameters",
    ),
    (along(scale="a"), "scale of direction 'a' is 'a'; expected a number"),
    (along(scale=None), "scale of direction 'a' is None; expected a number"),
    (
        replace(GOOD, directions=(Direction(["a"]),)),  # type: ignore[arg-type]
        "a direction has the name ['a']; expected text",
    ),
    (of_material(interaction=5), "interaction is 5; expected 24 rows of 24 numbers"),
    (
        of_material(interaction=(5,) * 24),
        f"interaction is {(5,) * 24}; expected 24 rows of 24 numbers",
    ),
    (
        of_material(interaction=(("a",) * 24,) * 24),
        "a number of interaction is 'a'; expected a number",
    ),
    (
        of_material(interaction=((None,) * 24,) * 24),
        "a number of interaction is None; expected a number",
    ),
    (along(scale=0.0), "scale of direction 'a' is 0; expected a positive number"),
    (
        along(rotation=np.zeros((1, 3))),
        "rotation of direction 'a' has shape (1, 3); expected (2, 3)",
    ),
    (
        along(lattice_gradient=np.zeros(2)),
        "lattice_gradient of direction 'a' has shape (2,); expected (2, 3)",
    ),
    (
        along(motion=np.zeros((3, 1, 3))),
        "motion of direction 'a' has shape (3, 1, 3); expected (3, 18, 3)",
    ),
    (
        along(points=np.zeros((1, 3))),
        f"points of direction 'a' has shape (1, 3); expected ({N}, 3)",
    ),
    (
        along(points=np.full((N, 3), NAN)),
        f"points of direction 'a' holds {3 * N} values that are not finite; expected finite",
    ),
]


@pytest.mark.parametrize(
    ("simulation", "sentence"), UNSUPPORTED, ids=[sentence for _, sentence in UNSUPPORTED]
)
def test_what_no_solver_can_honour_is_unsupported(simulation: Simulation, sentence: str) -> None:
    with pytest.raises(UnsupportedError, match=f"^{re.escape(sentence)}") as error:
        refuse_bad_simulation(simulation)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("simulation", "sentence"), BROKEN, ids=[s for _, s in BROKEN])
def test_broken_input_is_named_in_one_sentence(simulation: Simulation, sentence: str) -> None:
    with pytest.raises(BadSimulationError, match=f"^{re.escape(sentence)}") as error:
        refuse_bad_simulation(simulation)
    assert "\n" not in str(error.value)


# Along ⟨001⟩ and ⟨111⟩: 1/E is S11 and (1/3)/(C11 + 2 C12) + 1/(3 C44); the largest Schmid factors
# are √2/3 and √8/9 on {112}, 1/√6 and √(2/27) on {110}.
M = Material()
S11 = (M.C11 + M.C12) / ((M.C11 - M.C12) * (M.C11 + 2 * M.C12))
E111 = 3 / (1 / (M.C11 + 2 * M.C12) + 1 / M.C44)
CUBE = np.eye(3)
ACROSS = np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
DIAGONAL = np.stack([ACROSS, np.ones(3) / np.sqrt(3), np.cross(ACROSS, np.ones(3) / np.sqrt(3))])


@pytest.mark.parametrize("make", BOXES.values(), ids=BOXES)
@pytest.mark.parametrize(
    ("changes", "grain", "stress"),
    [
        ({}, 2, 40 / (np.sqrt(8) / 9)),
        ({"tau0": 20.0}, 2, 20 / (np.sqrt(8) / 9)),
        ({"tau0_grain2": 2.0}, 1, 40 / (np.sqrt(2) / 3)),
        ({"tau0_grain2": 2.0, "tau0_112": 1.3}, 1, 40 * np.sqrt(6)),
    ],
)
def test_an_eigenstrain_may_stress_a_specimen_up_to_its_yield(
    make: Callable[[], PrismMesh], changes: dict[str, float], grain: int, stress: float
) -> None:
    """A square section is √12 standard deviations deep: its faces are 1/√6 of √18 of them off."""
    modulus = (1 / S11, E111)[grain - 1]
    bound = stress / modulus * np.sqrt(6)
    material = replace(M, **changes)  # type: ignore[arg-type]
    simulation = replace(
        pulled(make(), replace(material, eigenstrain=-0.99 * bound), (0.002,)),
        orientations=np.stack([CUBE, DIAGONAL]),
    )
    refuse_bad_simulation(simulation)
    beyond = replace(simulation, material=replace(material, eigenstrain=2 * bound))
    with pytest.raises(UnsupportedError) as error:
        refuse_bad_simulation(beyond)
    assert str(error.value) == (
        f"eigenstrain is {2 * bound:g}, by which grain {grain} carries about {2 * stress:.3g} MPa "
        f"before loading and yields at {stress:.3g}; expected at most {bound:.2g} in size"
    )


def test_every_constant_of_the_law_has_a_rule() -> None:
    assert set(_RULES) == set(MATERIAL_PARAMETERS)


def _turn(time: float, points: FloatArray) -> FloatArray:
    turn = np.array([[0.0, 0.1, 0.0], [-0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])
    return np.asarray(time * points @ turn)


@pytest.mark.parametrize(
    "simulation",
    [
        GOOD,
        pulled(box((2, 2, 2), jitter=0.2), Material(strain_measure="small"), (0.01,), steps=3),
        moved(box(), Material(), skin(box()), _turn, np.array([0.0, 0.5, 1.0])),
        replace(GOOD, steps=np.array([0.5, 1.0, 1.5, 2.0]), accuracy=1.0),
        replace(GOOD, motion=np.where(GOOD.motion_mask, GOOD.motion, NAN)),
        along(material={"tau0": 1.0}, rotation=np.ones((2, 3)), motion=GOOD.motion),
        held(
            lambda p: (
                np.array([False, True, False])
                | at(p, 0, 0, 0)
                | (at(p, 2, 0, 0) & np.array([False, False, True]))
            )
        ),
    ],
    ids=["pulled", "fine", "moved", "steps", "masked", "directions", "free bar"],
)
def test_good_simulations_pass(simulation: Simulation) -> None:
    refuse_bad_simulation(simulation)


def test_an_exponent_near_one_is_refused_for_the_exponential_scheme_alone() -> None:
    near = replace(GOOD, material=replace(GOOD.material, n=1.2))
    with pytest.raises(UnsupportedError, match=r"^n is 1.2; expected 1.5 or more"):
        refuse_bad_simulation(near)
    refuse_bad_simulation(replace(near, integration="backward_euler"))
