"""What a solver lacks is refused by name, with the solvers that have it."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from solver_adapters.checks.capabilities import BASE, refuse_unsupported
from solver_adapters.crystal import FCC
from solver_adapters.grain_scalars import as_honoured, later_names
from solver_adapters.interface import Capabilities, Direction, Simulation, UnsupportedError
from solver_adapters.material import OF_SECOND_GRAIN, Material, with_parameters
from tools.boxes import box, hex_box, pulled

PLAIN = replace(
    pulled(box(), Material(strain_measure="small"), (0.01,)), integration="backward_euler"
)
SMALL = Capabilities(frozenset({"tau0"}), frozenset({"small"}), derivatives=False)
ALL = Capabilities(
    frozenset({"a1", "h_latent"}),
    frozenset({"small", "finite"}),
    derivatives=True,
    cell_fields=True,
    integrations=frozenset({"exponential", "backward_euler"}),
    lattice_gradient=True,
    times=True,
    accuracy=True,
    cells=frozenset({10, 20}),
)
NULL = "its null value"


def refuse(simulation: Simulation) -> None:
    refuse_unsupported(simulation, "small one", SMALL, lambda: {"small one": SMALL, "other": ALL})


def test_the_plain_law_is_not_refused() -> None:
    refuse(PLAIN)
    refuse(replace(PLAIN, material=replace(PLAIN.material, tau0=21.0, b=70.0, d2=3.0)))
    elsewhere = {"tau0_grain1_band_middle": 0.5, "tau0_grain2_band_half_width": 0.1}
    refuse(replace(PLAIN, material=with_parameters(PLAIN.material, elsewhere)))


@pytest.mark.parametrize(
    ("asked", "named", "instead"),
    [
        (replace(PLAIN, material=replace(PLAIN.material, a1=0.1)), "a1 = 0.1", NULL),
        (
            replace(PLAIN, material=replace(PLAIN.material, interaction=tuple([(1.0,) * 24] * 24))),
            "interaction = given",
            NULL,
        ),
        (replace(PLAIN, material=Material()), 'strain_measure = "finite"', "another one"),
        (replace(PLAIN, integration="exponential"), 'integration = "exponential"', "another one"),
        (replace(PLAIN, cell_fields=True), "fields of the cells", "none of them"),
        (
            replace(PLAIN, directions=(Direction("K", {"K": 1.0}),)),
            "derivatives along K",
            "no directions",
        ),
        (replace(PLAIN, accuracy=2.0), "accuracy = 2 µN", "None"),
        (replace(PLAIN, lattice_gradient=np.zeros((2, 3))), "lattice_gradient", "None"),
        (replace(PLAIN, mesh=hex_box()), "cells of 20 nodes", "cells of another kind"),
    ],
)
def test_a_wish_is_refused_by_name_with_the_solver_that_can(
    asked: Simulation, named: str, instead: str
) -> None:
    with pytest.raises(UnsupportedError) as error:
        refuse(asked)
    assert str(error.value) == (
        f"{named}: the solver small one cannot honour it; expected {instead}, or one of the "
        "solvers that can: other"
    )


def test_a_wish_that_no_solver_can_grant_says_so() -> None:
    asked = replace(PLAIN, material=replace(PLAIN.material, x0=1e-5))
    with pytest.raises(UnsupportedError, match="solvers that can: none is installed"):
        refuse(asked)


def test_a_solver_with_derivatives_is_asked_along_the_instants_only_where_it_says_so() -> None:
    asked = replace(PLAIN, directions=(Direction("holds", times=np.zeros(len(PLAIN.times))),))
    able = replace(SMALL, derivatives=True)
    with pytest.raises(UnsupportedError, match="the derivative along holds, which moves the inst"):
        refuse_unsupported(asked, "able", able, lambda: {"other": ALL})
    refuse_unsupported(asked, "able", replace(able, times=True), dict)


def test_a_conditional_parameter_is_left_to_the_adapter_that_is_no_solver_to_name_for_it() -> None:
    asked = replace(PLAIN, material=replace(PLAIN.material, a1=0.1))
    judging = replace(SMALL, conditional=frozenset({"a1"}))
    refuse_unsupported(asked, "judging", judging, dict)
    with pytest.raises(UnsupportedError, match="solvers that can: none is installed"):
        refuse_unsupported(asked, "small one", SMALL, lambda: {"judging": judging})


@pytest.mark.parametrize("name", later_names(4))
def test_a_scalar_of_a_later_grain_is_honoured_by_who_honours_that_of_the_second(name: str) -> None:
    asked = replace(PLAIN, material=with_parameters(PLAIN.material, {name: 0.4}))
    like = as_honoured(name)
    others = Capabilities(OF_SECOND_GRAIN - {like}, frozenset({"small"}), derivatives=False)
    alone = replace(others, material=frozenset({like}))
    refuse_unsupported(asked, "alone", alone, dict)
    if like in BASE:  # middle and width of a band do nothing without its height
        refuse_unsupported(asked, "others", others, dict)
    else:
        with pytest.raises(UnsupportedError, match=f"^{name} = 0.4: the solver others"):
            refuse_unsupported(asked, "others", others, dict)


OFF = {"slip_systems": FCC, "interaction": ((1.0,) * 24,) * 24}
OF_LATER = {"tau0_grains", "tau0_grains_inside"}


@pytest.mark.parametrize("name", sorted({f.name for f in fields(Material)} - BASE - OF_LATER))
def test_a_field_of_the_law_off_its_null_is_refused_by_a_solver_that_names_none(name: str) -> None:
    value: Any = OFF.get(name, 0.5)
    asked = replace(PLAIN, material=replace(PLAIN.material, **{name: value}))
    none = Capabilities(frozenset(), frozenset({"small"}), derivatives=False)
    with pytest.raises(UnsupportedError, match=f"^{name} = "):
        refuse_unsupported(asked, "plain", none, dict)
    refuse_unsupported(asked, "able", replace(none, material=frozenset({name})), dict)
