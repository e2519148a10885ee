"""Sizes of the meshes of a case that leaves them open: chosen, refined, and kept in its results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from driver.case.model import Case, load_case
from driver.forward.build import capabilities_of, geometry_of
from driver.results.files import SIZES, results_of, with_results
from driver.results.hdf5 import damaged
from driver.results.json_files import read_json, write_json
from meshes.cells import NAMES
from meshes.prism import CellKind
from solver_adapters.interface import Capabilities

_HEXAHEDRON = next(nodes for nodes, name in NAMES.items() if name == "hex20")


@dataclass(frozen=True)
class Refinements:
    """What `sizes.json` holds.

    Attributes:
        level: how often the meshes were refined.
        seconds: wall-clock time of the stages on the coarser meshes before [s].
        failed: whether meshes that were refined once more could not be simulated.
    """

    level: int = 0
    seconds: float = 0.0
    failed: bool = False


def read_refinements(results: Path) -> Refinements:
    """Read how often the meshes were refined; nothing is there before they are.

    Raises:
        ResultError: the file is no readable JSON, or does not tell it.
    """
    path = results / SIZES
    if not path.is_file():
        return Refinements()
    record = read_json(path)
    level, seconds = record.get("refined"), record.get("seconds_before")
    if not (isinstance(level, int) and level >= 0 and isinstance(seconds, int | float)):
        raise damaged(path, "no numbers refined and seconds_before")
    return Refinements(level, float(seconds), bool(record.get("finer_failed")))


def write_refinements(results: Path, done: Refinements) -> None:
    """Write `sizes.json`.

    Args:
        results: where it goes.
        done: what it holds.
    """
    record = {
        "refined": done.level,
        "seconds_before": round(done.seconds, 2),
        "finer_failed": done.failed,
    }
    write_json(results / SIZES, record)


def sized_case(path: Path, results: Path | None = None) -> Case:
    """Read a case file, and choose the sizes that it leaves open.

    Args:
        path: the case file.
        results: folder of its results, None for the one that the case names.

    Raises:
        CaseError: the case cannot be used.
        ResultError: what its results tell of refinements is damaged.
        UnsupportedError: there is no such solver.
    """
    case = with_results(load_case(path), results)
    return sized(case, capabilities_of(case)) if case.specimen.automatic else case


def sized(case: Case, solver: Capabilities | None) -> Case:
    """Return a case with the sizes that its last run came to, the first ones before any run.

    Args:
        case: the case.
        solver: what its solver can, None for one that is unknown.

    Raises:
        ResultError: what its results tell of refinements is damaged.
    """
    if not case.specimen.automatic:
        return case
    level = read_refinements(results_of(case)).level
    return _with_specimen(case, _kind(case, solver), level)


def refined(case: Case, times: int = 1) -> Case:
    """Return a case with chosen sizes with its meshes refined so much oftener, or less often."""
    assert case.specimen.refined is not None
    return _with_specimen(case, case.specimen.cell_kind, case.specimen.refined + times)


def _with_specimen(case: Case, kind: CellKind, level: int) -> Case:
    return case.model_copy(update={"specimen": case.specimen.at_level(kind, level)})


def _kind(case: Case, solver: Capabilities | None) -> CellKind:
    """Kind of the cells: as stated, else hexahedra where solver and grain boundary allow them."""
    if case.specimen.of_mesh:
        return case.specimen.measures.kind
    if case.specimen.labels is not None:
        return "tet10"
    if case.specimen.cells is not None:
        return case.specimen.cells
    able = solver is not None and _HEXAHEDRON in solver.cells and solver.mean_dilatation
    follows = geometry_of(case).crossed_from_side_to_side
    return "hex20" if able and follows else "tet10"
