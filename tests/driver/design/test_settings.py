from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from driver.case.changes import label
from driver.case.grains import Grain
from driver.case.model import Case
from driver.common.errors import InputError
from driver.design.settings import Schedule, Settings, read_change, read_settings
from driver.design.variants import base_variant, usual_changes, variant, variants
from solver_adapters.crystal import bunge_matrix
from tests.driver.ebsd_files import FIRST, grid, write_ctf
from tools import closed_form

DOCS = Path(__file__).resolve().parents[3] / "docs" / "design.md"
BASE = base_variant(closed_form.small_case(), Settings())
SETTINGS = """
[program]
cycles = [[3, 1]]
[truth]
tau0 = 21.0
[test]
repeats = 20
[what_if.quiet.loads]
noise_uN = 0.5
[what_if.quiet.test]
holds = 3.0
"""


def changed(text: str) -> Case:
    return variant(BASE, "it", read_change(text), Path("--change")).case


def test_a_change_is_a_key_of_the_case_with_another_value() -> None:
    case = changed("loads.noise_uN=0.5; dic.element_px = 20")
    assert case.loads.noise_uN == 0.5 and case.dic.element_px == 20
    assert case.images == BASE.case.images


def test_an_entry_of_a_list_is_named_by_its_number() -> None:
    case = changed("grains.2.euler_deg=[1.0, 2.0, 3.0]")
    assert case.grains[0] == BASE.case.grains[0]
    assert case.grains[1].euler_deg == (1.0, 2.0, 3.0)
    assert case.grains[1].name == BASE.case.grains[1].name


def test_a_change_is_told_as_it_can_be_given() -> None:
    for change in (
        {"loads": {"noise_uN": 2.0}, "test": {"holds": 3.5, "stops": 2}},
        {"test": {"compression": True}},
        {"grains": {"2": {"euler_deg": [1.0, 2.5, 3.0], "name": "other"}}},
    ):
        assert read_change(label(change)) == change


def test_the_settings_name_what_is_assumed_and_what_is_compared(tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    file.write_text(SETTINGS, encoding="utf-8")
    found = read_settings(file)
    assert found.program.cycles == ((3, 1),) and found.test.repeats == 20
    (quiet,) = variants(BASE, {}, found.what_if, (), file)
    assert quiet.name == "quiet" and quiet.test.holds == 3.0 and quiet.case.loads.noise_uN == 0.5


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("loads.noise_uN=-1", "--change: loads.noise_uN: found -1, expected a number > 0"),
        ("loads.noise=1", "--change: loads.noise: found an unknown key"),
        ("test.stops=0", "--change: test.stops: found 0, expected a number ≥ 1"),
        ("grains.3.euler_deg=[0.0,0.0,0.0]", "found the entry 3 of a list"),
    ],
)
def test_a_change_that_cannot_be_made_is_refused_in_one_sentence(text: str, sentence: str) -> None:
    with pytest.raises(InputError) as error:
        variant(BASE, "it", read_change(text), Path("--change"))
    assert sentence in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["loads.noise_uN", "", "a = = 2"])
def test_a_change_that_is_no_toml_is_refused_in_one_sentence(text: str) -> None:
    with pytest.raises(InputError, match="--change: found .*expected KEY=VALUE"):
        read_change(text)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[test]\nholds = 0.0", "test.holds: found 0.0, expected a number > 0"),
        ("[tests]\nholds = 1.0", "tests: found an unknown key"),
        ("holds = ", "expected a TOML file"),
    ],
)
def test_bad_settings_are_refused_in_one_sentence(text: str, sentence: str, tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_settings(file)
    assert sentence in str(error.value) and str(error.value).startswith(str(file))


def test_absent_settings_are_refused() -> None:
    with pytest.raises(InputError, match="found nothing, expected the settings of a design"):
        read_settings(Path("nowhere.toml"))


def test_only_what_changes_the_test_or_the_specimen_is_simulated_anew() -> None:
    usual = usual_changes(BASE.case, Schedule(), 10)
    free = {
        name
        for name, change in usual.items()
        if variant(BASE, name, change, Path()).simulated_as(BASE)
    }
    assert free == {
        "two images a stop", "half the load noise", "half the height noise", "twice the repeats",
        "an exact simulation",
    }  # fmt: skip
    assert len(usual) == 9


def test_a_change_that_changes_nothing_is_left_out() -> None:
    same = {"loads": {"noise_uN": BASE.case.loads.noise_uN}}
    assert variants(BASE, {"same": same}, {}, (), Path()) == []


def test_every_key_of_a_test_is_documented_with_its_default() -> None:
    rows = re.findall(r"^\| `test` \| `(\w+)` \| (.*?) \|", DOCS.read_text("utf-8"), re.M)
    expected = {
        name: "—" if field.default is None else json.dumps(field.default)
        for name, field in Schedule.model_fields.items()
    }
    assert dict(rows) == expected


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ('history.file="other.csv"',
         "--change: history: found a change of it, expected one of the test: test.images_per_stop"),
        ('boundary.motion="stage"; boundary.stage_ratio=1e-3; '
         "boundary.stage_ratio_uncertainty=1e-4",
         '--change: boundary.motion: found "stage", expected "images": a design counts on them'),
        ('diagnosis.causes=["magic"]', '--change: diagnosis.causes: found "magic", expected one'),
        ("grains.2.euler_deg=[1.0]", "--change: grains.2.euler_deg: found [1.0], expected a list"),
    ],
)  # fmt: skip
def test_a_change_that_a_design_could_not_follow_is_refused(change: str, found: str) -> None:
    with pytest.raises(InputError) as error:
        changed(change)
    assert str(error.value).startswith(found)


def test_a_grain_of_a_map_is_turned_from_its_mean(tmp_path: Path) -> None:
    x, y = grid(3, 3)
    write_ctf(tmp_path / "a.ctf", x, y, FIRST)
    grain = Grain(name="b", ebsd=str(tmp_path / "a.ctf"), ebsd_point_um=(0.5, 0.5))
    mapped = BASE.case.model_copy(update={"grains": (BASE.case.grains[0], grain)})
    usual = usual_changes(mapped, Schedule(), 10)
    (name,) = (name for name in usual if name.startswith("grain 2 turned by"))
    turned = variant(replace(BASE, case=mapped), name, usual[name], Path()).case.grains[1]
    of_angles = BASE.case.model_copy(
        update={"grains": (BASE.case.grains[0], Grain(name="b", euler_deg=FIRST))}
    )
    by_angles = usual_changes(of_angles, Schedule(), 10)[name]["grains"]["2"]["euler_deg"]
    assert turned.ebsd is None and turned.euler_deg is not None
    np.testing.assert_allclose(bunge_matrix(*turned.euler_deg), bunge_matrix(*by_angles), atol=1e-9)
