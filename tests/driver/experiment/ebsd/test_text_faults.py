from __future__ import annotations

from pathlib import Path

import pytest

from driver.experiment.ebsd.text_faults import text_fault
from tests.driver.ebsd_files import grid, halves, write_ang, write_ctf

X, Y = grid(4, 6)


@pytest.mark.parametrize("write", [write_ang, write_ctf])
def test_a_sound_file_has_no_fault(write: object, tmp_path: Path) -> None:
    for options in ({}, {"comma": True}) if write is write_ctf else ({},):
        path = tmp_path / ("map.ang" if write is write_ang else "map.ctf")
        write(path, X, Y, halves(X, 1.0), **options)  # type: ignore[operator]
        assert text_fault(path) is None


def test_the_first_fault_is_told_with_its_line(tmp_path: Path) -> None:
    path = write_ang(tmp_path / "map.ang", X, Y, halves(X, 1.0))
    rows = path.read_text("utf-8").splitlines()
    wrong = {
        rows[-1].rsplit(None, 3)[0]: f"7 of 10 columns in line {len(rows)}",
        rows[-1].replace("0.900", "nan"): f'"nan" in line {len(rows)}',
        rows[-1].replace("0.900", "N/A"): f'"N/A" in line {len(rows)}',
    }
    for row, found in wrong.items():
        path.write_text("\n".join([*rows[:-1], row]), "utf-8")
        fault = text_fault(path)
        assert fault is not None and fault.found == found
        assert fault.expected == "an .ang file that is whole: export it anew"
