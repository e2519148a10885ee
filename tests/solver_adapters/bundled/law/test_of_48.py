"""The kernels of 48 slip systems: the modules of `law`, loaded once more with another number."""

from __future__ import annotations

import ast
import sys
from pathlib import Path
from types import ModuleType

import pytest

from solver_adapters.bundled import law
from solver_adapters.bundled.law.gauss_points import point_kernels_of
from solver_adapters.bundled.law.law import StateLayout

FOLDER = Path(law.__file__).parent
OWN = "solver_adapters.bundled.law"


def imports(module: str) -> tuple[set[str], set[str]]:
    """Modules of `law` that one takes something from: by relative imports, by absolute ones."""
    relative, absolute = set(), set()
    for node in ast.walk(ast.parse((FOLDER / f"{module}.py").read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ImportFrom):
            continue
        names = {alias.name for alias in node.names}
        if node.level:
            relative |= names - {"NS"} if node.module is None else {node.module}
        elif node.module == OWN:
            absolute |= names
        elif node.module is not None and node.module.startswith(f"{OWN}."):
            absolute.add(node.module.removeprefix(f"{OWN}."))
    return relative, absolute


def follow_the_number() -> set[str]:
    """Modules that the kernels of points reach by relative imports, themselves included."""
    found: set[str] = set()
    waiting = {"point_kernels"}
    while waiting:
        module = waiting.pop()
        found.add(module)
        waiting |= imports(module)[0] - found
    return found


def test_what_follows_the_number_is_imported_by_relative_imports_alone() -> None:
    following = follow_the_number()
    assert {"state_layout", "slip", "simd_rows"} <= following
    for module in following:
        assert not imports(module)[1] & following, module
    shared = {module for name in following for module in imports(name)[1]}
    for module in shared:
        assert not imports(module)[0], module
        assert not imports(module)[1] & following, module


@pytest.mark.parametrize(("n_systems", "package"), [(24, OWN), (48, f"{OWN}.of_48")])
def test_each_number_has_layouts_of_its_own(n_systems: int, package: str) -> None:
    kernels: ModuleType = point_kernels_of(n_systems)
    assert kernels.__name__ == f"{package}.point_kernels"
    state, rows = (sys.modules[f"{package}.{kind}_layout"] for kind in ("state", "workspace"))
    whole = StateLayout(n_systems)
    assert state.NS == n_systems and state.N_STATE == whole.size == 9 + 4 * n_systems
    assert rows.WEIGHTS - rows.INTERACTION == 2 * n_systems**2
