"""MED files as h5py alone sees them: no library of MED takes part."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

# Nodes of the kinds of cells that the tests use.
NODES_OF = {"PO1": 1, "SE3": 3, "TR6": 6, "QU8": 8, "T10": 10, "H20": 20, "HE8": 8}


def version(path: Path) -> tuple[int, int]:
    with h5py.File(path) as hdf:
        attributes = hdf["INFOS_GENERALES"].attrs
        return int(attributes["MAJ"]), int(attributes["MIN"])


def set_version(path: Path, major: int, minor: int) -> None:
    with h5py.File(path, "r+") as hdf:
        hdf["INFOS_GENERALES"].attrs.modify("MAJ", major)
        hdf["INFOS_GENERALES"].attrs.modify("MIN", minor)


def state(hdf: h5py.File, mesh: str) -> Any:
    """The first state of a mesh."""
    return next(iter(hdf[f"ENS_MAA/{mesh}"].values()))


def kinds(path: Path, mesh: str) -> set[str]:
    with h5py.File(path) as hdf:
        return set(state(hdf, mesh)["MAI"])


def coordinates(path: Path, mesh: str) -> NDArray[np.float64]:
    """MED keeps all X, then all Y, then all Z; shape (n, 3)."""
    with h5py.File(path) as hdf:
        return np.asarray(state(hdf, mesh)["NOE/COO"][()].reshape(3, -1).T)


def connectivity(path: Path, mesh: str, kind: str) -> NDArray[np.int64]:
    """MED keeps the first nodes of all cells, then the second ones …, from 1; shape (n, k)."""
    with h5py.File(path) as hdf:
        nodes = state(hdf, mesh)[f"MAI/{kind}/NOD"][()]
    return np.asarray(nodes.reshape(NODES_OF[kind], -1).T.astype(np.int64) - 1)


def groups(path: Path, mesh: str, where: str) -> dict[str, set[int]]:
    """Numbers of the families of each group; `where` is NOEUD (nodes) or ELEME."""
    found: dict[str, set[int]] = {}
    with h5py.File(path) as hdf:
        for family in hdf.get(f"FAS/{mesh}/{where}", {}).values():
            for name in family["GRO/NOM"][()] if "GRO" in family else ():
                text = name.tobytes().decode().rstrip(" \0")
                found.setdefault(text, set()).add(int(family.attrs["NUM"]))
    return found


def declared_families(path: Path, mesh: str) -> set[int]:
    with h5py.File(path) as hdf:
        of_mesh = hdf[f"FAS/{mesh}"]
        found = {int(of_mesh["FAMILLE_ZERO"].attrs["NUM"])}
        for where in ("NOEUD", "ELEME"):
            found |= {int(family.attrs["NUM"]) for family in of_mesh.get(where, {}).values()}
    return found


def families(path: Path, mesh: str, kind: str | None = None) -> NDArray[np.int64]:
    """Family of each node, or of each cell of a kind; without a record all are in family 0."""
    with h5py.File(path) as hdf:
        place = state(hdf, mesh)["NOE" if kind is None else f"MAI/{kind}"]
        if "FAM" in place:
            return np.asarray(place["FAM"][()].astype(np.int64))
        return np.zeros(int(place["COO" if kind is None else "NOD"].attrs["NBR"]), dtype=np.int64)


def members(path: Path, mesh: str, kind: str, group: str) -> NDArray[np.int64]:
    """Indices of the cells of a kind that a group holds."""
    wanted = list(groups(path, mesh, "ELEME")[group])
    return np.flatnonzero(np.isin(families(path, mesh, kind), wanted))


def copy_mesh(source: Path, mesh: str, target: Path, name: str) -> None:
    """Copy a mesh with its families into a file, the same or another one, under a name."""
    content = io.BytesIO(source.read_bytes())
    with h5py.File(content) as one, h5py.File(target, "r+") as other:
        for folder in ("ENS_MAA", "FAS"):
            one.copy(f"{folder}/{mesh}", other[folder], name)


def field(path: Path, name: str, place: str) -> dict[tuple[int, int, float], NDArray[Any]]:
    """Values of a field by the numbers and the time of its instants, each of shape (n, k).

    Args:
        path: the file.
        name: name of the field.
        place: NOE (nodes), MAI.T10 (cells and their Gauss points), NOE.T10 (nodes of cells), …
    """
    with h5py.File(path) as hdf:
        found = hdf[f"CHA/{name}"]
        k = int(found.attrs["NCO"])
        return {
            (int(at.attrs["NDT"]), int(at.attrs["NOR"]), float(at.attrs["PDT"])): np.concatenate(
                [profile["CO"][()].reshape(k, -1).T for profile in at[place].values()]
            )
            for at in found.values()
            if place in at
        }
