"""The check of command files finds faults, and none in the decks that are rendered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from solver_adapters.code_aster.adapter import CodeAsterAdapter
from solver_adapters.crystal import FCC, bunge_matrix
from solver_adapters.interaction import bcc24_classes
from solver_adapters.interface import Simulation
from solver_adapters.material import Material
from tests.solver_adapters.code_aster.catalogue import faults
from tools.boxes import box, one_grain, pulled
from tools.code_aster_cases import small_case

MODEL = """\
MESH = LIRE_MAILLAGE(FORMAT='MED', UNITE=20)
MODEL = AFFE_MODELE(
    MAILLAGE=MESH, AFFE=_F(TOUT='OUI', PHENOMENE='MECANIQUE', MODELISATION='3D'))
"""
CUT = """\
TIMES = DEFI_LIST_REEL(VALE=[0., 1.])
CUT = DEFI_LIST_INST(
    DEFI_LIST=_F(LIST_INST=TIMES), ECHEC=_F(ACTION='DECOUPE', SUBD_PAS=2, SUBD_NIVEAU=8))
"""


def hardening(keywords: str) -> str:
    return f"MAT = DEFI_MATERIAU(MONO_ISOT1=_F(R_0=40., Q=3., B=30., {keywords}))"


def deck(simulation: Simulation) -> str:
    return CodeAsterAdapter().write(simulation)["job.comm"].decode("ascii")


def finite_strain() -> Simulation:
    case = small_case()
    return replace(case, material=replace(case.material, strain_measure="finite"))


def recorded_steps() -> Simulation:
    return replace(small_case(), steps=np.linspace(0.03, 6.0, 200))


def wanted_instants() -> Simulation:
    case, times = small_case(), np.linspace(0.0, 6.0, 151)
    motion = times[:, None, None] * case.motion[1] / 6.0
    return replace(case, times=times, motion=motion, output=np.arange(1, 151))


def three_grains() -> Simulation:
    mesh = box((1, 3, 1), (2.0, 6.0, 2.0))
    centre = mesh.points[mesh.cells].mean(axis=1)[:, 1]
    case = small_case(tau0_grain2=1.5, tau0_grains=(0.9,))
    loaded = pulled(mesh, case.material, (0.01,), interval=2.0)
    return replace(
        loaded,
        mesh=replace(mesh, grain=(centre // 2.0).astype(np.int64)),
        orientations=np.stack([bunge_matrix(281, 8, angle) for angle in (47, 147, 247)]),
        integration="backward_euler",
    )


def single_grain() -> Simulation:
    law = Material(strain_measure="small")
    return replace(
        pulled(one_grain(box()), law, (0.01,), interval=2.0), integration="backward_euler"
    )


def free_components() -> Simulation:
    case = small_case()
    mask = case.motion_mask.copy()
    mask[:, 0] = False
    mask[2:, 2] = False
    return replace(case, motion_mask=mask)


def unlike() -> tuple[tuple[float, ...], ...]:
    """Systems of one plane harden each other less."""
    plane = np.arange(12) // 3
    matrix = np.where(plane[:, None] == plane, 0.5, 1.5)
    np.fill_diagonal(matrix, 1.0)
    return tuple(map(tuple, matrix.tolist()))


CASES: dict[str, Callable[[], Simulation]] = {
    "null": small_case,
    "isotropic": lambda: small_case(Q=3.0, b=30.0, tau0_grain2=1.5),
    "even latent": lambda: small_case(Q=3.0, h_latent=0.4),
    "latent beside Q": lambda: small_case(Q=3.0, Q_latent=2.0),
    "latent without Q": lambda: small_case(Q_latent=2.0),
    "four classes": lambda: small_case(
        Q=3.0, interaction=tuple(map(tuple, bcc24_classes(0.5, 1.0, 0.25, 2.0).tolist()))
    ),
    "two families": lambda: small_case(tau0_112=1.25),
    "two families that harden": lambda: small_case(tau0_112=1.25, Q=3.0),
    "fcc": lambda: small_case(slip_systems=FCC, Q=3.0, h_latent=0.4),
    "fcc with a table": lambda: small_case(slip_systems=FCC, Q=3.0, interaction=unlike()),
    "finite strain": finite_strain,
    "cell fields": lambda: replace(small_case(), cell_fields=True),
    "steps of an interval": lambda: replace(small_case(), steps_per_interval=7),
    "recorded steps": recorded_steps,
    "150 instants": wanted_instants,
    "three grains": three_grains,
    "single grain": single_grain,
    "free components": free_components,
}


@pytest.mark.parametrize("name", CASES)
def test_every_rendered_deck_has_the_syntax_of_15_16_and_17(name: str) -> None:
    assert faults(deck(CASES[name]())) == []


def test_a_doubled_comma_is_found_in_its_line() -> None:
    (fault,) = faults("DEBUT()\nSTEPS = [0.0, 1.0,,\n    2.0]\n")
    assert fault.startswith("line 2: ")


def test_a_command_that_none_knows_is_found() -> None:
    assert faults("DEBUT()\nMESH = LIRE_MALLAGE(UNITE=20)\n") == [
        "line 2: LIRE_MALLAGE is no known command"
    ]


def test_an_unknown_keyword_is_found_at_every_depth() -> None:
    assert faults("DEBUT(LANGUE='EN')") == ["line 1: DEBUT has no keyword LANGUE"]
    assert faults(hardening("H=0., H9=1.")) == [
        "line 1: DEFI_MATERIAU/MONO_ISOT1 has no keyword H9"
    ]


def test_the_name_that_only_17_has_for_the_local_residual_is_found() -> None:
    text = deck(small_case()).replace("RESI_INTE_RELA", "RESI_INTE")
    assert [fault.split(": ")[1] for fault in faults(text)] == [
        "STAT_NON_LINE/COMPORTEMENT has no keyword RESI_INTE"
    ] * 2


def test_a_missing_keyword_is_found() -> None:
    assert faults(MODEL) == []
    assert faults(MODEL.replace("PHENOMENE='MECANIQUE', ", "")) == [
        "line 2: AFFE_MODELE/AFFE lacks PHENOMENE"
    ]
    assert faults("KEPT = DEFI_LIST_REEL()") == ["line 1: DEFI_LIST_REEL lacks VALE"]


def test_a_list_without_values_is_found() -> None:
    assert faults("WANTED = ()\nKEPT = DEFI_LIST_REEL(VALE=WANTED)") == [
        "line 2: DEFI_LIST_REEL/VALE is empty"
    ]


def test_a_wrong_word_is_found_also_behind_a_name() -> None:
    assert faults(MODEL.replace("'3D'", "'4D'")) == [
        "line 2: AFFE_MODELE/AFFE/MODELISATION is '4D'; expected 3D"
    ]
    text = deck(small_case()).replace("PREDICTION = 'TANGENTE'", "PREDICTION = 'SECANTE'")
    assert [fault.split(": ")[1].split(";")[0] for fault in faults(text)] == [
        "STAT_NON_LINE/NEWTON/PREDICTION is 'SECANTE'"
    ]


def test_keywords_that_exclude_each_other_are_found_also_behind_stars() -> None:
    classes = "CLASSES = dict(H=0., H1=1., H2=1., H3=1., H4=1.)\n"
    assert "line 2: DEFI_MATERIAU/MONO_ISOT1 has H and H1, which exclude each other" in faults(
        classes + hardening("**CLASSES")
    )


def test_a_choice_of_which_nothing_is_taken_is_found() -> None:
    assert faults(MODEL.replace("TOUT='OUI', ", "")) == [
        "line 2: AFFE_MODELE/AFFE has none of TOUT, GROUP_MA"
    ]


def test_a_keyword_without_those_that_it_asks_for_is_found() -> None:
    assert faults(hardening("H1=1., H2=1.")) == [
        "line 1: DEFI_MATERIAU/MONO_ISOT1 has H1 without H3, H4"
    ]


def test_a_keyword_that_is_given_twice_is_found() -> None:
    assert faults("CLASSES = dict(H=0.)\n" + hardening("H=0., **CLASSES")) == [
        "line 2: DEFI_MATERIAU/MONO_ISOT1 has H twice"
    ]


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("SUBD_PAS=2", "SUBD_PAS=1", "ECHEC/SUBD_PAS is 1; expected 2 or more"),
        ("SUBD_NIVEAU=8", "SUBD_NIVEAU=8.5", "ECHEC/SUBD_NIVEAU is no whole number"),
        ("SUBD_PAS=2", "SUBD_PAS='2'", "ECHEC/SUBD_PAS is no whole number"),
        ("ACTION='DECOUPE'", "ACTION=2", "ECHEC/ACTION is no text"),
        ("ECHEC=_F(", "ECHEC=list(", "ECHEC is no _F(...)"),
        (
            "LIST_INST=TIMES",
            "LIST_INST=[0., 1.]",
            "DEFI_LIST/LIST_INST has 2 values; expected 1 at most",
        ),
        ("=TIMES", "='TIMES'", "DEFI_LIST/LIST_INST is not made by DEFI_LIST_REEL"),
    ],
)
def test_a_value_of_the_wrong_kind_is_found(old: str, new: str, fault: str) -> None:
    assert faults(CUT) == []
    assert faults(CUT.replace(old, new))[0] == f"line 2: DEFI_LIST_INST/{fault}"


def test_what_another_command_made_is_found() -> None:
    text = deck(small_case()).replace("CHAM_MATER=MATTER", "CHAM_MATER=FRAMES")
    assert [fault.split(": ")[1] for fault in faults(text)] == [
        "STAT_NON_LINE/CHAM_MATER is not made by AFFE_MATERIAU"
    ]


def test_a_name_is_found_that_is_not_defined_before_its_use() -> None:
    assert faults("E = C11 + 1.\nC11 = 2.\n") == ["line 1: C11 is not defined"]
    assert faults("STEPS += [1.]") == ["line 1: STEPS is not defined"]
    assert faults("KEPT = DEFI_LIST_REEL(VALE=[nan])") == ["line 1: nan is not defined"]


def test_a_function_may_use_what_is_defined_after_it_but_nothing_else() -> None:
    text = "def moved(x):\n    y = x\n    return y + shift\n\n"
    assert faults(text) == ["line 3: shift is not defined"]
    assert faults(text + "shift = 1.\n") == []


def test_names_of_loops_files_and_comprehensions_are_defined() -> None:
    text = """\
import numpy as np
with open('motion.csv') as file:
    header, *rows = [line.split(',') for line in file]
for node, *values in rows:
    place = np.array(values)
pairs = {a: b for a, b in zip(header, rows)}
longest = max(len(row) for row in rows)
ordered = sorted(rows, key=lambda row: row[0])
"""
    assert faults(text) == []
    assert faults(text + "again = row\n") == ["line 9: row is not defined"]


def test_a_formula_names_only_its_parameters_and_constants() -> None:
    text = "def moved(x, t):\n    return x * t\n\n"
    text += "U = FORMULE(NOM_PARA=('X', 'INST'), VALE='sin(moved(X, INST))', moved=moved)\n"
    assert faults(text) == []
    assert faults(text.replace(", moved=moved", "")) == [
        "line 4: FORMULE/VALE names moved, which is not defined"
    ]
    (fault,) = faults(text.replace("INST))'", "INST)'"))
    assert fault.startswith("line 4: FORMULE/VALE: ")
