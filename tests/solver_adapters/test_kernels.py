"""What the cache of compiled kernels hangs on."""

from __future__ import annotations

import ast
import shutil
from pathlib import Path
from typing import Any

import numba
import pytest

from solver_adapters.bundled.law.gauss_points import point_kernels_of
from solver_adapters.crystal import SYSTEM_COUNTS
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
        if not isinstance(node, ast.ImportFrom):
            continue
        parts = [] if node.module is None else node.module.split(".")
        start = source.parents[node.level - 1] if node.level else PACKAGES
        base = start.joinpath(*parts)
        for path in (base.with_suffix(".py"), *(base / f"{alias.name}.py" for alias in node.names)):
            if path.is_file() and path.is_relative_to(PACKAGES / "solver_adapters"):
                found.add(path)
        if node.level and not parts:
            found.add(base / "__init__.py")
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
    # It gives the kernels another number, and none of them imports it.
    reached.add(PACKAGES / "solver_adapters/bundled/law/of_48/__init__.py")
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


def test_kernels_of_a_file_that_is_loaded_under_two_names_lie_in_two_folders() -> None:
    folder = kernels_folder()
    assert folder is not None
    of_24, of_48 = (Path(point_kernels_of(n).update_small._cache.cache_path) for n in SYSTEM_COUNTS)
    assert of_24.parent == folder and of_48.parent == folder / "of_48"
    config: Any = numba.config
    assert config.CACHE_DIR == str(folder)
