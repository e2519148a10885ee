"""Cases of more than two grains: written, read back, refused; those of two grains as they were."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from driver.case.model import Case, CaseError, case_text, default_case, load_case
from driver.workflow.engine import stage_inputs
from driver.workflow.pipeline import stages
from tools.three_grains import BOUNDARIES, three_grains


def refusals(tmp_path: Path, old: str, new: str) -> list[str]:
    text = case_text(three_grains(material={"tau0_grains": [1.3]}))
    assert text.count(old) == 1, old
    path = tmp_path / "case.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(CaseError) as error:
        load_case(path)
    return str(error.value).splitlines()


def test_a_written_case_of_three_grains_reads_back_as_it_was(tmp_path: Path) -> None:
    case = three_grains(material={"tau0_grains": [1.3]}, extensions={"boundary2_shift": 0.1})
    path = tmp_path / "case.toml"
    path.write_text(case_text(case), encoding="utf-8")
    read = load_case(path)
    assert read.model_dump() == case.model_dump()
    first, second = read.specimen.planes
    assert (first.point, second.normal) == (BOUNDARIES[0]["point_um"], BOUNDARIES[1]["normal"])
    assert read.material.to_material().tau0_grains == (1.3,)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("[0.0, 8.2, 0.0]", "[0.0, 4.5, 0.0]",
         "specimen.boundaries.2: found a plane that crosses or touches boundary 1 inside the "
         "specimen, expected 0.04 µm or more of grain 2 between them"),
        ("[0.0, 8.2, 0.0]", "[0.0, 11.9, 0.0]", "specimen.boundaries.2: found a plane through "
         "(0.0, 11.9, 0.0) that meets an end face, expected one that crosses from side to side"),
        ("[0.0, 8.2, 0.0]", "[0.0, 1.0, 0.0]", "specimen.boundaries.2: found a plane on the side "
         "of grain 1 of boundary 1, expected boundaries in the order of the grains"),
        ("[-0.15, 1.0, 0.1]", "[0.0, -1.0, 0.0]", "specimen.boundaries.2: found the normal "
         "(0.0, -1.0, 0.0), against that of boundary 1 along Y, expected normals that all point "
         "from one grain to the next"),
        ("[-0.15, 1.0, 0.1]", "[0.0, 0.0, 0.0]", "specimen.boundaries.2.normal: found "
         "[0.0, 0.0, 0.0], expected a normal other than zero"),
        ("normal = [-0.15, 1.0, 0.1]", "", "specimen.boundaries.2.normal: found nothing, expected "
         "a list of three numbers, the normal that points into the grain of the larger number"),
        ('[[grains]]\nname = "right"\neuler_deg = [30.0, 20.0, 10.0]', "",
         "grains: found 2 of them, expected 3, for there are 2 tables [[specimen.boundaries]]"),
        ('name = "right"', 'name = "left"',
         'grains.3.name: found "left", expected a name of its own, for grains.1 has it'),
        ("tau0_grains = [1.3]", "tau0_grains = [1.3, 1.2]", "material.tau0_grains: found 2 ratios, "
         "expected at most 1, one for each grain after the second"),
        ("# boundary_point_um = [0, 6, 0]\n# boundary_normal = [0, 1, 0]",
         "boundary_point_um = [0.0, 6.0, 0.0]\nboundary_normal = [0.0, 1.0, 0.0]",
         "specimen.boundaries: found both, expected one of boundaries and boundary_point_um"),
        ("[extensions]", "[extensions]\nboundary_shift = 0.1",
         'extensions: found the name "boundary_shift", expected boundary2_shift or '),
    ],
)  # fmt: skip
def test_what_does_not_part_a_row_of_grains_is_refused_in_one_sentence(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    (found,) = refusals(tmp_path, old, new)
    assert found.startswith(f"{tmp_path / 'case.toml'}: {sentence}")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"boundaries": ()}, "one table [[grains]], or 2 tables [[specimen.boundaries]]"),
        ({"boundaries": (), "boundary_point_um": (0.0, 6.0, 0.0),
          "boundary_normal": (0.0, 1.0, 0.0)}, "two tables [[grains]], for "
         "specimen.boundary_point_um is given, or 2 tables [[specimen.boundaries]] in its place"),
    ],
)  # fmt: skip
def test_three_grains_need_two_boundaries(change: dict[str, Any], expected: str) -> None:
    with pytest.raises(ValueError) as error:
        three_grains(specimen=change)
    (details,) = error.value.errors()  # type: ignore[attr-defined]
    assert details["ctx"]["expected"] == expected


def test_one_table_of_a_boundary_is_the_pair_of_keys_of_two_grains() -> None:
    pair = default_case()
    plane = {"point_um": pair.specimen.boundary_point_um, "normal": pair.specimen.boundary_normal}
    data = pair.model_dump(mode="json")
    keys = {"boundary_point_um": None, "boundary_normal": None, "boundaries": [plane]}
    data["specimen"] |= keys
    assert Case.model_validate(data).specimen.planes == pair.specimen.planes


def test_keys_of_more_grains_leave_the_results_of_two_as_they_are() -> None:
    """A stage reads neither key where it stands at its default, and both where it does not."""
    two, three = default_case(), three_grains(material={"tau0_grains": [1.3]})
    for key, table in (("boundaries", "specimen"), ("tau0_grains", "material")):
        assert key in type(getattr(two, table)).added
        assert not getattr(two, table).model_dump(exclude_defaults=True).get(key)
    plain = three_grains(material={"tau0_grains": [1.2]})
    mesh, *_, identify = [stage for stage in stages(three) if stage.name in ("mesh", "identify")]
    assert stage_inputs(mesh, three) == stage_inputs(mesh, plain)
    assert stage_inputs(identify, three) != stage_inputs(identify, plain)
