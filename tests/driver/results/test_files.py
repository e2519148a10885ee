from __future__ import annotations

from pathlib import Path

import pytest

from driver.case.model import default_case, load_case, write_case
from driver.common.errors import InputError
from driver.results import files
from driver.results.files import (
    AbsentError,
    edited,
    job_store,
    make_job_store,
    present,
    report_figure,
    results_of,
    surface_frame,
    volume_med,
    volume_vtkhdf,
    working_folder,
)

DOCS = Path(__file__).resolve().parents[3] / "docs"
NAMES = {
    name: value for name, value in vars(files).items() if name.isupper() and isinstance(value, str)
}


def test_the_results_stand_beside_the_case_file(tmp_path: Path) -> None:
    write_case(default_case(), tmp_path / "mine.toml")
    assert results_of(load_case(tmp_path / "mine.toml")) == tmp_path / "results"


def test_jobs_stand_among_the_results_unless_the_case_names_a_store(tmp_path: Path) -> None:
    case = default_case()
    write_case(case, tmp_path / "mine.toml")
    write_case(case.with_values_at({"execution.store": "../all"}), tmp_path / "shared.toml")
    mine, shared = (load_case(tmp_path / name) for name in ("mine.toml", "shared.toml"))
    assert job_store(mine) == tmp_path / "results" / "jobs"
    assert job_store(shared).resolve() == tmp_path.parent / "all"


def test_a_store_is_made_with_the_folders_above_it_and_stays_empty(tmp_path: Path) -> None:
    for _ in range(2):
        make_job_store(tmp_path / "über all" / "jobs", tmp_path / "case.toml")
        assert list((tmp_path / "über all" / "jobs").iterdir()) == []


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("file", '"{folder}/file" (a file or a link to nothing)'),
        ("file/below", '"{folder}/file/below" (“Not a directory”)'),
        ("link", '"{folder}/link" (a file or a link to nothing)'),
        ("nul\0", '"{folder}/nul\\u0000" (“embedded null byte”)'),
        ("/proc/jobs", '"/proc/jobs" (“No such file or directory”)'),
    ],
)
def test_a_store_that_cannot_be_made_is_told_with_its_key(
    name: str, words: str, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to(tmp_path / "nothing" / "there")
    with pytest.raises(InputError) as error:
        make_job_store(tmp_path / name, tmp_path / "case.toml")
    assert str(error.value) == (
        f"{tmp_path / 'case.toml'}: execution.store: found {words.format(folder=tmp_path)}, "
        "expected a folder that can be made and written"
    )


def test_no_two_files_or_folders_have_one_name() -> None:
    assert len(NAMES) > 30 and len(set(NAMES.values())) == len(NAMES)


@pytest.mark.parametrize("name", NAMES.values())
def test_every_name_is_documented(name: str) -> None:
    text = "".join((DOCS / f"{page}.md").read_text("utf-8") for page in ("results", "virtual"))
    assert f"`{name}" in text


def test_names_that_hang_on_something_are_those_of_the_documentation() -> None:
    assert working_folder("mesh") == "mesh.partial"
    assert report_figure("loads") == "report_loads.png"
    assert surface_frame(7) == "surface/surface_0007.vtu"
    assert (volume_vtkhdf("model"), volume_med("extended")) == (
        "volume_model.vtkhdf", "volume_extended.med",
    )  # fmt: skip


def test_an_edited_result_keeps_its_ending_and_the_later_ones_have_a_number() -> None:
    path = Path("results") / "extended.toml"
    assert [edited(path, number).as_posix() for number in range(3)] == [
        "results/extended.edited.toml", "results/extended.edited1.toml",
        "results/extended.edited2.toml",
    ]  # fmt: skip


def test_a_result_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "mesh.med").touch()
    assert present(tmp_path, "mesh.med") == tmp_path / "mesh.med"
    (tmp_path / "measure.h5").mkdir()
    for name in ("measure.h5", "identify.h5"):
        with pytest.raises(AbsentError, match=f"{name}: found nothing, expected the result of an"):
            present(tmp_path, name)
