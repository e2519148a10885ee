"""Arrays packed into a page: whole numbers of two bytes, compressed, as base64 text."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshes.arrays import FloatArray

NOTHING = -32768
"""The number that stands for NaN."""
_LARGEST = 32767


@dataclass(frozen=True)
class PackedArrays:
    """Arrays as text.

    Attributes:
        entries: of each array by name its "shape", the "step" that its numbers count, and "at",
            the place of its first byte; all low bytes of an array stand before its high bytes.
        text: all bytes, compressed by gzip, as base64.
    """

    entries: dict[str, dict[str, Any]]
    text: str


def pack(arrays: Mapping[str, tuple[FloatArray, float]]) -> PackedArrays:
    """Pack arrays.

    Args:
        arrays: values and the step to which they are rounded, which grows where the largest value
            asks for it, by name.
    """
    entries: dict[str, dict[str, Any]] = {}
    parts: list[bytes] = []
    at = 0
    for name, (values, least) in arrays.items():
        largest = float(np.nanmax(np.abs(values), initial=0.0, where=np.isfinite(values)))
        step = max(least, largest / _LARGEST)
        counted = np.where(np.isfinite(values), np.round(np.nan_to_num(values) / step), NOTHING)
        entries[name] = {"shape": list(values.shape), "step": step, "at": at}
        # Bytes that are alike stand together: fewer are left after compression.
        parts.append(counted.astype("<i2").reshape(-1, 1).view(np.uint8).T.tobytes())
        at += len(parts[-1])
    return PackedArrays(entries, compressed_text(b"".join(parts)))


def unpack(packed: PackedArrays) -> dict[str, FloatArray]:
    """Return the arrays by name, as the page reads them."""
    content = np.frombuffer(gzip.decompress(base64.b64decode(packed.text)), np.uint8)
    arrays: dict[str, FloatArray] = {}
    for name, entry in packed.entries.items():
        n = int(np.prod(entry["shape"]))
        planes: NDArray[np.uint8] = content[entry["at"] : entry["at"] + 2 * n].reshape(2, n)
        counted = np.ascontiguousarray(planes.T).view("<i2")[:, 0].reshape(entry["shape"])
        arrays[name] = np.where(counted == NOTHING, np.nan, counted * entry["step"])
    return arrays


def compressed_text(content: bytes) -> str:
    """Return bytes compressed by gzip as base64, the same ones for the same content."""
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode("ascii")
