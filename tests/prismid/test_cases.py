from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import prismid
from prismid.cases import file_of

ALPHA = Path(__file__).resolve().parents[2] / "examples" / "alpha"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(ALPHA / "case.toml", tmp_path / "case.toml")
    return tmp_path


def test_a_case_is_named_by_its_file_its_folder_or_itself(folder: Path) -> None:
    path = folder / "case.toml"
    case = prismid.load_case(path)
    assert prismid.load_case(str(folder)) == case == prismid.load_case(folder)
    for named in (case, path, str(path), folder):
        assert file_of(named) == path


def test_stages_refuse_a_case_that_is_not_that_of_its_file(folder: Path) -> None:
    changed = prismid.changed(folder, {"material.tau0_MPa": 30.0})
    for verb in (prismid.run, prismid.check, prismid.report, prismid.read_results):
        with pytest.raises(prismid.InputError, match=r"prismid\.write_case\(case, path\)"):
            verb(changed)


def test_a_changed_case_is_that_of_a_file_with_these_values(folder: Path) -> None:
    path = folder / "case.toml"
    values = {"material.tau0_MPa": 30.0, "boundary.lambda_start.plus_Y": 0.9, "solver.name": "x"}
    changed = prismid.changed(folder, values)
    assert prismid.changed(folder, {}) == prismid.load_case(folder)
    text = path.read_text("utf-8")
    for old, new in (("tau0_MPa = 40.0", "tau0_MPa = 30.0"), ("plus_Y = 1.0", "plus_Y = 0.9"),
                     ('name = "bundled"', 'name = "x"')):  # fmt: skip
        assert text.count(old) == 1
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    assert prismid.load_case(folder) == changed


def test_an_entry_of_a_list_is_changed_by_its_number_from_1(folder: Path) -> None:
    before = prismid.load_case(folder)
    changed = prismid.changed(folder, {"grains.2.euler_deg": [10.0, 20.0, 30.0]})
    assert changed.grains[1].euler_deg == (10.0, 20.0, 30.0)
    assert changed.grains[0] == before.grains[0]


def test_a_value_takes_the_place_of_a_whole_table(folder: Path) -> None:
    freed = prismid.changed(folder, {"extensions": {"tau0_grain2": 1.1}})
    other = prismid.changed(freed, {"extensions": {"load_gain": 0.01}})
    assert other.extensions == {"load_gain": 0.01}
    assert prismid.changed(freed, {"extensions": {}}).extensions == {}


def test_angles_that_are_stated_take_the_place_of_a_map(folder: Path) -> None:
    text = (folder / "case.toml").read_text("utf-8")
    before = prismid.load_case(folder)
    (folder / "map.ang").write_text("", encoding="utf-8")
    mapped = prismid.changed(folder, {"grains.1.ebsd": "map.ang"})
    assert text and mapped.grains[0].ebsd == "map.ang" and mapped.grains[0].euler_deg is None
    back = prismid.changed(mapped, {"grains.1.euler_deg": before.grains[0].euler_deg})
    assert back.grains[0] == before.grains[0]


def test_the_folder_of_the_results_is_that_of_a_case_however_it_is_named(folder: Path) -> None:
    results = folder / "results"
    for named in (prismid.load_case(folder), folder, str(folder / "case.toml")):
        assert prismid.results_of(named) == results


@pytest.mark.parametrize(("values", "said"), [
    ({"material.tau0": 30.0}, r"case\.toml: material\.tau0: "),
    ({"material.tau0_MPa": -1.0}, r"case\.toml: material\.tau0_MPa: found -1\.0, expected "),
    ({"materials.tau0_MPa": 1.0}, r"materials\.tau0_MPa: found the table materials, expected mat"),
    ({"grains.3.name": "x"}, r"grains\.3\.name: found the entry 3 of a list, expected one of its"),
    ({"material.tau0_MPa.x": 1.0}, r"tau0_MPa\.x: found no table tau0_MPa, expected"),
    ({"grains.2": {}, "grains.2.name": "x"}, r"grains\.2\.name: found grains\.2 beside it"),
    ({"grains.name": "x"}, r"grains\.name: found the entry name of a list, expected one of"),
])  # fmt: skip
def test_a_change_that_no_file_could_state_is_refused(
    folder: Path, values: dict[str, object], said: str
) -> None:
    with pytest.raises(prismid.InputError, match=said):
        prismid.changed(folder, values)


def test_an_absent_case_is_told_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(prismid.InputError, match=r"no_case\.toml"):
        prismid.load_case(tmp_path / "no_case.toml")
