"""What Code_Aster lacks is refused by name before its files are written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from solver_adapters.checks.capabilities import BASE
from solver_adapters.code_aster.adapter import CodeAsterAdapter
from solver_adapters.code_aster.limits import CAPABILITIES
from solver_adapters.crystal import BCC, FCC
from solver_adapters.interaction import self_and_latent
from solver_adapters.interface import Simulation, UnsupportedError
from solver_adapters.material import (
    MATERIAL_DECLARATIONS,
    MATERIAL_PARAMETERS,
    Material,
    of_other_crystals,
)
from tools.boxes import hex_box, pulled
from tools.code_aster_cases import small_case

ADAPTER = CodeAsterAdapter()


def unsymmetric() -> tuple[tuple[float, ...], ...]:
    matrix = self_and_latent(1.0, 0.2)
    matrix[3, 7] = 0.9
    return tuple(tuple(row) for row in matrix.tolist())


def test_what_code_aster_has_of_the_law_is_said() -> None:
    assert sorted(CAPABILITIES.material) == [
        "C11", "C12", "C44", "C44_scale", "K", "Q", "Q_latent", "b", "c", "d", "elastic_scale",
        "h_latent", "n", "tau0", "tau0_112", "tau0_grain2",
    ]  # fmt: skip
    assert CAPABILITIES.material < set(MATERIAL_PARAMETERS)


LACKING = {*MATERIAL_PARAMETERS} - CAPABILITIES.material - BASE - of_other_crystals(BCC)


@pytest.mark.parametrize("name", sorted(LACKING))
def test_every_term_of_the_law_that_code_aster_lacks_is_refused_at_its_scale(name: str) -> None:
    (term,) = (declared for declared in MATERIAL_DECLARATIONS if declared.name == name)
    asked = small_case(**{name: term.null + term.change(term.null)})
    with pytest.raises(UnsupportedError, match=f"^{name} = .*: the solver code_aster cannot"):
        ADAPTER.files(asked)


@pytest.mark.parametrize(
    ("simulation", "words"),
    [
        (small_case(a1=0.1), "a1 = 0.1: the solver code_aster cannot honour it"),
        (small_case(c2=1500.0), "c2 = 1500: "),
        (small_case(x0=1e-4), "x0 = 0.0001: "),
        (small_case(eigenstrain=1e-5), "eigenstrain = 1e-05: "),
        (small_case(skin_tau0=1.2), "skin_tau0 = 1.2: "),
        (small_case(tau0_grain1_bend_Y=0.1), "tau0_grain1_bend_Y = 0.1: "),
        (
            small_case(slip_systems=FCC[:3]),
            "slip_systems other than .*; expected those of BCC or FCC, .*can: bundled",
        ),
        (
            replace(small_case(slip_systems=FCC, strain_measure="finite"), cell_fields=True),
            "fields of the cells of FCC in finite strain, .*can: bundled",
        ),
        (small_case(tau0_antitwinning=1.1), "tau0_antitwinning = 1.1: "),
        (replace(small_case(), integration="exponential"), 'integration = "exponential": '),
        (replace(small_case(), lattice_gradient=np.ones((2, 3))), "lattice_gradient: "),
        (replace(small_case(), accuracy=0.5), "accuracy = 0.5 µN: .* can: bundled$"),
        (
            replace(pulled(hex_box(), Material(), (0.01,)), integration="backward_euler"),
            "cells of 20 nodes: .* can: bundled, calculix$",
        ),
        (small_case(Q=10.0, interaction=unsymmetric()), "interaction is not symm.*can: bundled"),
        # Code_Aster sums over the systems of one family and reads one block for both (lcmmfi).
        (
            small_case(Q=10.0, tau0_112=1.1, h_latent=1.0),
            "tau0_112 is 1.1 and systems harden each other .*can: bundled",
        ),
        (
            small_case(tau0_112=1.1, Q_latent=4.0),
            "tau0_112 is 1.1 and systems harden each other .*can: bundled",
        ),
    ],
)
def test_what_code_aster_lacks_is_refused_by_name(simulation: Simulation, words: str) -> None:
    with pytest.raises(UnsupportedError, match=words):
        ADAPTER.files(simulation)


def test_an_interaction_without_hardening_is_no_matter() -> None:
    assert ADAPTER.files(small_case(interaction=unsymmetric(), tau0_112=1.1))
