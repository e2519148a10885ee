"""MED files: opened with a clear refusal, written in the version that most programs read."""

from __future__ import annotations

import ctypes
import errno
import os
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import medcoupling as mc

from meshes.guarded import can_be_read

_ADD, _REPLACE = 0, 2  # modes of medcoupling
_OLDEST = (2, 2)  # version of MED that its library reads
_LONGEST_NAME = 64  # signs, of a mesh or field in MED
_OVERHEAD = 1_000_000  # bytes of a file beside its numbers, at most
_UNSTRUCTURED = 0  # type of a mesh in MED
_QUIET = threading.Lock()
_C = ctypes.CDLL(None)
_C.fopen.restype = ctypes.c_void_p


@dataclass(frozen=True, eq=False)
class MedFile:
    """A whole MED file with the one mesh of it that is meant.

    Attributes:
        path: the file.
        mesh: its mesh, medcoupling's MEDFileUMesh.
        fields: names of the fields on it.
    """

    path: Path
    mesh: Any
    fields: tuple[str, ...]


def open_med(
    path: Path,
    mesh: str | None = None,
    groups: Sequence[str] = (),
    fields: Sequence[str] = (),
) -> MedFile:
    """Open a MED file at one of its unstructured meshes.

    A mesh that changes in time is read in its first state.

    Args:
        path: the file.
        mesh: name of the mesh; None for the only one, or of several for the only one that has
            the wanted groups and fields.
        groups: wanted groups.
        fields: wanted fields; any field counts where neither groups nor fields are wanted.

    Raises:
        ValueError: the file is no MED file, a damaged one, or of a version that cannot be read;
            or it has no such mesh, or several.
        FileNotFoundError: there is no such file.
    """
    if not can_be_read("meshes.med_trial:read_everything", path, mesh or ""):
        raise ValueError(f"{path}: not a MED file, or a damaged one")
    try:
        # h5py comes first: medcoupling ends the process at some of what it cannot read.
        fields_of = _fields_of_meshes(path)
        with quiet_library():
            name = _chosen(path, fields_of, mesh, groups, fields)
            return MedFile(path, mc.MEDFileUMesh(as_utf8(path), name), fields_of[name])
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: no such file") from None
    except (
        OSError, LookupError, TypeError, AttributeError, RuntimeError, mc.InterpKernelException,
    ) as error:  # fmt: skip
        raise ValueError(f"{path}: not a MED file, or a damaged one") from error


def write_as_med_4_0(data: Any, path: Path, replace: bool) -> None:
    """Write a mesh or the instants of a field in MED 4.0, which MED 4.0 and later read.

    Args:
        data: medcoupling's MEDFileUMesh or MEDFileFieldMultiTS.
        path: the file.
        replace: whether the file is made anew, else the data are added to it.

    Raises:
        OSError: the library cannot write it, as where no space is left or the path is not UTF-8.
    """
    name = as_utf8(path)
    _require_space(path, 2 * data.getHeapMemorySize() + _OVERHEAD)
    try:
        with quiet_library():
            data.write40(name, _REPLACE if replace else _ADD)
    except mc.InterpKernelException:
        raise OSError(errno.EIO, "no MED file could be written", name) from None


def _require_space(path: Path, size: int) -> None:
    """Make sure of space beside a file: where none is left the library ends the process.

    Raises:
        OSError: there is less.
    """
    try:
        with tempfile.TemporaryFile(dir=path.parent) as file:
            os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def as_utf8(path: Path) -> str:
    """Return a path whose UTF-8 is that of the system, whatever the encoding of the locale.

    Raises:
        OSError: it is none.
    """
    try:
        return os.fsencode(path).decode("utf-8")
    except UnicodeDecodeError:
        raise OSError(errno.EILSEQ, "a path that is not UTF-8", str(path)) from None


@contextmanager
def quiet_library() -> Iterator[None]:
    """Keep the terminal without what the MED library prints before medcoupling raises an error.

    The stream of C alone is exchanged: Python and programs started meanwhile keep theirs.
    """
    stream = ctypes.c_void_p.in_dll(_C, "stderr")
    with _QUIET:
        kept, stream.value = stream.value, _nowhere()
        try:
            yield
        finally:
            stream.value = kept


@cache
def _nowhere() -> int:
    """Return the stream of C that leads nowhere."""
    opened: int = _C.fopen(os.devnull.encode(), b"w")
    return opened


def _fields_of_meshes(path: Path) -> dict[str, tuple[str, ...]]:
    """Names of the fields on each unstructured mesh, by its name."""
    with h5py.File(path) as hdf:
        _require_version(path, hdf["INFOS_GENERALES"].attrs)
        meshes, fields = hdf.get("ENS_MAA", {}), hdf.get("CHA", {})
        for name in (*meshes, *fields):
            # medcoupling ends the process at some of them.
            if isinstance(name, bytes) or name != name.rstrip() or len(name) > _LONGEST_NAME:
                raise ValueError(
                    f"{path}: found the name {name!r}, expected names in UTF-8 of {_LONGEST_NAME} "
                    "signs at most that end in no blank"
                )
        for name in fields:
            missing = {"NOM", "NCO", "TYP"} - set(fields[name].attrs)
            if missing:
                raise KeyError(f"the field {name} has no {min(missing)}")
        unstructured = [name for name in meshes if meshes[name].attrs["TYP"] == _UNSTRUCTURED]
        if not unstructured:
            raise ValueError(
                f"{path}: found the meshes {', '.join(meshes) or 'none'}, expected an "
                "unstructured one"
            )
        mesh_of = {name: _mesh_of(fields[name]) for name in fields}
    return {mesh: tuple(name for name in mesh_of if mesh_of[name] == mesh) for mesh in unstructured}


def _require_version(path: Path, attributes: Mapping[str, Any]) -> None:
    """Make sure that the MED library reads this version: it ends the process at a newer one."""
    try:
        *version, release = (int(attributes[name]) for name in ("MAJ", "MIN", "REL"))
    except ValueError as error:
        raise TypeError(f"no version: {error}") from None
    newest = tuple(mc.MEDFileVersion()[:2])
    if not _OLDEST <= tuple(version) <= newest:
        old = tuple(version) < _OLDEST
        raise ValueError(
            f"{path}: found MED {version[0]}.{version[1]}.{release}, expected "
            f"{_OLDEST[0]}.{_OLDEST[1]} to {newest[0]}.{newest[1]}"
            + ("; the program medimport makes a newer file of it" if old else "")
        )


def _mesh_of(field: Any) -> str | None:
    """Name of the mesh of a field, None where the field has no instant."""
    if "MAI" in field.attrs:
        return os.fsdecode(field.attrs["MAI"]).rstrip()
    # MED 2 names it with every instant on every kind of cell.
    for instants in field.values():
        for instant in instants.values():
            return os.fsdecode(instant.attrs["MAI"]).rstrip()
    return None


def _chosen(
    path: Path,
    fields_of: Mapping[str, Sequence[str]],
    mesh: str | None,
    groups: Sequence[str],
    fields: Sequence[str],
) -> str:
    """Name of the mesh that is meant."""
    found = ", ".join(fields_of)
    if mesh is not None:
        if mesh not in fields_of:
            raise ValueError(f"{path}: found the unstructured meshes {found}, expected {mesh}")
        return mesh
    fitting = list(fields_of)
    if len(fitting) > 1:
        fitting = [
            name
            for name in fields_of
            if set(groups) <= set(mc.GetMeshGroupsNames(as_utf8(path), name))
            and set(fields) <= set(fields_of[name])
            and (groups or fields or fields_of[name])
        ]
    if len(fitting) != 1:
        wanted = ", ".join((*groups, *fields)) or "fields"
        raise ValueError(
            f"{path}: found the meshes {found}, {len(fitting) or 'none'} of them with {wanted}; "
            "expected one, or the name of the wanted mesh"
        )
    return fitting[0]
