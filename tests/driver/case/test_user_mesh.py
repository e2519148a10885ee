"""Cases on a mesh of the user's own: written, read back, and refused in one sentence."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from driver.case.changes import changed_case
from driver.case.file_names import read_from
from driver.case.model import CaseError, case_text, default_case, load_case
from driver.common.errors import InputError
from driver.diagnosis.causes.user_causes import asked_causes
from driver.results.mesh_sizes import sized
from driver.workflow.engine import stage_inputs
from driver.workflow.pipeline import stages
from tests.meshes.gmsh_files import gmsh_prism


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("meshes") / "specimen.med"
    gmsh_prism(path)
    return path


def written(folder: Path, mesh: Path, old: str = "", new: str = "") -> Path:
    """Return a case file beside its mesh, with a change of its text."""
    shutil.copy(mesh, folder / "specimen.med")
    text = case_text(default_case(shape="mesh")).replace("specimen.msh", "specimen.med", 1)
    assert not old or text.count(old) == 1, old
    path = folder / "case.toml"
    path.write_text(text.replace(old, new) if old else text, encoding="utf-8")
    return path


def test_a_case_takes_its_measures_from_its_mesh(tmp_path: Path, mesh: Path) -> None:
    case = load_case(written(tmp_path, mesh, "width_um = 4.0", "width_um = 4.01"))
    specimen = case.specimen
    found = (specimen.length, specimen.width, specimen.depth, case.section)
    assert found == pytest.approx((12.0, 4.0, 12**0.5, 48**0.5), rel=1e-12)
    assert specimen.width_um == 4.01
    changed = changed_case(case, {"material": {"n": 11.0}}, tmp_path / "batch.toml", "one")
    assert changed.specimen.measures == specimen.measures


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("length_um = 12.0", "length_um = 12000.0",
         "found 12 µm along Y, expected specimen.length_um = 12000 in µm: the file seems to be in "
         "mm"),
        ("width_um = 4.0", "width_um = 5.0",
         "found 4 µm along X on TOP, expected specimen.width_um = 5"),
        ("# depth_um = 3.464", "depth_um = 3.0",
         "found 3.4641 µm along Z, expected specimen.depth_um = 3"),
        ('[[grains]]\nname = "grain 2"\neuler_deg = [30.0, 0.0, 0.0]', "",
         "found the groups GRAIN1 to GRAIN2, expected 1 of them, for there are 1 tables "
         "[[grains]]"),
        ('# cells = "hex20"', 'cells = "hex20"',
         'found tet10, expected specimen.cells = "hex20"'),
        ('mesh_size_um = "auto"  # element edge of the working mesh, or "auto": chosen and refined '
         'within execution.budget_min\nfine_mesh_size_um = "auto"',
         "mesh_size_um = 2.0\nfine_mesh_size_um = 1.5",
         "found cells of 2.09 µm, in 1 and 1 pieces of an edge, expected sizes of which the finer "
         "makes 2 pieces or more"),
        ('"specimen.med"', '"another.med"', "found no such file, expected a mesh"),
    ],
)  # fmt: skip
def test_a_mesh_of_another_specimen_or_unit_is_refused_in_one_sentence(
    tmp_path: Path, mesh: Path, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(CaseError) as error:
        load_case(written(tmp_path, mesh, old, new))
    name = "another.med" if "another" in new else "specimen.med"
    assert str(error.value).startswith(f"{tmp_path / name}: specimen.mesh_file: {sentence}")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('mesh_file = "specimen.med"', "",
         "specimen.mesh_file: found nothing, expected a text in quotes, the mesh of the specimen, "
         'for shape = "mesh"'),
        ('shape = "mesh"  #', 'shape = "bar"  #',
         'specimen.mesh_file: found "specimen.med", expected nothing, or shape = "mesh"'),
        ("# boundary_point_um = [0, 6, 0]\n# boundary_normal = [0, 1, 0]",
         "boundary_point_um = [0.0, 6.0, 0.0]\nboundary_normal = [0.0, 1.0, 0.0]",
         "specimen.boundary_point_um: found [0.0, 6.0, 0.0], expected nothing: mesh_file has it"),
        ("[extensions]", "[extensions]\nboundary_shift = 0.1",
         'extensions: found the name "boundary_shift", expected none of a grain boundary: '
         "those of mesh_file and labels stay"),
    ],
)  # fmt: skip
def test_what_a_mesh_has_already_is_refused_in_one_sentence(
    tmp_path: Path, mesh: Path, old: str, new: str, sentence: str
) -> None:
    path = written(tmp_path, mesh, old, new)
    with pytest.raises(CaseError) as error:
        load_case(path)
    assert str(error.value).startswith(f"{path}: {sentence}")


def test_a_case_that_is_written_with_its_sizes_reads_back_as_it_was(
    tmp_path: Path, mesh: Path
) -> None:
    path = written(tmp_path, mesh)
    case = sized(load_case(path), None)
    path.write_text(case_text(case), encoding="utf-8")
    read = load_case(path)
    assert read.model_dump() == case.model_dump()
    assert read.specimen.cell_kind == "tet10"
    assert read.specimen.refined is None


def test_causes_of_a_boundary_are_none_of_a_mesh(tmp_path: Path, mesh: Path) -> None:
    asked = 'causes = ["boundary_tilt", "grain_contrast"]'
    case = load_case(written(tmp_path, mesh, 'causes = "all"', asked))
    with pytest.raises(InputError) as error:
        asked_causes(case)
    assert str(error.value).endswith(
        'diagnosis.causes: found "boundary_tilt", expected no cause of a grain boundary: those of '
        "specimen.mesh_file and labels stay"
    )


def test_a_case_that_is_written_elsewhere_leads_to_its_mesh(tmp_path: Path, mesh: Path) -> None:
    case = load_case(written(tmp_path, mesh))
    (tmp_path / "made").mkdir()
    moved = read_from(case, tmp_path / "made")
    path = tmp_path / "made" / "case.toml"
    path.write_text(case_text(moved), encoding="utf-8")
    assert load_case(path).specimen.measures == case.specimen.measures


def test_a_mesh_that_is_edited_makes_every_stage_stale(tmp_path: Path, mesh: Path) -> None:
    case = load_case(written(tmp_path, mesh))
    before = [stage_inputs(stage, case) for stage in stages(case)[:2]]
    gmsh_prism(tmp_path / "specimen.med", order=1)
    after = [stage_inputs(stage, case) for stage in stages(case)[:2]]
    assert all(one != other for one, other in zip(before, after, strict=True))
