"""Where configuration and cache lie, with a home and without one."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

import pytest

from solver_adapters.user_folders import cache_folder, can_keep, config_folder


@pytest.fixture
def no_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user without an entry in the table of users; his folder of temporary files."""
    for name in ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "NUMBA_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("os.path.expanduser", lambda path: path)
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    monkeypatch.chdir(tmp_path)
    return temporary


def test_the_folder_that_the_user_names_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert cache_folder(str(tmp_path / "stated")) == tmp_path / "stated"
    assert cache_folder() == tmp_path / "cache" / "prismid"
    (tmp_path / "file").touch()
    assert cache_folder(str(tmp_path / "file")) == tmp_path / "cache" / "prismid"


def test_without_a_home_the_cache_is_a_temporary_folder_of_the_user(no_home: Path) -> None:
    folder = no_home / f"prismid-{os.getuid()}"
    assert cache_folder() == folder
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert not can_keep("matplotlib")
    # A folder “~” beside the case would be somebody else's to fill.
    assert [path.name for path in no_home.parent.iterdir()] == ["tmp"]


def test_the_folder_of_the_call_is_no_cache(no_home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python takes it where no folder of temporary files can be written."""
    monkeypatch.chdir(no_home)
    assert cache_folder() is None and not list(no_home.iterdir())


@pytest.mark.parametrize("what", ["link", "open to others"])
def test_code_is_not_loaded_from_where_others_write(no_home: Path, what: str) -> None:
    place = no_home / f"prismid-{os.getuid()}"
    if what == "link":
        (no_home / "theirs").mkdir()
        place.symlink_to(no_home / "theirs")
    else:
        place.mkdir()
        place.chmod(0o777)
    assert cache_folder() is None


def test_without_a_home_the_configuration_is_that_of_the_machine(no_home: Path) -> None:
    assert config_folder().is_absolute()
    assert not config_folder().is_relative_to(no_home.parent)


def test_a_folder_that_cannot_be_written_is_none(
    no_home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**where: object) -> None:
        raise OSError("read-only")

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    assert cache_folder(str(no_home / "stated")) is None
