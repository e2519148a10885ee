"""Opening MED files: which can be read, and one sentence for those that cannot."""

import ctypes
import os
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import medcoupling as mc
import numpy as np
import pytest

from meshes.files import write_med
from meshes.med_file import open_med, quiet_library
from meshes.prism_mesh import PrismMesh
from tests.meshes import raw_med


@pytest.fixture
def med(mesh: PrismMesh, tmp_path: Path) -> Path:
    path = tmp_path / "prism.med"
    write_med(mesh, path)
    return path


def write_grid(path: Path, mode: int) -> None:
    grid = mc.MEDCouplingCMesh("grid")
    grid.setCoords(*[mc.DataArrayDouble([0.0, 1.0, 2.0])] * 3)
    file = mc.MEDFileCMesh()
    file.setMesh(grid)
    file.write40(str(path), mode)


def write_field(path: Path, mesh: str, name: str) -> None:
    file = mc.MEDFileUMesh(str(path), mesh)
    one = mc.MEDCouplingFieldDouble(mc.ON_NODES, mc.ONE_TIME)
    one.setName(name)
    one.setMesh(file.getMeshAtLevel(0))
    one.setArray(mc.DataArrayDouble(np.zeros(file.getNumberOfNodes())))
    series = mc.MEDFileFieldMultiTS()
    series.appendFieldNoProfileSBT(one)
    series.write40(str(path), 0)


@pytest.mark.parametrize(("major", "minor"), [(5, 0), (4, 9)])
def test_a_file_of_a_newer_version_is_refused_by_its_version(
    med: Path, major: int, minor: int
) -> None:
    raw_med.set_version(med, major, minor)
    newest = "{}.{}".format(*mc.MEDFileVersion()[:2])
    with pytest.raises(
        ValueError, match=rf"prism\.med: found MED {major}\.{minor}\.1, expected 2\.2 to {newest}$"
    ):
        open_med(med)


def test_a_file_before_2_2_is_refused_with_the_cure(med: Path) -> None:
    raw_med.set_version(med, 2, 1)
    with pytest.raises(ValueError, match="found MED 2.1.1, .*; the program medimport makes a newe"):
        open_med(med)


def test_a_structured_grid_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "grid.med"
    write_grid(path, 2)
    with pytest.raises(
        ValueError, match=r"grid\.med: found the meshes grid, expected an unstructured one"
    ):
        open_med(path)


def test_a_grid_beside_the_mesh_does_not_matter(med: Path) -> None:
    write_grid(med, 0)
    with h5py.File(med) as hdf:
        assert set(hdf["ENS_MAA"]) == {"grid", "prism"}
    assert open_med(med).mesh.getName() == "prism"


def test_a_file_of_fields_alone_is_refused(med: Path) -> None:
    with h5py.File(med, "r+") as hdf:
        del hdf["ENS_MAA"]
    with pytest.raises(ValueError, match="found the meshes none, expected an unstructured one"):
        open_med(med)


def test_names_that_the_library_cannot_read_are_refused(med: Path) -> None:
    with h5py.File(med, "r+") as hdf:
        hdf.move("ENS_MAA/prism", "ENS_MAA/prism  ")
    with pytest.raises(ValueError, match=r"found the name 'prism  ', expected names in UTF-8"):
        open_med(med)
    with h5py.File(med, "r+") as hdf:
        hdf["ENS_MAA"].id.move(b"prism  ", b"pri\xe8me")
    with pytest.raises(ValueError, match=r"found the name b'pri\\xe8me', expected names in UTF-8"):
        open_med(med)


def test_fields_are_those_on_the_mesh(med: Path) -> None:
    raw_med.copy_mesh(med, "prism", med, "other")
    for name in ("other", "prism"):
        write_field(med, name, f"ON_{name}")
    assert open_med(med, "prism").fields == ("ON_prism",)
    assert open_med(med, "other").fields == ("ON_other",)
    assert open_med(med, fields=["ON_other"]).mesh.getName() == "other"
    with pytest.raises(ValueError, match="meshes other, prism, 2 of them with fields; expected"):
        open_med(med)


def test_the_only_mesh_with_fields_is_meant(med: Path) -> None:
    write_field(med, "prism", "DEPL")
    raw_med.copy_mesh(med, "prism", med, "before")
    assert open_med(med).mesh.getName() == "prism"


def test_the_library_is_silent_while_python_and_its_children_are_not(
    capfd: pytest.CaptureFixture[str],
) -> None:
    library = ctypes.CDLL(None)
    with quiet_library():
        library.perror(b"the library")
        print("Python", file=sys.stderr, flush=True)
        os.system("echo a child >&2")
    assert capfd.readouterr().err == "Python\na child\n"
    library.perror(b"the library again")
    assert "the library again" in capfd.readouterr().err


def test_the_library_speaks_again_after_an_error(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="inside"), quiet_library():
        raise ValueError("inside")
    ctypes.CDLL(None).perror(b"the library")
    assert "the library" in capfd.readouterr().err


def _long_name(hdf: h5py.File) -> None:
    hdf["ENS_MAA"].move("prism", 80 * "p")


def _version_of_words(hdf: h5py.File) -> None:
    hdf["INFOS_GENERALES"].attrs["MAJ"] = "four"


def _versions(hdf: h5py.File) -> None:
    hdf["INFOS_GENERALES"].attrs["MAJ"] = np.array([4, 4])


def _meshes_as_numbers(hdf: h5py.File) -> None:
    del hdf["ENS_MAA"]
    hdf["ENS_MAA"] = np.arange(3.0)


def _field_as_numbers(hdf: h5py.File) -> None:
    hdf["CHA/DEPL"] = np.arange(3.0)


def _field_of_nothing(hdf: h5py.File) -> None:
    hdf.create_group("CHA/DEPL").attrs["MAI"] = np.bytes_("prism")


@pytest.mark.parametrize(
    "damage",
    [
        _long_name, _version_of_words, _versions, _meshes_as_numbers, _field_as_numbers,
        _field_of_nothing,
    ],
)  # fmt: skip
def test_what_would_end_the_process_or_raise_anything_is_refused_with_the_file(
    damage: Callable[[h5py.File], None], med: Path
) -> None:
    with h5py.File(med, "r+") as hdf:
        damage(hdf)
    with pytest.raises(ValueError, match=f"^{med}: "):
        open_med(med)
