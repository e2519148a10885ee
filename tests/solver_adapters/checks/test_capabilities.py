"""What a solver lacks is refused by name, with the solvers that have it."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from solver_adapters.checks.capabilities import BASE, refuse_unsupported
from solver_adapters.crystal import FCC
from solver_adapters.interface import Capabilities, Direction, Simulation, UnsupportedError
from solver_adapters.material import TAU0_BANDS, TAU0_MODES, Material, with_parameters
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


def test_who_honours_modes_without_bands_honours_the_inside_of_no_later_grain() -> None:
    inside = ((0.1, 0.0, 0.0, 0.0, 0.0, 0.25),)
    asked = replace(PLAIN, material=replace(PLAIN.material, tau0_grains_inside=inside))
    modes = Capabilities(frozenset(TAU0_MODES[1]), frozenset({"small"}), derivatives=False)
    with pytest.raises(UnsupportedError, match="^tau0_grains_inside = "):
        refuse_unsupported(asked, "modes", modes, dict)
    both = replace(modes, material=modes.material | {TAU0_BANDS[1][0]})
    refuse_unsupported(asked, "both", both, dict)


OFF = {
    "tau0_grains": (1.1,),
    "tau0_grains_inside": ((0.1, 0.0, 0.0, 0.0, 0.0, 0.25),),
    "slip_systems": FCC,
    "interaction": ((1.0,) * 24,) * 24,
}


@pytest.mark.parametrize("name", sorted({f.name for f in fields(Material)} - BASE))
def test_a_field_of_the_law_off_its_null_is_refused_by_a_solver_that_names_none(name: str) -> None:
    value: Any = OFF.get(name, 0.5)
    asked = replace(PLAIN, material=replace(PLAIN.material, **{name: value}))
    none = Capabilities(frozenset(), frozenset({"small"}), derivatives=False)
    with pytest.raises(UnsupportedError, match=f"^{name} = "):
        refuse_unsupported(asked, "plain", none, dict)
