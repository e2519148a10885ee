from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from driver.case.model import CaseError, default_case, load_case, write_case
from driver.case.toml import read_toml
from driver.common.errors import InputError
from driver.design.settings import read_settings
from driver.virtual.settings import read_virtual

READERS: tuple[Callable[[Path], object], ...] = (load_case, read_settings, read_virtual)


@pytest.mark.parametrize("read", READERS)
def test_a_file_that_cannot_be_read_is_one_sentence(
    read: Callable[[Path], object], tmp_path: Path
) -> None:
    path = tmp_path / "given.toml"

    def be_a_folder() -> None:
        path.unlink()
        path.mkdir()

    def be_a_pipe() -> None:
        path.unlink()
        os.mkfifo(path)

    cases: dict[str, Callable[[], object]] = {
        "found nothing, expected": lambda: None,
        "expected a TOML file in UTF-8": lambda: path.write_bytes(b"\xff = 1"),
        "found a key twice (at line 3, column 6), expected each key once": lambda: path.write_bytes(
            b"[a]\nb = 1\nb = 2\n"
        ),
        "found tables nested too deep, expected a TOML file": lambda: path.write_text(
            f"a = {'[' * 5000}{']' * 5000}"
        ),
        "found no regular file, expected": be_a_pipe,
        "found “Is a directory”, expected a TOML file that can be read": be_a_folder,
    }
    for message, prepare in cases.items():
        prepare()
        with pytest.raises(InputError) as error:
            read(path)
        assert str(error.value).startswith(f"{path}: file: ")
        assert message in str(error.value) and "\n" not in str(error.value)


def test_a_file_with_the_mark_of_windows_editors_is_read(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    write_case(default_case(), path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert load_case(path).model_dump() == default_case().model_dump()


def test_what_is_wrong_with_a_case_is_an_error_of_the_case(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="prismid init DIR"):
        load_case(tmp_path / "absent.toml")


def test_dotted_keys_without_end_are_told_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(".".join(2000 * ["a"]) + " = 1\n")
    with pytest.raises(InputError, match="found tables nested too deep, expected a TOML file$"):
        read_toml(path, "a case")
