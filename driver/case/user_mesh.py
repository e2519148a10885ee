"""The mesh of the user's own that a case names, read once as long as its file stays the same."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from driver.common.errors import InputError, sentence
from meshes.measures import Measures
from meshes.prism_mesh import PrismMesh

if TYPE_CHECKING:
    from driver.case.specimen import Specimen

_SAME = 0.01  # share of a length by which a mesh may differ from what the case states
_UNITS = {1e-3: "mm", 1e-6: "m", 1e3: "nm"}
"""What a number in µm is multiplied by in a file of another unit."""


def mesh_of_file(path: Path) -> PrismMesh:
    """Return the mesh of a file.

    Raises:
        InputError: there is none of a specimen.
    """
    try:
        state = path.stat()
        return _read(path, state.st_mtime_ns, state.st_size)
    except OSError:
        raise InputError(
            sentence(path, "specimen.mesh_file", "no such file", "a mesh (.msh, .med or .vtu)")
        ) from None
    except ValueError as error:
        raise InputError(f"{path}: specimen.mesh_file: {error}") from None


@lru_cache(maxsize=2)
def _read(path: Path, changed: int, size: int) -> PrismMesh:
    # What reads meshes is imported where there is one: it takes longer than a call of prismid.
    from meshes.user_mesh import read_user_mesh

    return read_user_mesh(path)


def measures_of_file(path: Path, specimen: Specimen, n_grains: int) -> Measures:
    """Return the measures of the mesh of a file, which are to be those of the case.

    Args:
        path: the file.
        specimen: what the case states.
        n_grains: grains of the case.

    Raises:
        InputError: there is no mesh of a specimen, or it is one of another.
    """
    from meshes.user_mesh import measures_of

    found = measures_of(mesh_of_file(path))
    lengths = {"length": specimen.length_um, "width": specimen.width_um, "depth": specimen.depth_um}
    axes = {"length": "along Y", "width": "along X on TOP", "depth": "along Z"}
    for side, value in lengths.items():
        there = getattr(found, side)
        if value is not None and abs(there - value) > _SAME * value:
            expected = f"specimen.{side}_um = {value:g}{_unit(there / value)}"
            what = f"{there:.6g} µm {axes[side]}"
            raise InputError(sentence(path, "specimen.mesh_file", what, expected))
    if specimen.cells not in (None, found.kind):
        expected = f'specimen.cells = "{specimen.cells}"'
        raise InputError(sentence(path, "specimen.mesh_file", found.kind, expected))
    if not specimen.automatic:
        sizes = specimen.mesh_size, specimen.fine_mesh_size
        working, finer = (max(1, round(found.size / size)) for size in sizes)
        if finer <= working:
            stated = f"cells of {found.size:.3g} µm, in {working} and {finer} pieces of an edge"
            expected = f"sizes of which the finer makes {working + 1} pieces or more"
            raise InputError(sentence(path, "specimen.mesh_file", stated, expected))
    if found.n_grains != n_grains:
        grains = f"the groups GRAIN1 to GRAIN{found.n_grains}" if found.n_grains > 1 else "GRAIN1"
        tables = f"{n_grains} of them, for there are {n_grains} tables [[grains]]"
        raise InputError(sentence(path, "specimen.mesh_file", grains, tables))
    return found


def _unit(ratio: float) -> str:
    """Return what other unit a file may be in."""
    for factor, unit in _UNITS.items():
        if abs(ratio / factor - 1) <= _SAME:
            return f" in µm: the file seems to be in {unit}"
    return ""
