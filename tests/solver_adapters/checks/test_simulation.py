"""Each bad input is refused in one sentence; the figures follow from boxes of 12 cells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.checks.simulation import refuse_bad_simulation
from solver_adapters.crystal import FCC
from solver_adapters.grain_scalars import INSIDE_NULL
from solver_adapters.interface import BadSimulationError, Simulation, Trajectory, UnsupportedError
from solver_adapters.material import MATERIAL_PARAMETERS, Material, admissible_at
from tests.solver_adapters.simulations import (
    GOOD,
    INF,
    MESH,
    NAN,
    N,
    along,
    at,
    given,
    held,
    of_material,
    of_mesh,
    refused,
    with_value,
)
from tools.boxes import ORIENTATIONS, box, moved, pulled, skin

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
        of_material(tau0_grains_inside=(INSIDE_NULL, (*INSIDE_NULL[:-1], 0.0))),
        "tau0_grain4_band_half_width is 0; expected a positive number",
    ),
    (
        of_material(tau0_grains_inside=((NAN, *INSIDE_NULL[1:]),)),
        "tau0_grain3_slope_Y is nan; expected a finite number",
    ),
    (
        of_material(slip_systems=(((1, 1, 1), (1, 1, 0)),)),
        "slip_systems has system 1 with a direction that does not lie in its plane; expected 1 to ",
    ),
    (
        of_material(slip_systems=FCC, a1=0.1),
        "a1 is 0.1; expected 0, for the slip systems are not those of BCC",
    ),
    (
        of_material(tau0_123=1.1),
        "tau0_123 is 1.1; expected 1, for the slip systems are not those of BCC with {123}",
    ),
    (
        of_material(slip_systems=FCC, interaction=((1.0,) * 24,) * 24),
        "interaction has 24 rows of [24] numbers; expected 12 rows of 12",
    ),
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
        given(integration="midpoint"),
        "integration is 'midpoint'; expected 'backward_euler' or 'exponential'",
    ),
    (
        along(material={"tau1": 1.0}),
        "direction 'a' changes 'tau1', which the material does not have; expected one of C11",
    ),
    (
        along(material={"tau0_grain3_band": 1.0}),
        "direction 'a' changes 'tau0_grain3_band', which the material does not have; expected one ",
    ),
]

BROKEN: list[tuple[Simulation, str]] = [
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
            given(steps_per_interval=value),
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
    (
        of_material(tau0_grains_inside=(INSIDE_NULL,)),
        "tau0_grains_inside has 1 rows for 2 grains; expected at most 0, those of the third and ",
    ),
    *[
        (
            of_material(tau0_grains_inside=rows),
            f"tau0_grains_inside is {rows!r}; expected a tuple of tuples of 6 numbers",
        )
        for rows in (0.1, [INSIDE_NULL], (INSIDE_NULL[:5],), (list(INSIDE_NULL),))
    ],
    (
        of_material(tau0_grains_inside=(("1", *INSIDE_NULL[1:]),)),
        "tau0_grain3_slope_Y is '1'; expected a number",
    ),
    (given(tolerance="1e-7"), "tolerance is '1e-7'; expected a number"),
    (given(accuracy="1"), "accuracy is '1'; expected a number"),
    *[
        (
            given(**{name: list(getattr(GOOD, name))}),
            f"{name} is a list; expected an array",
        )
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
    (given(steps=[1.0, 2.0]), "steps is a list; expected an array"),
    (
        replace(GOOD, times=np.array(["0", "1", "2"])),
        "times holds <U1; expected real numbers",
    ),
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
        replace(GOOD, warm_start=Trajectory(np.array([0.0, 1.0]), np.zeros((2, 5, 3)))),
        f"warm_start.displacement has shape (2, 5, 3); expected (2, {len(GOOD.mesh.points)}, 3)",
    ),
    (
        replace(GOOD, warm_start=Trajectory(np.zeros(1), np.zeros((1, len(GOOD.mesh.points), 3)))),
        "warm_start.times holds 1 instants; expected the first one and an end of a step or more",
    ),
    (
        replace(GOOD, warm_start=Trajectory(np.array([0.0, 1.0, 1.0]), np.zeros((3, 5, 3)))),
        "warm_start.times goes from 1 to 1 at place 2; expected increasing values",
    ),
    (
        replace(
            GOOD, warm_start=Trajectory(GOOD.times, np.full((3, len(GOOD.mesh.points), 3), NAN))
        ),
        f"warm_start.displacement holds {9 * len(GOOD.mesh.points)} values that are not finite; "
        "expected",
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
]


@pytest.mark.parametrize(
    ("simulation", "sentence"), UNSUPPORTED, ids=[sentence for _, sentence in UNSUPPORTED]
)
def test_what_no_solver_can_honour_is_unsupported(simulation: Simulation, sentence: str) -> None:
    refused(simulation, UnsupportedError, sentence)


@pytest.mark.parametrize(("simulation", "sentence"), BROKEN, ids=[s for _, s in BROKEN])
def test_broken_input_is_named_in_one_sentence(simulation: Simulation, sentence: str) -> None:
    refused(simulation, BadSimulationError, sentence)


def test_every_constant_of_the_law_has_a_rule() -> None:
    assert set(admissible_at(Material())) == set(MATERIAL_PARAMETERS)


@pytest.mark.parametrize("name", MATERIAL_PARAMETERS)
def test_no_constant_of_the_law_may_be_infinite(name: str) -> None:
    expected = admissible_at(Material())[name].words
    with pytest.raises(UnsupportedError, match=rf"^{name} is inf; expected {expected}$"):
        refuse_bad_simulation(of_material(**{name: INF}))


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
        replace(GOOD, warm_start=Trajectory(GOOD.times, np.zeros((3, len(GOOD.mesh.points), 3)))),
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
    ids=["pulled", "fine", "moved", "steps", "near", "masked", "directions", "free bar"],
)
def test_good_simulations_pass(simulation: Simulation) -> None:
    refuse_bad_simulation(simulation)


def test_an_exponent_near_one_is_refused_for_the_exponential_scheme_alone() -> None:
    near = replace(GOOD, material=replace(GOOD.material, n=1.2))
    with pytest.raises(UnsupportedError, match=r"^n is 1.2; expected 1.5 or more"):
        refuse_bad_simulation(near)
    refuse_bad_simulation(replace(near, integration="backward_euler"))
