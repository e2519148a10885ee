"""Small valid files of every kind that prismid reads, their damage, and what reads them."""

from __future__ import annotations

import random
import re
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import imagecodecs
import meshio
import numpy as np
import psutil
import tifffile

from driver.batch.campaign import read_campaign
from driver.batch.queues import Profiles
from driver.case.model import case_text, default_case, load_case
from driver.case.solver_profiles import load_config
from driver.case.toml import read_tables
from driver.common.errors import InputError
from driver.design.settings import read_settings
from driver.diagnosis.causes.user_causes import read_causes
from driver.experiment.history import read_history
from driver.experiment.images.heightmaps import load_stack
from driver.results.hdf5 import open_hdf5, read_hdf5, write_hdf5
from driver.results.identification import read_identification
from driver.results.json_files import read_json
from driver.results.mesh_sizes import read_refinements
from driver.results.stage_record import read_record
from driver.virtual.settings import read_virtual
from meshes.cells import outer_faces
from meshes.files import read_med, write_med
from meshes.med_fields import MedField, add_med_fields, read_med_fields
from meshes.plane_files import read_plane_mesh
from meshes.tet10 import node_groups
from solver_adapters.calculix.dat import read_displacements, read_force
from solver_adapters.calculix.sta import reached, read_increments
from solver_adapters.code_aster.force_table import read_resultants
from solver_adapters.code_aster.listing import cause, diagnose
from solver_adapters.code_aster.result import read_steps
from solver_adapters.code_aster.rmed import ResultFile
from solver_adapters.interface import Response, SolverError
from solver_adapters.response_file import (
    Provenance,
    read_provenance,
    read_response,
    write_response,
)
from solver_adapters.result_files import ResultFileError
from tools.boxes import box

_EXTREMES = (
    b"1e999", b"-1", b"nan", b"inf", b"0", b"1e-300", b"-1e30", b"9" * 30, b"9" * 5000, b"", b'"',
    b"'", b"[" * 40, b"[" * 2000, b"{", b"\0", b"\xff\xfe", b"true", b"1_0", b"0x1", b"1979-05-27",
    "\u202e".encode(), b"\n\n", b",", b"..", b"/dev/null",
)  # fmt: skip
_WHOLE = (0, 1, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**62, 2**64 - 1)
_FIELD = re.compile(rb"[-+\w.]+")


def mutated(content: bytes, seed: int) -> bytes:
    """Return the content of a file with one to four kinds of damage, the same for a seed."""
    chance = random.Random(seed)
    damaged = bytearray(content)
    for _ in range(chance.randint(1, 4)):
        chance.choice(_DAMAGES)(damaged, chance)
    return bytes(damaged)


Damage = Callable[[bytearray, random.Random], None]


def _place(content: bytearray, chance: random.Random) -> int:
    # Headers are where lengths, types and offsets stand.
    near = min(len(content), 600) if chance.random() < 0.5 else len(content)
    return chance.randrange(max(near, 1))


def _flipped(content: bytearray, chance: random.Random) -> None:
    for _ in range(chance.randint(1, 8)):
        if content:
            content[_place(content, chance)] ^= 1 << chance.randrange(8)


def _replaced(content: bytearray, chance: random.Random) -> None:
    if content:
        content[_place(content, chance)] = chance.choice((0, 1, 0x7F, 0x80, 0xFF))


def _truncated(content: bytearray, chance: random.Random) -> None:
    del content[_place(content, chance) :]


def _cut(content: bytearray, chance: random.Random) -> None:
    start = _place(content, chance)
    del content[start : start + chance.randint(1, 64)]


def _repeated(content: bytearray, chance: random.Random) -> None:
    start = _place(content, chance)
    content[start:start] = content[start : start + chance.randint(1, 256)] * chance.randint(1, 4)


def _counted(content: bytearray, chance: random.Random) -> None:
    """Put a length, an offset or a count at its extreme."""
    size, code = chance.choice(((2, "H"), (4, "I"), (8, "Q")))
    number = chance.choice(_WHOLE) & (256**size - 1)
    start = _place(content, chance)
    content[start : start + size] = struct.pack(chance.choice("<>") + code, number)


def _other_field(content: bytearray, chance: random.Random) -> None:
    fields = list(_FIELD.finditer(content))
    if fields:
        field = chance.choice(fields)
        content[field.start() : field.end()] = chance.choice(_EXTREMES)


def _swapped_lines(content: bytearray, chance: random.Random) -> None:
    lines = bytes(content).splitlines(keepends=True)
    if len(lines) > 1:
        a, b = chance.randrange(len(lines)), chance.randrange(len(lines))
        lines[a], lines[b] = lines[b], lines[a]
        content[:] = b"".join(lines)


_DAMAGES: tuple[Damage, ...] = (
    _flipped, _replaced, _truncated, _cut, _repeated, _counted, _other_field, _swapped_lines,
)  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """A kind of files of unknown origin.

    Attributes:
        name: as the study tells it.
        file: name of the file, by whose ending it may be known.
        write: writes a valid one.
        read: reads one as prismid does.
    """

    name: str
    file: str
    write: Callable[[Path], object]
    read: Callable[[Path], object]

    def content(self) -> bytes:
        """Return what a valid file holds."""
        return _content(self)


@cache
def _content(kind: Kind) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / kind.file
        kind.write(path)
        return path.read_bytes()


def fault_of(kind: Kind, path: Path) -> str:
    """Return what is wrong with how a kind of file is read, "" where it is read or refused.

    A refusal is an error of prismid whose message names the file; what reads a mesh without its
    name begins with what it found.
    """
    try:
        kind.read(path)
    except (InputError, ResultFileError, SolverError) as error:
        return "" if path.name in str(error) else f"the file is not named: {error}"
    except ValueError as error:
        named = type(error) is ValueError and (path.name in str(error) or _begins(error))
        return "" if named else f"{type(error).__name__}: {error}"
    except BaseException as error:
        return f"{type(error).__name__}: {error}"
    return ""


def seconds_of(process: int) -> float:
    """Time of the processor of a process and all that it has started [s]."""
    worker = psutil.Process(process)
    own = worker.cpu_times()
    seconds = float(own.user + own.system + own.children_user + own.children_system)
    for child in worker.children():
        with suppress(psutil.Error):
            seconds += sum(child.cpu_times()[:2])
    return seconds


def _begins(error: ValueError) -> bool:
    return str(error).startswith("found ")


_GREY = "minisblack"
_HEIGHTS = (np.arange(3 * 12 * 14).reshape(3, 12, 14) * 37 % 4096).astype(np.uint16)
_POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]], float)
_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]])
_NODES = np.arange(3)
_INSTANTS = np.array([1.0, 2.0])


def _hdf5_images(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("frames", data=_HEIGHTS, compression="gzip", chunks=(1, 12, 14))


def _plane(path: Path) -> None:
    formats = {".msh": "gmsh", ".med": "med", ".vtu": "vtu"}
    meshio.Mesh(_POINTS, [("triangle", _TRIANGLES)]).write(path, file_format=formats[path.suffix])


def _prism(path: Path) -> None:
    mesh = box()
    points, (outer, _) = mesh.points, outer_faces(mesh.cells)
    low, high = points.min(axis=0), points.max(axis=0)
    on = {
        "S_PLUS": points[:, 1] == high[1], "S_MINUS": points[:, 1] == low[1],
        "TOP": points[:, 2] == high[2],
    }  # fmt: skip
    faces = {name: outer[at[outer].all(axis=1)] for name, at in on.items()}
    write_med(replace(mesh, faces=faces, nodes=node_groups(points, faces)), path)


def _with_fields(path: Path) -> None:
    mesh = box()
    write_med(mesh, path)
    values = np.arange(2.0 * len(mesh.points) * 3).reshape(2, -1, 3)
    field = MedField("DEPL", "nodes", ("DX", "DY", "DZ"), ("um",) * 3, _INSTANTS, values)
    add_med_fields(path, [field])


def _identified(path: Path) -> None:
    texts = {
        "names": '["tau0"]', "units": '["MPa"]', "all_values": '{"tau0": 40.0}', "warnings": "[]",
        "reason": "converged", "converged": "1",
    }  # fmt: skip
    arrays = {"values": (np.ones(3), "1"), "final/motion": (np.ones((4, 50, 3)), "um")}
    write_hdf5(path, arrays, texts)


def _read_results(path: Path) -> None:
    read_hdf5(path)
    stored = open_hdf5(path, ("final/motion",))
    if "final/motion" in stored and stored["final/motion"].shape:
        list(stored["final/motion"])
    read_identification(path)


def _code_aster_results(path: Path) -> None:
    mesh = box()
    write_med(mesh, path)
    values = np.arange(2.0 * len(mesh.points) * 3).reshape(2, -1, 3)
    fields = [
        MedField(f"U_______{name}", "nodes", ("DX", "DY", "DZ"), ("um",) * 3, _INSTANTS, values)
        for name in ("DEPL", "REAC_NODA")
    ]
    add_med_fields(path, fields)


def _read_code_aster_results(path: Path) -> None:
    file = ResultFile(path)
    file.require_mesh(box())
    file.nodal("DEPL", _INSTANTS).pick("DX", "DY", "DZ")
    file.nodal("REAC_NODA", _INSTANTS).pick("DY")


def _response(path: Path) -> None:
    moved, force = np.ones((2, 4, 3)), np.ones(2)
    response = Response(moved, force, np.ones((1, 2, 4, 3)), np.ones((1, 2)), notes=("a note",))
    write_response(path, response, Provenance("bar", "1", "key"))


def _read_response(path: Path) -> None:
    read_provenance(path)
    read_response(path)


def _text(*lines: str) -> Callable[[Path], object]:
    return lambda path: path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _listing(path: Path) -> None:
    text = path.read_text(encoding="utf-8", errors="replace")
    diagnose(text), cause(text)
    read_steps(path)


def _printed(path: Path) -> None:
    read_force(path, "S_PLUS", _INSTANTS)
    read_displacements(path, "ALL", _INSTANTS, _NODES)


def _increments(path: Path) -> None:
    reached(path)
    read_increments(path, _INSTANTS)


def _dat() -> tuple[str, ...]:
    lines: list[str] = []
    for instant in _INSTANTS:
        lines += [
            f" total force (fx,fy,fz) for set S_PLUS and time  {instant:.7E}", "",
            "        1.000000E+00  2.000000E+00  3.000000E+00", "",
            f" displacements (vx,vy,vz) for set ALL and time  {instant:.7E}", "",
            *(f"         {n + 1}  1.0E-01  2.0E-01  3.0E-01" for n in _NODES), "",
        ]  # fmt: skip
    return tuple(lines)


KINDS: tuple[Kind, ...] = (
    Kind("case", "case.toml", _text(case_text(default_case())), load_case),
    Kind(
        "campaign", "campaign.toml",
        _text(
            'cases = ["a/case.toml"]', 'until = "identify"', "[[study]]", 'case = "case.toml"',
            "values = {K = [1.0, 2.0]}", "[[trial]]", 'case = "b.toml"', "seeds = [1, 2, 3]",
            "[execution]", "jobs = 2", "[cluster]", 'system = "slurm"', 'walltime = "01:00:00"',
        ),
        read_campaign,
    ),
    Kind(
        "own causes", "causes.toml",
        _text(
            "[[causes]]", 'name = "soft_end"', 'category = "material"', 'sentence = "It is soft."',
            'parameters = ["a1", "h_latent"]', 'check = "Look at it."',
        ),
        read_causes,
    ),
    Kind(
        "queue profiles", "clusters.toml",
        _text(
            "[profiles.big]", 'system = "slurm"', 'walltime = "02:00:00"', "memory_GB = 4.0",
            'job_extra_directives = ["--qos=high"]',
        ),
        lambda path: read_tables(path, Profiles, "the file of profiles"),
    ),
    Kind(
        "configuration", "config.toml",
        _text("[profiles.calculix]", 'command = ["ccx"]', "threads = 2"),
        lambda path: load_config(path, True),
    ),
    Kind("virtual settings", "virtual.toml", _text("[face]", "roughness_nm = 5.0"), read_virtual),
    Kind("design settings", "design.toml", _text("[test]", "images_per_stop = 4"), read_settings),
    Kind(
        "history", "history.csv",
        _text(
            "time_s,stage_um,image,force_N", "0,0,0,0.1", "1,5,1,2.5", "2,10,,4.5", "3,10,2,4.4",
            "4,5,3,1.0", "5,0,4,-0.5",
        ),
        read_history,
    ),
    Kind("TIFF", "a.tif", lambda p: tifffile.imwrite(p, _HEIGHTS, photometric=_GREY), load_stack),
    Kind(
        "compressed TIFF", "b.tif",
        lambda path: tifffile.imwrite(
            path, _HEIGHTS, compression="zlib", predictor=True, photometric=_GREY
        ),
        load_stack,
    ),
    Kind(
        "noise map", "noise.tif", lambda path: tifffile.imwrite(path, np.ones((12, 14), "f4")),
        load_stack,
    ),
    Kind("PNG", "a.png", lambda p: p.write_bytes(imagecodecs.png_encode(_HEIGHTS[0])), load_stack),
    Kind("NPY", "a.npy", lambda path: np.save(path, _HEIGHTS), load_stack),
    Kind("HDF5 images", "a.h5", _hdf5_images, lambda path: load_stack(f"{path}:/frames")),
    *(
        Kind(f"plane mesh {ending}", f"face{ending}", _plane, read_plane_mesh)
        for ending in (".msh", ".med", ".vtu")
    ),
    Kind("MED mesh", "prism.med", _prism, read_med),
    Kind("MED results", "fields.med", _with_fields, read_med_fields),
    Kind("HDF5 results", "identify.h5", _identified, _read_results),
    Kind("stored response", "response.h5", _response, _read_response),
    Kind(
        "stages.json", "stages.json",
        _text('{"mesh": {"key": "a", "outputs": ["mesh.med"], "seconds": 1.5}}'),
        lambda path: read_record(path.parent),
    ),
    Kind(
        "sizes.json", "sizes.json", _text('{"refined": 1, "seconds_before": 2.5}'),
        lambda path: read_refinements(path.parent),
    ),
    Kind("JSON results", "diagnosis.json", _text('{"causes": ["a"], "x": [1, {}]}'), read_json),
    Kind("CalculiX .dat", "job.dat", _text(*_dat()), _printed),
    Kind(
        "CalculiX .sta", "job.sta",
        _text(
            "SUMMARY OF JOB INFORMATION",
            "  STEP      INC     ATT  ITRS     TOT TIME     STEP TIME      INC TIME",
            "      1          1     1      3  0.100000E+01  0.100000E+01  0.100000E+01",
            "      2          1     1      3  0.200000E+01  0.100000E+01  0.100000E+01",
        ),
        _increments,
    ),
    Kind("Code_Aster results", "nodes.rmed", _code_aster_results, _read_code_aster_results),
    Kind(
        "Code_Aster listing", "job.mess",
        _text(
            "Instant de calcul:  1.000000000000e+00 - Niveau de découpe:  1",
            "Critère(s) de convergence atteint(s)", "* Nombre d'itérations de Newton : 4",
            "<F> <FACTOR_11>", "--- DIAGNOSTIC JOB : <S>_ERROR", "EXECUTION_CODE_ASTER_EXIT_7=1",
        ),
        _listing,
    ),
    Kind(
        "Code_Aster table", "forces.csv",
        _text("INTITULE,INST,DY", "S_PLUS,1.0,4.5", "S_PLUS,2.0,5.5"),
        lambda path: read_resultants(path, "S_PLUS", "DY", _INSTANTS),
    ),
)  # fmt: skip
"""Every kind of file that may come from anywhere."""
