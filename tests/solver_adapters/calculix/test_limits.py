from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solver_adapters.calculix.adapter import CalculixAdapter
from solver_adapters.calculix.limits import CAPABILITIES
from solver_adapters.checks.capabilities import BASE
from solver_adapters.crystal import BCC, FCC
from solver_adapters.interaction import self_and_latent
from solver_adapters.interface import Direction, Simulation, UnsupportedError
from solver_adapters.material import MATERIAL_DECLARATIONS, MATERIAL_PARAMETERS, of_other_crystals
from solver_adapters.profile import Profile
from tests.solver_adapters.calculix.runs import simulation


def refusal(asked: Simulation) -> str:
    with pytest.raises(UnsupportedError) as error:
        CalculixAdapter().files(asked)
    return str(error.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"strain_measure": "finite"},
        {"tau0_112": 1.0},
        {"tau0_antitwinning": 1.1},
        {"a1": 0.1},
        {"c2": 1500.0},
        {"x0": 1e-5},
        {"eigenstrain": 1e-4},
        {"skin_tau0": 1.2},
        {"tau0_grain2_slope_X": 0.1},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_a_term_that_calculix_lacks_is_refused_by_name_with_the_solvers_that_have_it(
    changes: dict[str, Any],
) -> None:
    ((name, value),) = changes.items()
    message = refusal(simulation(**changes))
    shown = f'"{value}"' if isinstance(value, str) else f"{value:g}"
    assert message.startswith(f"{name} = {shown}: ")
    others = message.split("of the solvers that can: ")[1].split(", ")
    assert "bundled" in others
    assert "calculix" not in others


@pytest.mark.parametrize(
    "name",
    sorted(
        {*MATERIAL_PARAMETERS}
        - CAPABILITIES.material
        - CAPABILITIES.conditional
        - BASE
        - of_other_crystals(BCC)
    ),
)
def test_every_term_of_the_law_that_calculix_lacks_is_refused_at_its_scale(name: str) -> None:
    (term,) = (declared for declared in MATERIAL_DECLARATIONS if declared.name == name)
    changes: dict[str, Any] = {name: term.null + term.change(term.null)}
    message = refusal(simulation(**changes))
    assert message.startswith(f"{name} = ") and "the solver calculix cannot" in message


@pytest.mark.parametrize("h_latent", [0.0, 0.1, -0.2])
def test_hardening_is_refused_but_with_the_interaction_that_calculix_fixes(h_latent: float) -> None:
    message = refusal(simulation(Q=20.0, h_latent=h_latent))
    assert "Q = 20" in message
    assert "h_latent = -0.1" in message
    assert "bundled" in message
    assert CalculixAdapter().files(simulation(Q=20.0, h_latent=-0.1))


def test_an_interaction_matrix_is_judged_by_its_octahedral_block() -> None:
    matrix = self_and_latent(1.0, 0.5)
    matrix[:12, :12] = self_and_latent(1.0, -0.1)[:12, :12]
    assert CalculixAdapter().files(simulation(Q=20.0, interaction=tuple(map(tuple, matrix))))
    matrix[0, 1] = 0.0
    message = refusal(simulation(Q=20.0, interaction=tuple(map(tuple, matrix))))
    assert "an interaction of its own" in message


def test_systems_other_than_the_octahedral_ones_are_refused() -> None:
    assert CalculixAdapter().files(simulation(slip_systems=FCC, tau0_112=1.0))
    message = refusal(simulation(slip_systems=FCC[:11], tau0_112=1.0))
    assert message.startswith("slip_systems other than those") and "bundled" in message


def test_latent_hardening_without_hardening_is_no_matter() -> None:
    assert CalculixAdapter().files(simulation(Q=0.0, h_latent=0.3))
    assert CalculixAdapter().files(simulation(Q=20.0, b=0.0, h_latent=0.3))


def test_latent_hardening_of_its_own_is_refused() -> None:
    for Q, h_latent in ((0.0, 0.0), (20.0, -0.1)):
        message = refusal(simulation(Q=Q, h_latent=h_latent, Q_latent=4.0))
        assert "Q_latent = 4" in message and "bundled" in message


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"integration": "exponential"}, 'integration = "exponential"'),
        ({"directions": (Direction("tau0", {"tau0": 1.0}),)}, "derivatives along tau0"),
        ({"cell_fields": True}, "fields of the cells"),
        ({"lattice_gradient": np.full((2, 3), 1e-3)}, "lattice_gradient"),
        ({"accuracy": 1.0}, "accuracy = 1 µN"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_an_option_that_calculix_lacks_is_refused(changes: dict[str, Any], name: str) -> None:
    assert name in refusal(replace(simulation(), **changes))


def test_what_is_judged_by_its_value_is_not_offered_for_identification() -> None:
    assert not CAPABILITIES.material & CAPABILITIES.conditional


def test_more_than_one_process_is_refused() -> None:
    with pytest.raises(UnsupportedError) as error:
        CalculixAdapter(Profile(processes=2)).files(simulation())
    assert str(error.value) == (
        "processes = 2 in the profile of calculix: CalculiX runs in one process; expected "
        "processes = 1, and threads for more cores"
    )
