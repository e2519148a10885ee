"""What a file is by its first bytes, where its ending says something else."""

from __future__ import annotations

from pathlib import Path

TIFF_FILE, EMPTY = "a TIFF file", "an empty file"
_LONGEST = 8
# First bytes, as the specifications of these formats have them.
_KINDS = (
    (b"\x89PNG\r\n\x1a\n", "a PNG picture"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"GIF8", "a GIF picture"),
    (b"%PDF-", "a PDF document"),
    (b"II*\0", TIFF_FILE),
    (b"MM\0*", TIFF_FILE),
    (b"II+\0", TIFF_FILE),
    (b"MM\0+", TIFF_FILE),
    (b"\x89HDF\r\n\x1a\n", "an HDF5 file"),
    (b"\xd0\xcf\x11\xe0", "a workbook of Excel or another document of Office"),
    (b"PK\x03\x04", "a workbook (.xlsx, .ods) or another ZIP archive"),
    (b"\x1f\x8b", "a file compressed by gzip"),
    (b"7z\xbc\xaf", "a 7-Zip archive"),
)


def kind_by_content(file: Path) -> str:
    """Return what a file is by its first bytes, empty where they are none of those known.

    Raises:
        OSError: it cannot be read.
    """
    with file.open("rb") as content:
        first = content.read(_LONGEST)
    if not first:
        return EMPTY
    return next((kind for mark, kind in _KINDS if first.startswith(mark)), "")
