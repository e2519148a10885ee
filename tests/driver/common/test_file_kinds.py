from __future__ import annotations

import gzip
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile
from PIL import Image

from driver.common.file_kinds import EMPTY, TIFF_FILE, kind_by_content


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("a.png", "a PNG picture"), ("a.jpg", "a JPEG picture"), ("a.gif", "a GIF picture"),
        ("a.pdf", "a PDF document"), ("a.tif", TIFF_FILE), ("big.tif", TIFF_FILE),
        ("a.h5", "an HDF5 file"), ("a.zip", "a workbook (.xlsx, .ods) or another ZIP archive"),
        ("a.gz", "a file compressed by gzip"), ("a.txt", ""), ("none.txt", EMPTY),
    ],
)  # fmt: skip
def test_a_file_is_known_by_what_other_programs_write(name: str, kind: str, tmp_path: Path) -> None:
    path = tmp_path / name
    pixels = np.zeros((4, 4), np.uint8)
    if path.suffix in (".png", ".jpg", ".gif", ".pdf"):
        Image.fromarray(pixels).save(path)
    elif path.suffix == ".tif":
        tifffile.imwrite(path, pixels, bigtiff=name == "big.tif", byteorder=">")
    elif path.suffix == ".h5":
        h5py.File(path, "w").close()
    elif path.suffix == ".zip":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("sheet.xml", "")
    elif path.suffix == ".gz":
        path.write_bytes(gzip.compress(b"text"))
    else:
        path.write_text("time_s,stage_um\n" if name == "a.txt" else "")
    assert kind_by_content(path) == kind
