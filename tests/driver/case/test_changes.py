from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from driver.case.changes import changed_case, merged
from driver.case.grains import Grain
from driver.common.errors import InputError
from tools import closed_form

CASE = closed_form.small_case()


def test_tables_are_merged_key_by_key() -> None:
    whole: Any = {"a": {"b": 1, "c": 2}, "d": [{"e": 1}, {"e": 2}]}
    assert merged(whole, {"a": {"b": 3}}) == {"a": {"b": 3, "c": 2}, "d": whole["d"]}
    assert merged(whole, {"d": {"2": {"e": 5}}})["d"] == [{"e": 1}, {"e": 5}]
    assert merged(whole, {"d": []})["d"] == []


def test_a_changed_case_stands_where_it_stood_with_other_values() -> None:
    change = {"loads": {"noise_uN": 2.5}, "grains": {"2": {"euler_deg": [1.0, 2.0, 3.0]}}}
    case = changed_case(CASE, change, Path("campaign.toml"), "a")
    assert case.file == CASE.file and case.loads.noise_uN == 2.5
    assert case.grains[1].euler_deg == (1.0, 2.0, 3.0)
    assert case.specimen == CASE.specimen


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"loads": {"noise_uN": -1.0}},
            "c.toml: loads.noise_uN: found -1.0, expected a number > 0",
        ),
        ({"grains": {"3": {"name": "x"}}}, "c.toml: a: found the entry 3 of a list"),
        ({"lods": {}}, "c.toml: lods: found an unknown key"),
    ],
)
def test_a_change_that_cannot_be_made_is_told_with_its_key(
    change: dict[str, Any], said: str
) -> None:
    with pytest.raises(InputError) as error:
        changed_case(CASE, change, Path("c.toml"), "a")
    assert str(error.value).startswith(said)


def test_angles_that_are_stated_take_the_place_of_a_map_and_the_other_way_round() -> None:
    mapped = {"ebsd": "a.ang", "ebsd_point_um": [1.0, 2.0]}
    of_map = changed_case(CASE, {"grains": {"2": mapped}}, Path("c.toml"), "a")
    assert of_map.grains[1] == Grain(name="grain 2", ebsd="a.ang", ebsd_point_um=(1.0, 2.0))
    assert of_map.grains[0] == CASE.grains[0]
    for change, expected in (
        ({"euler_deg": [1.0, 2.0, 3.0]}, {"euler_deg": (1.0, 2.0, 3.0)}),
        ({"ebsd_grain": 3}, {"ebsd": "a.ang", "ebsd_grain": 3}),
        ({"ebsd": "b.ang"}, {"ebsd": "b.ang", "ebsd_point_um": (1.0, 2.0)}),
    ):
        again = changed_case(of_map, {"grains": {"2": change}}, Path("c.toml"), "a")
        assert again.grains[1] == Grain.model_validate({"name": "grain 2"} | expected)
    both = {"grains": {"2": {"euler_deg": [1.0, 2.0, 3.0], "ebsd": "a.ang"}}}
    with pytest.raises(InputError, match="found both, expected one of euler_deg and ebsd"):
        changed_case(CASE, both, Path("c.toml"), "a")
