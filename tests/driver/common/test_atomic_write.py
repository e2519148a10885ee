"""A file is written whole, in its own place, whatever links lie there."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from driver.common.atomic_write import place_below, refuse_link, write_whole
from driver.common.errors import InputError


@pytest.mark.parametrize("content", ["σ\n", b"\x00\xff"])
def test_a_file_holds_what_was_written_and_nothing_lies_beside_it(
    content: str | bytes, tmp_path: Path
) -> None:
    path = tmp_path / "file"
    path.write_text("before")
    write_whole(path, content)
    assert path.read_bytes() == (content if isinstance(content, bytes) else content.encode())
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left"), KeyboardInterrupt()])
def test_what_was_not_finished_leaves_the_file_as_it_was_and_nothing_beside_it(
    error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*paths: object) -> None:
        raise error

    path = tmp_path / "file"
    path.write_text("before")
    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises(type(error)) as raised:
        write_whole(path, "after")
    assert path.read_text() == "before" and list(tmp_path.iterdir()) == [path]
    assert isinstance(error, KeyboardInterrupt) or str(path) in str(raised.value)


@pytest.mark.parametrize("name", ["file", "file.partial"])
def test_what_a_link_leads_to_stays_as_it_is(name: str, tmp_path: Path) -> None:
    theirs, folder = tmp_path / "theirs", tmp_path / "folder"
    theirs.write_text("theirs")
    folder.mkdir()
    (folder / name).symlink_to(theirs)
    write_whole(folder / "file", "ours")
    assert theirs.read_text() == "theirs"
    assert (folder / "file").read_text() == "ours"
    assert not (folder / "file").is_symlink()


def test_a_link_among_the_folders_of_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "decks").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match=f"^{tmp_path}/decks: file or folder: found a link to "):
        place_below(tmp_path, "decks/bar/job.comm")
    assert place_below(tmp_path, "elsewhere/job.comm") == tmp_path / "elsewhere" / "job.comm"


def test_what_is_no_link_is_not_refused(tmp_path: Path) -> None:
    refuse_link(tmp_path)
    refuse_link(tmp_path / "nothing")
