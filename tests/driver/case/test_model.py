import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from pydantic import Field

from driver.case.material import MaterialTable
from driver.case.model import (
    Case,
    CaseError,
    case_text,
    default_case,
    load_case,
    schema,
    write_case,
)
from driver.case.solver import ProfileTable
from solver_adapters.material import Material
from tests.driver.stated_sizes import stated_case

ALPHA = Path(__file__).parents[3] / "examples" / "alpha" / "case.toml"

_A_ROW_FOR_EACH = (
    "a row of numbers for each slip system, or for bcc the four numbers [H1, H2, H3, H4]"
)


def write(tmp_path: Path, *changes: tuple[str, str]) -> Path:
    """The default case with some of its text replaced."""
    text = case_text(default_case())
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = tmp_path / "case.toml"
    path.write_text(text, encoding="utf-8")
    return path


def refused(tmp_path: Path, *changes: tuple[str, str]) -> list[str]:
    path = write(tmp_path, *changes)
    with pytest.raises(CaseError) as error:
        load_case(path)
    return str(error.value).splitlines()


@pytest.mark.parametrize(
    ("old", "new", "key", "found", "expected"),
    [
        ("pixel_size_nm = 110.0", "pixel_size_nm = -3", "images.pixel_size_nm", "-3", "> 0"),
        ("width_um = 4.0", 'width_um = "4"', "specimen.width_um", '"4"', "a number"),
        ("length_um = 12.0", "lenght_um = 12.0", "specimen.lenght_um", "an unknown key",
         "one of shape, length_um, width_um"),
        ('frames = "images.tif"', "", "images.frames", "nothing", "a text in quotes"),
        ('flats = "flats.tif"', 'flats = ""', "images.flats", '""', "images of a flat reference"),
        ("euler_deg = [30.0, 0.0, 0.0]", "euler_deg = [30.0, 0.0]", "grains.2.euler_deg",
         "[30.0, 0.0]", "a list of three numbers"),
        ('name = "grain 2"', 'name = "grain 1 "', "grains.2.name", '"grain 1 "',
         "a name of its own, for grains.1 has it"),
        ('strain_measure = "finite"', 'strain_measure = "large"', "material.strain_measure",
         '"large"', '"small" or "finite"'),
        ('rows_along = "+X"', 'rows_along = "-X"', "images.rows_along",
         "rows -X, columns +Y, heights +Z", "a left-handed one mirrors the crystal"),
        ("[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
         "[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]",
         "orientation.ebsd_to_specimen", "[[1.0, 0.0, 0.0]", "determinant +1"),
        ("[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
         "[[1.0, 0.2, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
         "orientation.ebsd_to_specimen", "[[1.0, 0.2, 0.0]", "orthonormal rows"),
        ("boundary_normal = [0.0, 1.0, 0.0]", "", "specimen.boundary_normal", "nothing",
         "three numbers"),
        ("boundary_normal = [0.0, 1.0, 0.0]", "boundary_normal = [0, 0, 0]",
         "specimen.boundary_normal", "[0, 0, 0]", "other than zero"),
        ('\nmesh_size_um = "auto"', "\nmesh_size_um = -2.0", "specimen.mesh_size_um",
         "-2.0", 'a number > 0, the edge of the elements of the working mesh, or "auto"'),
        ('\nmesh_size_um = "auto"', "\nmesh_size_um = 2.0", "specimen.fine_mesh_size_um",
         '"auto"', 'a number, or mesh_size_um = "auto" as well'),
        ('fine_mesh_size_um = "auto"', "fine_mesh_size_um = 1.0", "specimen.mesh_size_um",
         '"auto"', 'a number, or fine_mesh_size_um = "auto" as well'),
        ('parameters = ["tau0", "c", "d"]', 'parameters = ["tau_0"]',
         "identification.parameters", '"tau_0"', "tau0 or tau0_123 or tau0_112, or another of the"),
        ('parameters = ["tau0", "c", "d"]', 'parameters = ["C11"]',
         "identification.parameters", '"C11"', "one of tau0, c, d, K"),
        ("[extensions]", "[extensions]\ntau0_gr2 = 1.0", "extensions", 'the name "tau0_gr2"',
         "tau0_grain2 or tau0_112 or tau0_grain2_band, or another"),
        ("[extensions]", '[extensions]\ntau0_grain2 = "1"', "extensions.tau0_grain2", '"1"',
         "a number (starts of parameters"),
        ("# interaction = [1, 1, 1, 1]", "interaction = [1, 1.4, 1]", "material.interaction",
         "[1, 1.4, 1]", _A_ROW_FOR_EACH),
        ("# interaction = [1, 1, 1, 1]", 'interaction = "BCC24"', "material.interaction",
         '"BCC24"', _A_ROW_FOR_EACH),
        ("# interaction = [1, 1, 1, 1]", "interaction = [1, 1, 1, nan]", "material.interaction",
         "[1, 1, 1, NaN]", _A_ROW_FOR_EACH),
        ("# interaction = [1, 1, 1, 1]", f"interaction = {[[1.0] * 24] * 23}",
         "material.interaction", "23 rows, row 1 of 24 numbers", _A_ROW_FOR_EACH),
        ("# interaction = [1, 1, 1, 1]", f"interaction = {[[1.0] * 24] * 23 + [[1.0, 2.0]]}",
         "material.interaction", "24 rows, row 24 of 2 numbers", _A_ROW_FOR_EACH),
        ("d2 = 150.0", "d2 = 0", "material.d2", "0", "> 0"),
        ("tau0_antitwinning = 1.0", "tau0_antitwinning = -1", "material.tau0_antitwinning", "-1",
         "≥ 1e-06"),
        ("c2_MPa = 0.0", "c2_MPa = -1", "material.c2_MPa", "-1", "≥ 0"),
        ("x0 = 0.0", "x0 = -0.001", "material.x0", "-0.001", "smaller in size than 1/d = 0.000666"),
        ("c_MPa = 40000.0", "c_MPa = 0", "material", "c = 0",
         "a start from 1 to 1e+07, for c is identified"),
        ("[extensions]", "[extensions]\ntau0 = 40.0", "extensions", 'the name "tau0"',
         "a parameter that is not fitted in any case"),
        ("[extensions]", "[extensions]\nelongation_1 = 0.1", "extensions",
         'the name "elongation_1"', "one of K, n"),
        ("[extensions]", "[extensions]\nboundary_tilt_x = -3", "extensions",
         "boundary_tilt_x = -3", "a number from -1 to 1"),
        ("# tau0 = 1.0", "n = 1.0", "identification.prior_width", 'the name "n"',
         "one of tau0, c, d"),
        ('prior = "gaussian"', 'prior = "tikhonov"', "identification.lambda_star", "nothing",
         'a number above 0 with prior = "tikhonov"'),
        ("# lambda_star = 1e-06", "lambda_star = 1e-6", "identification.lambda_star", "1e-06",
         'nothing with prior = "gaussian"'),
        ('order = "joint"', 'order = "both"', "identification.order", '"both"',
         '"joint" or "paper"'),
        ('parameters = ["tau0", "c", "d"]', 'parameters = ["tau0", "c", "tau0"]',
         "identification.parameters", '"tau0" 2 times', "each name once"),
        ('causes = "all"', "causes = []", "diagnosis.causes", "[]", "at least one name"),
        ("starts = 1", "starts = 0", "identification.starts", "0", "≥ 1"),
        ("jitter_nm = 0.0", "jitter_nm = -1", "boundary.jitter_nm", "-1", "≥ 0"),
        ('held_out_cycle = "last"', "held_out_cycle = 1.5", "diagnosis.held_out_cycle", "1.5",
         '"last", "none" or the number of a cycle'),
        ("max_iterations = 12", "max_iterations = 9223372036854775808",
         "identification.max_iterations", "9223372036854775808", "a number ≤ 100000"),
        ("processes = 2", "processes = 1000000",
         "execution.processes", "1000000", "a number ≤ 4096"),
        ("jitter_nm = 0.0", "jitter_nm = 1e9", "boundary.jitter_nm", "1e+09",
         "a number below the length of the specimen, 12000 nm"),
        ("[identification]\n", '[solver.profiles.bar]\nmemory_MB = -1\n[identification]\n',
         "solver.profiles.bar.memory_MB", "-1", "a number > 0 (memory limit of a job)"),
        ("[identification]\n", '[solver.profiles.bar]\ncommand = []\n[identification]\n',
         "solver.profiles.bar.command", "[]", "a list of texts"),
        ("[identification]\n", '[solver.profiles.bar]\nmemory = 4\n[identification]\n',
         "solver.profiles.bar.memory", "an unknown key", "one of command, processes, threads"),
        ("refit = 5", "refit = 2.5", "diagnosis.refit", "2.5", "a whole number"),
        ("autocorrelation = 0.0", "autocorrelation = 1.0", "loads.autocorrelation", "1.0", "< 1"),
        ("left_out = []", "left_out = [3, -1]", "loads.left_out", "[3, -1]", "a number ≥ 0"),
        ("left_out = []", "left_out = [3, 7, 3]", "loads.left_out", "3 2 times",
         "each number once"),
        ("left_out = []", "left_out = 3", "loads.left_out", "3", "a list of whole numbers"),
        ("noise_uN = 5.97", "noise_uN = nan", "loads.noise_uN", "NaN", "a finite number"),
        ("C12_GPa = 135.5", "C12_GPa = 300", "material.C11_GPa", "233.5", "> C12_GPa = 300"),
        ("C12_GPa = 135.5", "C12_GPa = -135.5", "material.C11_GPa", "233.5", "> -2 C12_GPa = 271"),
        ("C11_GPa = 233.5", "C11_GPa = -1", "material.C11_GPa", "-1", "> C12_GPa = 135.5"),
        ("\nn = 10.0", "\nn = 0.5", "material.n", "0.5", "a number ≥ 1 (rate exponent)"),
        ("h_latent = 0.0", "h_latent = -1.1", "material.h_latent", "-1.1", "≥ -1"),
        ("\nb = 30.0", "\nb = 0", "material.b", "0", "> 0"),
    ],
)  # fmt: skip
def test_a_wrong_value_is_named_with_file_key_found_and_expected(
    tmp_path: Path, old: str, new: str, key: str, found: str, expected: str
) -> None:
    lines = refused(tmp_path, (old, new))
    assert len(lines) == 1
    assert lines[0].startswith(f"{tmp_path / 'case.toml'}: {key}: found {found}")
    assert expected in lines[0].split(", expected ", 1)[1]


def test_each_of_several_errors_has_its_line(tmp_path: Path) -> None:
    lines = refused(tmp_path, ("width_um = 4.0", "width_um = 0"), ("refit = 5", "refit = 0"))
    assert [line.split(": ")[1] for line in lines] == ["specimen.width_um", "diagnosis.refit"]


def test_a_fixed_pattern_without_flats_is_refused(tmp_path: Path) -> None:
    write(tmp_path, ("[extensions]", "[extensions]\nfixed_pattern = 0.1"))
    path = tmp_path / "case.toml"
    text = "\n".join(x for x in path.read_text("utf-8").splitlines() if "flats" not in x)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CaseError, match=r"fixed_pattern = 0\.1.*images\.flats as well"):
        load_case(path)


def test_two_grains_without_a_boundary_are_refused(tmp_path: Path) -> None:
    (line,) = refused(
        tmp_path,
        ("boundary_point_um = [0.0, 6.0, 0.0]\n", ""),
        ("boundary_normal = [0.0, 1.0, 0.0]\n", ""),
    )
    assert ": grains: found 2 of them, expected one table [[grains]], or specimen.boundary" in line


def test_a_missing_file_and_a_broken_one_are_named(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="nowhere.toml: file: found nothing, expected a case file"):
        load_case(tmp_path / "nowhere.toml")
    (line,) = refused(tmp_path, ("[loads]", "[loads"))
    assert "at line" in line and line.endswith("expected a TOML file in UTF-8")


def test_the_written_case_reads_back_equal(tmp_path: Path) -> None:
    case = default_case().model_copy(
        update={"sections": default_case().sections.model_copy(update={"specimen_um2": 5.15})}
    )
    path = tmp_path / "case.toml"
    path.write_text(case_text(case), encoding="utf-8")
    assert load_case(path).model_dump() == case.model_dump()


def test_written_profiles_read_back_equal(tmp_path: Path) -> None:
    profiles = {
        "code_aster": ProfileTable(command=("run_aster",), memory_MB=8000.0, wall_time_s=60.0),
        "my solver": ProfileTable(threads=2, command=("solve", "a b", 'say "x"')),
    }
    case = default_case()
    solver = case.solver.model_copy(update={"profiles": profiles})
    case = case.model_copy(update={"solver": solver})
    path = tmp_path / "case.toml"
    path.write_text(case_text(case), encoding="utf-8")
    assert load_case(path).model_dump() == case.model_dump()


@pytest.mark.parametrize(
    "interaction",
    [(1.0, 1.4, 1.0, 0.5), tuple(tuple(row) for row in np.where(np.eye(24) == 1, 1.0, 1.4))],
)
def test_a_written_interaction_reads_back_equal(
    tmp_path: Path, interaction: tuple[float, ...] | tuple[tuple[float, ...], ...]
) -> None:
    case = default_case()
    material = case.material.model_copy(update={"interaction": interaction})
    case = case.model_copy(update={"material": material})
    path = tmp_path / "case.toml"
    path.write_text(case_text(case), encoding="utf-8")
    assert load_case(path).material == material


def test_values_are_read_and_changed_at_dotted_keys() -> None:
    case = default_case()
    changed = case.with_values_at({"boundary.lambda_start.plus_Y": 0.8, "material.tau0_MPa": 21.0})
    assert changed.boundary.lambda_start.plus_Y == changed.value_at("boundary.lambda_start.plus_Y")
    assert (changed.boundary.lambda_start.plus_Y, changed.material.tau0_MPa) == (0.8, 21.0)
    back = {
        key: case.value_at(key) for key in ("boundary.lambda_start.plus_Y", "material.tau0_MPa")
    }
    assert changed.with_values_at(back) == case and changed.file == case.file


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("material.Tau0_MPa", "tau0_MPa"),
        ("materials.tau0_MPa", "material"),
        ("material.tau0_MPa.x", "tau0_MPa as a whole"),
        ("grains.2.euler_deg", "grains as a whole"),
    ],
)
def test_a_value_at_a_key_that_there_is_not_is_refused(key: str, expected: str) -> None:
    with pytest.raises(CaseError, match=f"{key}: found no such key, expected.*{expected}"):
        default_case().with_values_at({key: 10.0})


def test_a_case_that_cannot_be_written_is_told_in_a_sentence(tmp_path: Path) -> None:
    write_case(default_case(), str(tmp_path / "case.toml"))
    assert case_text(load_case(tmp_path / "case.toml")) == case_text(default_case())
    absent = tmp_path / "absent" / "case.toml"
    with pytest.raises(CaseError, match=f"{absent}: file: found .*, expected a file that can be"):
        write_case(default_case(), absent)


def test_every_key_stands_in_the_written_case() -> None:
    text, document = case_text(default_case()), schema()
    tables = {**document["properties"], **document["$defs"]}
    keys = {key for table in document["$defs"].values() for key in table.get("properties", {})}
    assert len(keys) > 50 and tables
    missing = [key for key in keys if not any(f"{key}{mark}" in text for mark in (" = ", "]", "."))]
    assert missing == []


def test_a_constant_that_the_law_gains_is_written_with_its_description() -> None:
    class Law(MaterialTable):
        gained: float = Field(default=0.25, description="a term to come")

    class Longer(Case):
        material: Law = Law()

    gained = Longer(**default_case().model_dump(exclude={"material"}))
    assert "\ngained = 0.25  # a term to come\n" in case_text(gained)


def test_every_constant_of_the_law_stands_once_in_the_written_case() -> None:
    law = case_text(default_case()).split("[material]\n")[1].split("\n[")[0]
    written = re.findall(r"^(?:# )?(\w+) = ", law, re.MULTILINE)
    assert sorted(written) == sorted(MaterialTable.model_fields)


def test_the_schema_refuses_unknown_keys_and_is_named_by_the_case() -> None:
    assert case_text(default_case()).splitlines()[0] == "#:schema ./case.schema.json"
    assert schema()["additionalProperties"] is False
    assert schema()["$defs"]["Grain"]["required"] == ["name"]


def test_the_schema_beside_the_example_is_that_of_the_model() -> None:
    assert json.loads((ALPHA.parent / "case.schema.json").read_text("utf-8")) == schema()


def test_units_of_the_border_become_internal_units() -> None:
    case = load_case(ALPHA)
    assert case.material.to_material() == Material(strain_measure="small")
    assert case.images.pixel_um == pytest.approx(0.110)
    assert case.images.level_um == pytest.approx(0.0065)
    assert case.images.gamma_f == pytest.approx(0.009)
    # 4√3 µm² on 3 mm²: 2.31 µN a newton
    assert case.force_scale == pytest.approx(4 * 3**0.5 / 3)
    assert case.specimen.depth == pytest.approx(2 * 3**0.5)


def test_paths_are_relative_to_the_case_file() -> None:
    case = load_case(ALPHA)
    assert case.images.frames is not None
    assert case.path(case.images.frames) == ALPHA.parent / "images.tif"


def test_the_example_states_what_its_readme_states() -> None:
    values = tomllib.loads(ALPHA.read_text("utf-8"))
    assert [grain["euler_deg"] for grain in values["grains"]] == [[281, 8, 47], [211, 45, 150]]
    assert values["specimen"]["boundary_point_um"] == [0, 5.4, 0]
    assert values["specimen"]["boundary_normal"] == [0.15, 1, 0.3]


@pytest.mark.parametrize(
    ("size", "fine", "expected"),
    [
        ("2.0", "1.9", "a size with more than 1 cells along half of the longest side of the "),
        ("2.0", "1.4", "a size with more than 1 cells along half of the longest side of the "),
        ("1.0", "0.75", "a number ≤ 0.7, 0.7 of mesh_size_um, with hexahedra"),
    ],
)
def test_two_sizes_of_hexahedra_that_tell_nothing_of_the_error_are_refused(
    tmp_path: Path, size: str, fine: str, expected: str
) -> None:
    text = case_text(stated_case())
    text = text.replace("\nmesh_size_um = 2.0", f"\nmesh_size_um = {size}")
    text = text.replace("fine_mesh_size_um = 1.0", f"fine_mesh_size_um = {fine}")
    path = tmp_path / "case.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CaseError) as refused:
        load_case(path)
    assert f"specimen.fine_mesh_size_um: found {fine}, expected {expected}" in str(refused.value)
