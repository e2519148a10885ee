"""What makes the solver another one, so that its checkpoints and answers are not mixed."""

from __future__ import annotations

import ast
import shutil
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from solver_adapters.bundled.identity import BESIDE, LIBRARIES, solver_hash
from solver_adapters.kernels import PACKAGES

FOLDERS = ("solver_adapters", "meshes")


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    for folder in FOLDERS:
        for source in (PACKAGES / folder).rglob("*.py"):
            target = tmp_path / source.relative_to(PACKAGES)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
    assert solver_hash(tmp_path) == solver_hash()
    return tmp_path


@pytest.mark.parametrize(
    "name",
    [
        "solver_adapters/bundled/stepping.py",
        "solver_adapters/bundled/law/slip.py",
        "solver_adapters/constants.py",
        "meshes/hex20.py",
    ],
)
def test_a_change_of_its_sources_makes_another_solver(name: str, copied: Path) -> None:
    (copied / name).write_text((copied / name).read_text() + "\nX = 1\n")
    assert solver_hash(copied) != solver_hash()


def test_a_new_module_makes_another_solver(copied: Path) -> None:
    (copied / "solver_adapters/bundled/zeta.py").write_text("X = 1\n")
    assert solver_hash(copied) != solver_hash()


@pytest.mark.parametrize("name", ["solver_adapters/interaction.py", "meshes/surface.py"])
def test_what_it_does_not_use_leaves_it_the_same(name: str, copied: Path) -> None:
    (copied / name).write_text("X = 1\n")
    assert solver_hash(copied) == solver_hash()


@pytest.mark.parametrize("library", LIBRARIES)
def test_another_version_of_a_library_makes_another_solver(
    library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = solver_hash()

    def another(name: str) -> str:
        return "0.0.1" if name == library else version(name)

    monkeypatch.setattr("solver_adapters.bundled.identity.version", another)
    assert solver_hash() != before


def test_the_libraries_are_those_that_its_modules_import() -> None:
    found = set()
    own = (PACKAGES / "solver_adapters/bundled").rglob("*.py")
    for source in (*own, *(PACKAGES / name for name in BESIDE)):
        for node in ast.walk(ast.parse(source.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.split(".")[0])
    assert found - sys.stdlib_module_names - {"meshes", "solver_adapters"} == set(LIBRARIES)
