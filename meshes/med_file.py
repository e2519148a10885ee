"""Opening MED files: what medcoupling cannot say of a damaged one is found before."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import medcoupling as mc


@dataclass(frozen=True, eq=False)
class MedFile:
    """A whole MED file with one mesh.

    Attributes:
        path: the file.
        mesh: its mesh, medcoupling's MEDFileUMesh.
        fields: names of the fields on it.
    """

    path: Path
    mesh: Any
    fields: tuple[str, ...]


def open_med(path: Path) -> MedFile:
    """Open a MED file that holds one mesh.

    Raises:
        ValueError: the file is no MED file, a damaged one, or has another number of meshes.
        FileNotFoundError: there is no such file.
    """
    try:
        # h5py refuses a damaged file without a word; medcoupling floods the terminal first.
        with h5py.File(path) as hdf:
            meshes, fields = list(hdf["ENS_MAA"]), tuple(hdf.get("CHA", ()))
        if len(meshes) != 1:
            raise ValueError(f"{path}: one mesh is expected, found {len(meshes)}: {meshes}")
        return MedFile(path, mc.MEDFileUMesh(str(path)), fields)
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: no such file") from None
    except (OSError, KeyError, mc.InterpKernelException) as error:
        raise ValueError(f"{path}: not a MED file, or a damaged one") from error
