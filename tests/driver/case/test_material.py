from __future__ import annotations

import tomllib

import numpy as np
import pytest

from driver.case.material import MaterialTable
from solver_adapters.constants import interaction_matrix
from solver_adapters.crystal import BCC, BCC48, FCC
from solver_adapters.interaction import bcc24_classes
from solver_adapters.material import MATERIAL_DECLARATIONS, Material, of_other_crystals
from tests.driver.case.tables import refused


def read(text: str) -> MaterialTable:
    """The table [material] of a file."""
    return MaterialTable.model_validate(tomllib.loads(text))


def test_the_constants_of_the_paper_are_the_defaults_in_megapascals() -> None:
    assert MaterialTable(strain_measure="small").to_material() == Material(strain_measure="small")
    assert MaterialTable(C11_GPa=200.0).to_material().C11 == pytest.approx(200e3)


def test_every_scalar_of_the_law_has_its_key_in_its_unit() -> None:
    changed = MaterialTable(
        h_latent=0.4, Q_latent_MPa=3, tau0_antitwinning=1.2, a1=0.3, c2_MPa=1500, d2=100, x0=-1e-4,
        eigenstrain=1e-3, skin_tau0=1.5, skin_thickness_um=0.2,
        tau0_grain1_slope_Y=0.1, tau0_grain1_bend_Y=-0.2, tau0_grain1_slope_X=0.3,
        tau0_grain2_slope_Y=-0.4, tau0_grain2_bend_Y=0.5, tau0_grain2_slope_X=-0.6,
        tau0_grain1_band=-0.4, tau0_grain1_band_middle=0.3, tau0_grain1_band_half_width=0.1,
        tau0_grain2_band=0.4, tau0_grain2_band_middle=-0.3, tau0_grain2_band_half_width=0.4,
    )  # fmt: skip
    assert changed.to_material() == Material(
        h_latent=0.4, Q_latent=3, tau0_antitwinning=1.2, a1=0.3, c2=1500, d2=100, x0=-1e-4,
        eigenstrain=1e-3, skin_tau0=1.5, skin_thickness=0.2,
        tau0_grain1_slope_Y=0.1, tau0_grain1_bend_Y=-0.2, tau0_grain1_slope_X=0.3,
        tau0_grain2_slope_Y=-0.4, tau0_grain2_bend_Y=0.5, tau0_grain2_slope_X=-0.6,
        tau0_grain1_band=-0.4, tau0_grain1_band_middle=0.3, tau0_grain1_band_half_width=0.1,
        tau0_grain2_band=0.4, tau0_grain2_band_middle=-0.3, tau0_grain2_band_half_width=0.4,
    )  # fmt: skip


def test_four_numbers_are_the_classes_of_bcc24_and_24_rows_the_matrix_itself() -> None:
    classes = read("interaction = [1, 1.4, 0.7, 0.5]")
    expected = bcc24_classes(1.0, 1.4, 0.7, 0.5)
    interaction = classes.to_material().interaction
    assert interaction is not None and np.array_equal(interaction, expected)
    rows = read(f"interaction = {expected.tolist()}")
    assert rows.to_material() == classes.to_material()
    assert read("").to_material().interaction is None


def test_a_crystal_is_stable_and_its_first_back_stress_below_saturation() -> None:
    assert refused(MaterialTable, C11_GPa=135.5)[0] == "C11_GPa"
    for sign in (-1.0, 1.0):
        assert refused(MaterialTable, x0=sign / 1500.0)[0] == "x0"
        assert MaterialTable(x0=sign * 0.999 / 1500.0).to_material().x0 * sign > 0


@pytest.mark.parametrize("key", ["tau0_MPa", "K", "n", "b", "d2", "tau0_112", "skin_tau0"])
def test_what_divides_or_has_a_logarithm_is_above_zero(key: str) -> None:
    assert refused(MaterialTable, **{key: 0.0})[0] == key


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("a1", 1e30), ("a1", -1.1), ("eigenstrain", 1.0), ("K", 1e300), ("skin_tau0", 1e9),
        ("n", 0.01), ("n", 1e4), ("h_latent", -1e9), ("h_latent", 1e4), ("tau0_MPa", 1e-300),
        ("tau0_MPa", 1e7), ("C44_GPa", 1e5), ("elastic_scale", 1e6), ("tau0_grain1_slope_X", 30.0),
        ("skin_thickness_um", 1e9), ("d2", 1e12), ("b", 1e30), ("Q_MPa", 1e9), ("c2_MPa", 1e12),
    ],
)  # fmt: skip
def test_what_no_specimen_can_carry_is_refused(key: str, value: float) -> None:
    assert refused(MaterialTable, **{key: value})[0] == key


def test_a_back_strain_that_nothing_saturates_is_a_strain() -> None:
    assert refused(MaterialTable, d=0.0, x0=1e30)[0] == "x0"
    assert MaterialTable(d=0.0, x0=0.01).x0 == 0.01


def test_systems_that_never_slip_may_be_stated() -> None:
    assert MaterialTable(tau0_112=1e9).tau0_112 == 1e9


def test_whatever_a_fit_may_find_may_be_stated() -> None:
    """An extended case states what was found."""
    for parameter in MATERIAL_DECLARATIONS:
        key = parameter.key.removeprefix("material.")
        crystal = "bcc48" if parameter.name == "tau0_123" else "bcc"
        for value in (parameter.lower, parameter.upper):
            stated = {"slip_systems": crystal, key: value}
            assert getattr(MaterialTable.model_validate(stated), key) == value


def test_slip_systems_are_those_of_a_crystal_by_name_or_a_table() -> None:
    assert read("").to_material().slip_systems == BCC
    assert read('slip_systems = "fcc"').to_material().slip_systems == FCC
    assert read('slip_systems = "bcc48"').to_material().slip_systems == BCC48
    listed = [[list(plane), list(direction)] for plane, direction in BCC]
    of_own = read(f"slip_systems = {listed}").to_material()
    assert of_own == read("").to_material()
    own = read("slip_systems = [[[1, 1, 1], [0, 1, -1]], [[1, 1, 1], [1, -1, 0]]]")
    assert own.to_material().slip_systems == (((1, 1, 1), (0, 1, -1)), ((1, 1, 1), (1, -1, 0)))


@pytest.mark.parametrize(
    "systems",
    [
        "hcp",
        3,
        [],
        [[[1, 1, 1]]],
        [[[1, 1, 1], [1, 1]]],
        [[[1, 1, 1], [1, 1, 0]]],
        [[[1, 1, 1], [0, 1, -1]], [[1, 1, 1], [0, -1, 1]]],
        [[[1, 1, 1], [0, 0, 0]]],
    ],
    ids=str,
)
def test_what_are_no_slip_systems_is_refused_with_what_would_be(systems: object) -> None:
    key, expected = refused(MaterialTable, slip_systems=systems)
    assert key == "slip_systems" and expected.startswith('"bcc", "bcc48", "fcc", or 1 to 48 ')


@pytest.mark.parametrize("name", sorted(of_other_crystals(FCC)))
def test_what_only_bcc_has_is_refused_of_another_crystal(name: str) -> None:
    key, expected = refused(MaterialTable, slip_systems="fcc", **{name: 0.5})
    assert key == name and "for slip_systems is " in expected
    law = MaterialTable.model_validate({"slip_systems": "bcc48", name: 0.5}).to_material()
    assert getattr(law, name) == 0.5


def test_the_ratio_of_the_systems_123_is_refused_where_there_are_none() -> None:
    key, expected = refused(MaterialTable, tau0_123=0.5)
    assert key == "tau0_123" and expected.endswith('for slip_systems is not "bcc48"')
    assert of_other_crystals(BCC) == {"tau0_123"} and not of_other_crystals(BCC48)


def test_an_interaction_has_a_row_for_each_system() -> None:
    twelve = (np.eye(12) + 0.1).tolist()
    table = MaterialTable.model_validate({"slip_systems": "fcc", "interaction": twelve})
    matrix = interaction_matrix(table.to_material())
    assert np.array_equal(matrix[:12, :12], twelve)
    assert np.array_equal(matrix[12:], np.eye(24)[12:])
    assert refused(MaterialTable, interaction=twelve) == ("interaction", "24 rows of 24 numbers")
    classes = refused(MaterialTable, slip_systems="fcc", interaction=[1, 1.4, 0.7, 0.5])
    assert classes == ("interaction", "12 rows of 12 numbers")
