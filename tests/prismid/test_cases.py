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
    changed = prismid.load_case(folder).with_values_at({"material.tau0": 30.0})
    for verb in (prismid.run, prismid.check, prismid.report, prismid.read_results):
        with pytest.raises(prismid.InputError, match=r"prismid\.write_case\(case, path\)"):
            verb(changed)  # type: ignore[operator]


def test_an_absent_case_is_told_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(prismid.InputError, match=r"no_case\.toml"):
        prismid.load_case(tmp_path / "no_case.toml")
