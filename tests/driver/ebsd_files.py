"""Small EBSD maps, written by hand in the formats of their makers.

Headers and columns are reduced from what public readers are tested with: .ang of EDAX OIM and .ctf
of Oxford AZtec and Bruker Esprit as in the tests of orix 0.15 (orix/tests/conftest.py), the numbers
of phases in .ang as in the notes of EDAX that MTEX cites (interfaces/loadEBSD_ang.m). Points and
angles are of these tests alone.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
from numpy.typing import ArrayLike

from meshes.arrays import FloatArray

FIRST, SECOND = (281.0, 8.0, 47.0), (211.0, 45.0, 150.0)
FOUR_PI = 12.56637
IRON, TITANIUM = ("Iron - Alpha", "43", 11, 229), ("Titanium - Alpha", "62", 9, 194)
"""Name, symmetry of EDAX, number of the Laue class of Oxford and of the space group."""
Phase = tuple[str, str, int, int]


def grid(rows: int, columns: int, step: float = 0.5) -> tuple[FloatArray, FloatArray]:
    """x and y of a square grid [µm], row by row."""
    y, x = np.mgrid[:rows, :columns] * step
    return x.ravel(), y.ravel()


def hexagonal_grid(rows: int, columns: int, step: float = 0.5) -> tuple[FloatArray, FloatArray]:
    """x and y of a hexagonal grid [µm]; each second row begins half a step later, a point less."""
    x = [step * np.arange(columns - row % 2) + step / 2 * (row % 2) for row in range(rows)]
    y = [np.full(len(along), row * step * 3**0.5 / 2) for row, along in enumerate(x)]
    return np.concatenate(x), np.concatenate(y)


def halves(x: FloatArray, at: float) -> FloatArray:
    """Angles of a bicrystal: the first grain below an x, the second from there on."""
    return np.where((x < at)[:, None], FIRST, SECOND)


def write_ang(
    path: Path,
    x: FloatArray,
    y: FloatArray,
    degrees: ArrayLike,
    phase: ArrayLike = 0,
    *,
    confidence: ArrayLike = 0.9,
    phases: tuple[Phase, ...] = (IRON,),
    hexagonal: bool = False,
    grains: ArrayLike | None = None,
    header: dict[str, str] | None = None,
) -> Path:
    """Write a map of EDAX; a single phase is 0 among its points, more are counted from 1."""
    n, columns = x.size, np.unique(x[y == y.min()]).size
    rows = np.unique(y).size
    entries = {
        "GRID": "HexGrid" if hexagonal else "SqrGrid",
        "XSTEP": f"{np.diff(x[y == y.min()])[0]:.6f}" if columns > 1 else "0.500000",
        "YSTEP": f"{np.diff(np.unique(y))[0]:.6f}" if rows > 1 else "0.500000",
        "NCOLS_ODD": str(columns),
        "NCOLS_EVEN": str(columns - hexagonal),
        "NROWS": str(rows),
    } | (header or {})
    lines = ["# TEM_PIXperUM          1.000000", "# x-star                0.413900", "#"]
    for number, (name, symmetry, _, _) in enumerate(phases, start=1):
        lines += [
            f"# Phase {number}",
            f"# MaterialName  \t{name}",
            f"# Formula     \t{name[:2]}",
            "# Info",
            f"# Symmetry              {symmetry}",
            "# LatticeConstants      2.870 2.870 2.870  90.000  90.000  90.000",
            "# NumberFamilies        4",
            "# hklFamilies   \t 1  1  0 1 0.000000 1",
            "# Categories0 0 0 0 0",
        ]
    lines += ["#", *(f"# {key}: {value}" for key, value in entries.items())]
    lines += ["#", "# OPERATOR: \tsem", "#", "# SAMPLEID: \t", "#", "# SCANID: \t", "#"]
    if grains is not None:
        lines.append(
            "# Column names: phi1, Phi, phi2, x, y, image_quality, confidence_index, phase_id, "
            "detector_signal, pattern_fit, grain_id"
        )
    radians = np.broadcast_to(np.deg2rad(degrees), (n, 3)).copy()
    marks = np.broadcast_to(confidence, n)
    radians[marks == -1] = FOUR_PI
    ids = np.zeros(n) if grains is None else np.broadcast_to(grains, n)
    for i in range(n):
        angles = "".join(f"{angle:9.5f} " for angle in radians[i])
        number = np.broadcast_to(phase, n)[i]
        line = f"{angles} {x[i]:12.5f} {y[i]:12.5f} 1000.0 {marks[i]:6.3f} {number:2d} 0 1.200"
        lines.append(line + ("" if grains is None else f" {ids[i]:.1f}"))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_ctf(
    path: Path,
    x: FloatArray,
    y: FloatArray,
    degrees: ArrayLike,
    phase: ArrayLike = 1,
    *,
    phases: tuple[Phase, ...] = (IRON,),
    header: dict[str, str] | None = None,
    comma: bool = False,
) -> Path:
    """Write a channel text file; points of phase 0 are not indexed, headers may have commas."""
    columns, rows = np.unique(x).size, np.unique(y).size
    entries = {
        "JobMode": "Grid",
        "XCells": str(columns),
        "YCells": str(rows),
        "XStep": f"{np.diff(np.unique(x))[0]:.4f}" if columns > 1 else "0.5000",
        "YStep": f"{np.diff(np.unique(y))[0]:.4f}" if rows > 1 else "0.5000",
        "AcqE1": "0.0000",
        "AcqE2": "0.0000",
        "AcqE3": "0.0000",
    } | (header or {})
    lines = ["Channel Text File", "Prj\tsteel", "Author\t[Unknown]"]
    lines += [f"{key}\t{value}" for key, value in entries.items()]
    lines += ["Euler angles refer to Sample Coordinate system (CS0)!\tMag\t180.0000\tCoverage\t97"]
    lines += [f"Phases\t{len(phases)}"]
    lines += [
        f"2.867;2.867;2.867\t90.000;90.000;90.000\t{name}\t{laue}\t{space}\t\t\tSome reference"
        for name, _, laue, space in phases
    ]
    if comma:
        lines = [line.replace(".", ",") for line in lines]
    lines.append("Phase\tX\tY\tBands\tError\tEuler1\tEuler2\tEuler3\tMAD\tBC\tBS")
    angles = np.broadcast_to(degrees, (x.size, 3))
    for i, number in enumerate(np.broadcast_to(phase, x.size)):
        turned = angles[i] if number else (0.0, 0.0, 0.0)
        place = (f"{value:.4f}" for value in (x[i], y[i]))
        euler = (f"{angle:.4f}" for angle in turned)
        lines.append("\t".join([str(number), *place, "8", "0", *euler, "0.5000", "150", "200"]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_bruker(path: Path, x: FloatArray, y: FloatArray, degrees: ArrayLike) -> Path:
    """Write an HDF5 file of Bruker, whose X SAMPLE falls along the rows of the map."""
    n = x.size
    angles = np.broadcast_to(degrees, (n, 3))
    data = dict.fromkeys(
        ("PCX", "PCY", "DD", "MAD", "MADPhase", "NIndexedBands", "RadonBandCount", "RadonQuality",
         "X BEAM", "Y BEAM", "Z SAMPLE"), np.zeros(n)
    )  # fmt: skip
    data |= {"X SAMPLE": x.max() - x, "Y SAMPLE": y, "Phase": np.ones(n, dtype=np.int32)}
    data |= dict(zip(("phi1", "PHI", "phi2"), angles.T, strict=True))
    with h5py.File(path, "w") as file:
        file["Manufacturer"], file["Version"] = b"Bruker Nano", b"Esprit 2.X"
        scan = file.create_group("Scan 0/EBSD")
        for name, values in data.items():
            scan[f"Data/{name}"] = values
        scan["Header/Grid Type"] = b"isometric"
        scan["Header/NROWS"], scan["Header/NCOLS"] = np.unique(y).size, np.unique(x).size
        phase = scan.create_group("Header/Phases/1")
        phase["Name"], phase["IT"] = b"iron", b"229"
        phase["LatticeConstants"] = [2.87, 2.87, 2.87, 90.0, 90.0, 90.0]
        phase["AtomPositions/1"] = b"Fe,0,0,0,1"
    return path
