"""A MED 2.3.6 file, laid out by h5py as Code_Aster 10 wrote them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from tests.meshes import raw_med

BLANK = b" " * 16


def write_old_med(
    source: Path, mesh: str, target: Path, nodal: Mapping[float, NDArray[np.float64]]
) -> None:
    """Write the volumes and faces of a mesh with their groups, and a field DEPL at the nodes.

    Args:
        source: a MED file of today.
        mesh: name of its mesh.
        target: the old file.
        nodal: of each instant the values (n_nodes, 3).
    """
    with h5py.File(target, "w") as hdf:
        note(hdf.create_group("INFOS_GENERALES"), MAJ=2, MIN=3, REL=6)
        place = hdf.create_group(f"ENS_MAA/{mesh}")
        note(place, DES=b"", DIM=3, TYP=0)
        points = raw_med.coordinates(source, mesh)
        note(
            numbered(place, "NOE/COO", points, len(points)),
            NOM=b"x".ljust(48),
            REP=0,
            UNI=BLANK * 3,
        )
        numbered(place, "NOE/FAM", np.zeros(len(points), dtype=np.int32), len(points))
        for kind in ("T10", "TR6"):
            cells = raw_med.connectivity(source, mesh, kind) + 1
            numbered(place, f"MAI/{kind}/NOD", cells.astype(np.int32), len(cells))
            family = raw_med.families(source, mesh, kind).astype(np.int32)
            numbered(place, f"MAI/{kind}/FAM", family, len(cells))
        note(place.create_group("FAS/FAMILLE_ZERO"), NUM=0)
        for name, numbers in raw_med.groups(source, mesh, "ELEME").items():
            for number in numbers:
                family = place.create_group(f"FAS/ELEME/FAM_{number}")
                note(family, NUM=number)
                note(family.create_group("GRO"), NBR=1)
                write_text(family["GRO"], "NOM", name.encode().ljust(80) + b"\0")
        field = hdf.create_group("CHA/DEPL")
        note(field, NCO=3, TYP=6, NOM=b"".join(x.ljust(16) for x in (b"DX", b"DY", b"DZ")))
        note(field, UNI=BLANK * 3)
        for number, (time, values) in enumerate(nodal.items(), 1):
            instant = field.create_group(f"NOE/{number:20d}{number:20d}")
            note(instant, MAI=mesh.encode(), NDT=number, NOR=number, PDT=time, UNI=b"s")
            note(instant.create_group(mesh), GAU=BLANK * 2, PFL=BLANK * 2, NBR=len(values), NGA=1)
            instant[mesh].create_dataset("CO", data=values.T.ravel())


def note(place: Any, **attributes: int | float | bytes) -> None:
    for name, value in attributes.items():
        if isinstance(value, bytes):
            place.attrs[name] = np.bytes_(value)  # of fixed length
        else:
            place.attrs[name] = np.int32(value) if isinstance(value, int) else value


def numbered(place: Any, name: str, values: NDArray[Any], count: int) -> Any:
    """A record component by component, with the number of its nodes or cells."""
    written = place.create_dataset(name, data=values.T.ravel())
    note(written, NBR=count)
    return written


def write_text(place: Any, name: str, text: bytes) -> None:
    """A text letter by letter, each a text of C."""
    letter, extent = h5py.h5t.C_S1, h5py.h5s.create_simple((len(text),))
    written = h5py.h5d.create(place.id, name.encode(), letter, extent)
    written.write(h5py.h5s.ALL, h5py.h5s.ALL, np.frombuffer(text, "S1").copy(), mtype=letter)
