"""Imports only run down: a module may import from floors below its own, never from above."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# What each part may import of ours, besides itself. The longest matching name counts.
BELOW = {
    "templates": (),
    "meshes": (),
    "solver_adapters": ("meshes", "templates"),
    "driver": ("solver_adapters", "meshes", "templates"),
}
PACKAGES = tuple(BELOW)

# Inside `driver` the stages stand in a row, and none knows the ones after it.
STAGES_ABOVE = {
    # What makes data knows nothing of what identifies them.
    "driver.microscope": (
        "driver.dic",
        "driver.identification",
        "driver.diagnosis",
        "driver.report",
    ),
    "driver.images": ("driver.identification", "driver.diagnosis", "driver.report"),
    "driver.dic": ("driver.identification", "driver.diagnosis", "driver.report"),
    "driver.identification": ("driver.diagnosis", "driver.report"),
    "driver.diagnosis": ("driver.report",),
}


def within(module: str, package: str) -> bool:
    return module == package or module.startswith(package + ".")


def imported_modules(source: str, module: str, is_package: bool) -> Iterator[str]:
    """Absolute names of all that a source imports, wherever in the file the statement stands."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                up = node.level - 1 if is_package else node.level
                parts = module.split(".")
                base = ".".join([*parts[: len(parts) - up], *filter(None, [node.module])])
            # `from driver import report` imports a module as well as a name can be one.
            yield from (f"{base}.{alias.name}" for alias in node.names)


def arrows_up(source: str, module: str, is_package: bool = False) -> list[str]:
    """Imports of a module that lead to a floor it must not know, as `module -> imported`."""
    package = module.split(".")[0]
    forbidden = [p for p in PACKAGES if p != package and p not in BELOW[package]]
    for stage, above in STAGES_ABOVE.items():
        if within(module, stage):
            forbidden.extend(above)
    return [
        f"{module} -> {imported}"
        for imported in imported_modules(source, module, is_package)
        if any(within(imported, name) for name in forbidden)
    ]


def our_modules() -> Iterator[tuple[Path, str, bool]]:
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            is_package = parts[-1] == "__init__"
            yield path, ".".join(parts[:-1] if is_package else parts), is_package


def test_imports_only_run_down() -> None:
    modules = list(our_modules())
    assert {name.split(".")[0] for _, name, _ in modules} == set(PACKAGES)
    found = [
        arrow
        for path, name, is_package in modules
        for arrow in arrows_up(path.read_text(encoding="utf-8"), name, is_package)
    ]
    assert found == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("templates", "import meshes"),
        ("templates.filters", "from solver_adapters.interface import Simulation"),
        ("meshes.prism", "import templates"),
        ("meshes.prism", "from driver.case.model import Case"),
        ("solver_adapters.bundled.adapter", "def f():\n    import driver.cli"),
        ("driver.images.flat", "from ..identification import fit"),
        ("driver.dic.basis", "from driver import diagnosis"),
        (
            "driver.virtual.microscope.relief",
            "from driver.common.splines.images import spline_images",
        ),
        ("driver.identification.fit", "from driver.report.page import write"),
        ("driver.diagnosis.causes.causes", "import driver.report"),
    ],
)
def test_an_arrow_that_runs_up_is_found(module: str, source: str) -> None:
    assert len(arrows_up(source, module)) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("meshes.prism", "from meshes.surface import SurfaceMesh\nimport gmsh"),
        ("solver_adapters.bundled.adapter", "from meshes.prism_mesh import PrismMesh"),
        ("driver.report.page", "from driver.diagnosis import rank\nfrom templates import render"),
        ("driver.diagnosis.causes.causes", "from ..identification.fit import Fit"),
        ("driver.cli", "from driver.report.page import write\nimport solver_adapters"),
        ("driver.dic.basis", "from driver.reporting_units import nm"),
    ],
)
def test_an_arrow_that_runs_down_is_allowed(module: str, source: str) -> None:
    assert arrows_up(source, module) == []


def test_a_relative_import_in_a_package_file_starts_at_the_package_itself() -> None:
    source = "from .report import page"
    assert arrows_up(source, "driver.diagnosis", is_package=True) == []
    assert arrows_up("from ..report import page", "driver.diagnosis", is_package=True) == [
        "driver.diagnosis -> driver.report.page"
    ]
