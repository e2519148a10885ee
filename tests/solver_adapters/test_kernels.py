"""What the cache of compiled kernels hangs on."""

from __future__ import annotations

import ast
import shutil
from pathlib import Path
from typing import Any

import numba
import pytest

from solver_adapters.kernels import (
    KERNEL_SOURCES,
    PACKAGES,
    compiled_before,
    kernels_folder,
    kernels_hash,
)

DECORATORS = {"kernel", "ordered_kernel", "loop_kernel", "batch_kernel"}


def copy_of_the_sources(folder: Path) -> Path:
    for name in KERNEL_SOURCES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(PACKAGES / name, folder / name)
    return folder


def defines_kernels(source: Path) -> bool:
    return any(
        isinstance(decorator, ast.Name) and decorator.id in DECORATORS
        for node in ast.walk(ast.parse(source.read_text()))
        if isinstance(node, ast.FunctionDef)
        for decorator in node.decorator_list
    )


def imported(source: Path) -> set[Path]:
    """The modules of `solver_adapters` that a source takes something from."""
    found = set()
    for node in ast.walk(ast.parse(source.read_text())):
        if not isinstance(node, ast.ImportFrom) or node.module is None:
            continue
        for name in (node.module, *(f"{node.module}.{alias.name}" for alias in node.names)):
            path = PACKAGES / (name.replace(".", "/") + ".py")
            if name.startswith("solver_adapters.") and path.is_file():
                found.add(path)
    return found


def test_the_named_sources_are_those_of_kernels_and_all_that_these_import() -> None:
    waiting = {
        path
        for path in (PACKAGES / "solver_adapters/bundled").rglob("*.py")
        if defines_kernels(path)
    }
    reached: set[Path] = set()
    while waiting:
        path = waiting.pop()
        reached.add(path)
        waiting |= imported(path) - reached
    assert {path.relative_to(PACKAGES).as_posix() for path in reached} == set(KERNEL_SOURCES)


def test_the_hash_is_that_of_what_the_sources_say(tmp_path: Path) -> None:
    assert kernels_hash(copy_of_the_sources(tmp_path)) == kernels_hash()


@pytest.mark.parametrize(
    "name", ["bundled/law/workspace_layout.py", "bundled/law/small_lu.py", "crystal.py"]
)
def test_a_change_of_a_kernel_or_of_a_table_changes_the_hash(name: str, tmp_path: Path) -> None:
    source = copy_of_the_sources(tmp_path) / "solver_adapters" / name
    source.write_text(source.read_text() + "\nX = 1\n")
    assert kernels_hash(tmp_path) != kernels_hash()


def test_another_numba_changes_the_hash(monkeypatch: pytest.MonkeyPatch) -> None:
    before = kernels_hash()
    monkeypatch.setattr(numba, "__version__", "0.0.1")
    assert kernels_hash() != before


def test_the_cache_lies_in_a_folder_of_the_hash() -> None:
    config: Any = numba.config
    assert Path(config.CACHE_DIR).name == f"kernels-{kernels_hash()}"


def test_the_folder_that_the_user_names_to_numba_holds_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "mine"))
    assert kernels_folder() == tmp_path / "mine" / f"kernels-{kernels_hash()}"


def test_a_first_use_is_one_whose_folder_holds_no_compiled_kernel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert not compiled_before()
    folder = tmp_path / "prismid" / f"kernels-{kernels_hash()}" / "solver_adapters"
    folder.mkdir(parents=True)
    (folder / "slip.nbi").touch()
    assert compiled_before()
