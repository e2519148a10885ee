"""How large the images of a case are, from the headers of their files."""

from __future__ import annotations

from dataclasses import dataclass

from driver.case.model import Case
from driver.experiment.images.files import files_of, split_dataset
from driver.experiment.images.headers import header


@dataclass(frozen=True)
class StackSize:
    """Size of a stack.

    Attributes:
        n: number of frames.
        pixels: of a frame.
        stored: bytes of a pixel in the file.
    """

    n: int
    pixels: int
    stored: int


def stack_size(case: Case, key: str) -> StackSize | None:
    """Size of the frames, flats or repeats of a case, all files as large as the first.

    Returns:
        None where the case names none, or no header can be read: reading them tells why.
    """
    name: str | None = getattr(case.images, key)
    if name is None:
        return None
    path, dataset = split_dataset(case.path(name))
    try:
        files = files_of(path)
        shape, kind = header(files[0], dataset)
        n, rows, columns = shape if len(shape) == 3 else (1, *shape)
    except Exception:  # every decoder raises its own types at a header that it cannot read
        return None
    return StackSize(len(files) * n, rows * columns, kind.itemsize)
