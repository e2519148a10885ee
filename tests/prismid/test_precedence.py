"""A user's own files may have the names of the packages that prismid is made of."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from prismid.precedence import PACKAGES

ROOT = Path(__file__).resolve().parents[2]

ALONE = """
import prismid
print(prismid.loaded_along((0, 1, 0)).shape)
"""
SIDE_BY_SIDE = """
import prismid

if __name__ == "__main__":
    from driver.common.parallel import side_by_side
    print(side_by_side(len, ["a", "bc"], 2))
"""
IMPORTED_BEFORE = """
import driver
import prismid
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in PACKAGES:
        (tmp_path / f"{name}.py").write_text("print('the user')\n", encoding="utf-8")
    return tmp_path


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    environment.pop("PYTHONSAFEPATH", None)
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True
    )


def test_a_call_in_a_folder_with_a_driver_of_its_own_takes_that_of_prismid(folder: Path) -> None:
    done = run(folder, "-c", ALONE)
    assert (done.stdout, done.stderr) == ("(3, 3)\n", "")


def test_processes_that_a_script_starts_take_that_of_prismid_as_well(folder: Path) -> None:
    (folder / "script.py").write_text(SIDE_BY_SIDE, encoding="utf-8")
    done = run(folder, "script.py")
    assert (done.stdout, done.stderr) == ("[1, 2]\n", "")


def test_a_driver_that_is_imported_already_is_told_in_a_sentence(folder: Path) -> None:
    done = run(folder, "-c", IMPORTED_BEFORE)
    said = done.stderr.splitlines()[-1]
    assert said.startswith(f"ImportError: driver: found {folder.resolve() / 'driver.py'}, which is")
    assert "give your own another name, or import prismid before it" in said


def test_the_import_alone_loads_no_package(folder: Path) -> None:
    names = ", ".join(repr(name) for name in (*PACKAGES, "numpy", "xarray"))
    done = run(folder, "-c", f"import sys, prismid; print({{{names}}} & set(sys.modules))")
    assert (done.stdout, done.stderr) == ("set()\n", "")


def test_the_path_stays_as_it_is_where_nothing_hides_the_packages(tmp_path: Path) -> None:
    # A folder without an __init__.py, as of templates of reports, hides no package.
    (tmp_path / "templates").mkdir()
    code = "import sys; before = list(sys.path); import prismid; print(sys.path == before)"
    done = run(tmp_path, "-c", code)
    assert (done.stdout, done.stderr) == ("True\n", "")
