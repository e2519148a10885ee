"""The order of all rooms in one table: a module imports only from floors below its own."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("prismid", "driver", "solver_adapters", "meshes", "templates")

# From the roof down. Rooms of one floor know nothing of each other. The longest name that a
# module has in the table is its room; packages that only hold rooms stand in `CORRIDORS`.
FLOORS: tuple[tuple[str, ...], ...] = (
    ("prismid",),
    ("driver.cli",),
    ("driver.terminal",),
    ("driver.trust",),
    (
        "driver.batch",
        "driver.cache",
        "driver.check",
        "driver.export",
        "driver.posterior",
        "driver.status",
        "driver.verify",
    ),
    ("driver.workflow",),
    ("driver.doubts",),
    ("driver.design", "driver.noise_floor"),
    ("driver.virtual",),
    ("driver.report",),
    ("driver.results",),
    ("driver.diagnosis.search",),
    ("driver.diagnosis.answer",),
    ("driver.diagnosis.statistics",),
    ("driver.diagnosis.causes",),
    ("driver.identification",),
    ("driver.forward",),
    ("driver.dic",),
    ("driver.experiment",),
    ("driver.case",),
    ("driver.parameters",),
    ("driver.common",),
    ("solver_adapters.calculix", "solver_adapters.code_aster"),
    (
        "solver_adapters.bundled",
        "solver_adapters.external",
        "solver_adapters.finite_differences",
        "solver_adapters.job_store",
    ),
    (
        "solver_adapters.bundled.fem",
        "solver_adapters.bundled.linear",
        "solver_adapters.checks",
        "solver_adapters.jobs",
        "solver_adapters.quotient",
        "solver_adapters.response_file",
    ),
    (
        "solver_adapters.bundled.law",
        "solver_adapters.cholesky",
        "solver_adapters.med_results",
        "solver_adapters.registry",
        "solver_adapters.result_files",
        "solver_adapters.simulation_key",
        "solver_adapters.time_steps",
    ),
    ("solver_adapters.constants", "solver_adapters.interaction", "solver_adapters.interface"),
    ("solver_adapters.material",),
    ("solver_adapters.grain_scalars",),
    (
        "solver_adapters.crystal",
        "solver_adapters.inside_grain",
        "solver_adapters.kernels",
        "solver_adapters.parameter",
        "solver_adapters.profile",
        "solver_adapters.tasks",
    ),
    ("solver_adapters.compiling_process",),
    ("meshes", "solver_adapters.cholmod", "solver_adapters.user_folders", "templates"),
)
CORRIDORS = ("driver", "driver.diagnosis", "solver_adapters")
# Only these draw.
DRAWERS = ("driver.check", "driver.report", "driver.design", "driver.noise_floor")
# This one hands their figures on.
HANDS_FIGURES_ON = "prismid.pictures"

# Endings of files that are written for a case, and folders among its results.
WRITTEN = (
    ".h5", ".json", ".csv", ".html", ".png", ".pvd", ".vtu", ".vtkhdf", ".med", ".toml", ".tif",
    ".txt", ".lock", ".partial", ".edited",
)  # fmt: skip
FOLDERS = ("results", "jobs", "extended_decks")
# These name no result: the case file, its schema, usual inputs and the folder of its results, the
# user's queue systems and consent, formats of images that are read and of results that are
# compared, keys of answers for other programs, a file that is not whole yet.
NAME_NO_RESULT = (
    "driver.batch.queues",
    "driver.case.consent",
    "driver.case.history",
    "driver.case.model",
    "driver.case.solver",
    "driver.common.atomic_write",
    "driver.experiment.ebsd.headers",
    "driver.experiment.images.files",
    "driver.experiment.images.formats",
    "driver.experiment.images.headers",
    "driver.terminal.answers",
    "driver.verify.numbers",
)


def within(module: str, package: str) -> bool:
    return module == package or module.startswith(package + ".")


def room_of(module: str) -> str | None:
    """The room of a module, None for one that stands in none."""
    rooms = (room for floor in FLOORS for room in floor if within(module, room))
    return max(rooms, key=len, default=None)


FLOOR_OF = {room: number for number, floor in enumerate(FLOORS) for room in floor}


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


def wrong_arrows(source: str, module: str, is_package: bool = False) -> list[str]:
    """Imports that lead to a room on the same floor or above, as `module -> imported`."""
    own = room_of(module)
    found = []
    for imported in imported_modules(source, module, is_package):
        if imported.split(".")[0] not in (*PACKAGES, "tests", "benchmarks"):
            continue
        other = room_of(imported)
        if other == own:
            continue
        if own is None or other is None or FLOOR_OF[other] <= FLOOR_OF[own]:
            found.append(f"{module} -> {imported}")
    return found


def our_modules() -> Iterator[tuple[Path, str, bool]]:
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            is_package = parts[-1] == "__init__"
            yield path, ".".join(parts[:-1] if is_package else parts), is_package


def test_every_room_is_named_once_and_has_modules() -> None:
    rooms = [room for floor in FLOORS for room in floor]
    assert len(set(rooms)) == len(rooms)
    lived_in = {room_of(name) for _, name, _ in our_modules() if name not in CORRIDORS}
    assert lived_in == set(rooms)


def test_cvxopt_is_imported_by_one_module_which_chooses_the_kernels_of_its_blas() -> None:
    paths = [path for path, _, _ in our_modules()] + sorted((ROOT / "benchmarks").glob("*.py"))
    importing = [
        path.relative_to(ROOT).as_posix()
        for path in paths
        if re.search(r"^\s*(from|import) cvxopt\b", path.read_text("utf-8"), re.MULTILINE)
    ]
    assert importing == ["solver_adapters/cholmod.py"]


def test_every_module_stands_in_a_room() -> None:
    homeless = [name for _, name, _ in our_modules() if room_of(name) is None]
    assert set(homeless) == set(CORRIDORS)


def test_a_corridor_holds_no_code() -> None:
    for path, name, _ in our_modules():
        if name in CORRIDORS:
            statements = ast.parse(path.read_text(encoding="utf-8")).body
            assert len(statements) == 1, name


def test_imports_only_run_down() -> None:
    found = [
        arrow
        for path, name, is_package in our_modules()
        for arrow in wrong_arrows(path.read_text(encoding="utf-8"), name, is_package)
    ]
    assert found == []


def test_nobody_draws_but_rooms_with_pictures() -> None:
    drawing = {
        name
        for path, name, is_package in our_modules()
        for imported in imported_modules(path.read_text(encoding="utf-8"), name, is_package)
        if within(imported, "matplotlib")
    }
    strangers = [
        n for n in drawing if not any(within(n, room) for room in (*DRAWERS, HANDS_FIGURES_ON))
    ]
    assert strangers == []


def test_the_driver_names_no_solver() -> None:
    names = ("bundled", "code_aster", "calculix")
    naming = [
        name
        for path, name, _ in our_modules()
        if within(name, "driver")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and node.value in names
    ]
    assert naming == ["driver.case.solver"]  # the default of the case


def file_names(source: str) -> list[str]:
    """Texts of a source that end as a file that is written, or are a folder; no docstrings."""
    tree = ast.parse(source)
    documentation = {
        id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)
    }  # a text that stands alone
    return [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and id(node) not in documentation
        and (node.value.endswith(WRITTEN) or node.value in FOLDERS)
    ]


def test_all_names_of_written_files_stand_in_one_module() -> None:
    naming = {
        name
        for path, name, _ in our_modules()
        if within(name, "driver") and file_names(path.read_text(encoding="utf-8"))
    }
    assert sorted(naming) == sorted((*NAME_NO_RESULT, "driver.results.files"))


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ('path = folder / "check.png"', ["check.png"]),
        ('path = folder / f"report_{name}.png"', [".png"]),
        ('path = case.file.parent / "results" / name', ["results"]),
        ('path = path.with_suffix(".vtu")', [".vtu"]),
        ('def f():\n    """Write measure.h5"""', []),
        ('page = render("report.html.j2")', []),
    ],
)
def test_a_text_that_names_a_written_file_is_found(source: str, names: list[str]) -> None:
    assert file_names(source) == names


@pytest.mark.parametrize("kind", ["tests", "benchmarks"])
def test_tests_and_benchmarks_do_not_import_each_other(kind: str) -> None:
    other = {"tests": "benchmarks", "benchmarks": "tests"}[kind]
    found = [
        f"{path.relative_to(ROOT)} -> {imported}"
        for path in sorted((ROOT / kind).rglob("*.py"))
        for imported in imported_modules(path.read_text(encoding="utf-8"), kind, False)
        if within(imported, other)
    ]
    assert found == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("templates", "import meshes"),
        ("templates.filters", "from solver_adapters.interface import Simulation"),
        ("meshes.prism", "from driver.case.model import Case"),
        ("solver_adapters.bundled.adapter", "def f():\n    import driver.cli"),
        ("solver_adapters.bundled.law.slip", "from solver_adapters.bundled.fem import assembly"),
        ("driver.experiment.images.flatfield", "from ...identification import fit"),
        ("driver.dic.basis", "from driver import diagnosis"),
        ("driver.dic.basis", "from driver.forward import model"),
        ("driver.identification.fit", "from driver.report.page import write"),
        ("driver.diagnosis.causes.causes", "import driver.report"),
        ("driver.check.command", "from driver.export.command import export_case"),
        ("driver.report.page", "from tests.driver import closed_form"),
        ("driver.cli", "from prismid.cases import load_case"),
    ],
)
def test_an_arrow_that_runs_up_or_across_is_found(module: str, source: str) -> None:
    assert len(wrong_arrows(source, module)) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("meshes.prism", "from meshes.surface import SurfaceMesh\nimport gmsh"),
        ("solver_adapters.bundled.adapter", "from meshes.prism_mesh import PrismMesh"),
        ("driver.report.page", "from driver.results import files\nfrom templates import render"),
        ("driver.diagnosis.causes.causes", "from ...identification.fit import Fit"),
        ("driver.cli", "from driver.report.page import write\nimport solver_adapters.interface"),
    ],
)
def test_an_arrow_that_runs_down_is_allowed(module: str, source: str) -> None:
    assert wrong_arrows(source, module) == []


def test_a_relative_import_in_a_package_file_starts_at_the_package_itself() -> None:
    source = "from .page import report_page"
    assert wrong_arrows(source, "driver.report", is_package=True) == []
    assert wrong_arrows("from ..cli import app", "driver.report", is_package=True) == [
        "driver.report -> driver.cli.app"
    ]
