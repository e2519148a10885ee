"""With which power of the size the error of the mesh falls, in the motion of the face and the load.

    python -m benchmarks.mesh_order          the short specimen and five draws, half an hour
    python -m benchmarks.mesh_order 0 1 2    the short specimen and these draws

The specimen of the blind trial, and draws of `benchmarks.mesh_calibration`. Predictions on smaller
and smaller cells are compared from size to size: three sizes tell a power without a reference. By
which power loads of both kinds of cells agree best is told as well: by that references are made.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from benchmarks.mesh_calibration import redrawn
from benchmarks.numerics import Discretisation, Specimen, model_on, short_specimen
from meshes.arrays import FloatArray
from meshes.prism import CellKind
from tools.converged_truth import SMALLEST

SIZES: tuple[tuple[CellKind, tuple[float, ...]], ...] = (
    ("hex20", (1.0, 0.667, 0.5, 0.4, 0.333)),
    ("tet10", (0.8, 0.5, 0.35)),
)
DRAWS = (0, 3, 4, 5, 6)
OF_REFERENCES: dict[CellKind, tuple[float, float]] = dict(SMALLEST)
POWERS = (1.0, 1.25, 1.5, 1.75)
"""By which loads on the cells of a reference are extrapolated."""
_POWERS = 0.05, 6.0
"""Between which a power is sought."""


@dataclass(frozen=True, eq=False)
class Predicted:
    """A prediction on cells of one size.

    Attributes:
        size: of the cells, by their number: the cube root of one over it.
        motion: of the face at the pixels, without its mean [µm], shape (T, n_pix, 3).
        load: [µN], shape (T,).
    """

    size: float
    motion: FloatArray
    load: FloatArray


def main() -> None:
    """Print a line for each three sizes of each specimen and kind of cells."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("draws", nargs="*", type=int, default=DRAWS, help="numbers of draws")
    numbers = parser.parse_args().draws
    with tempfile.TemporaryDirectory() as folder:
        short = short_specimen(Path(folder))
        specimens = {"short": short} | {f"draw {k}": redrawn(short, k) for k in numbers}
        squares = []
        for name, specimen in specimens.items():
            loads = []
            for kind, sizes in SIZES:
                found = [predicted(specimen, kind, size) for size in sizes]
                for k in range(len(found) - 2):
                    told = " → ".join(f"{size:g}" for size in sizes[k : k + 3])
                    print(f"{name}, {kind} {told} µm: {orders(found[k : k + 3])}", flush=True)
                larger, smaller = (found[sizes.index(size)] for size in OF_REFERENCES[kind])
                loads.append(np.array([limit(larger, smaller, power) for power in POWERS]))
            squares.append(np.mean((loads[0] - loads[1]) ** 2, axis=1))
    apart = np.sqrt(np.mean(squares, axis=0))
    told = ", ".join(f"{p:g}: {off:.2f} µN" for p, off in zip(POWERS, apart, strict=True))
    print(f"loads of both kinds of cells apart, extrapolated by the power {told}")


def predicted(specimen: Specimen, kind: CellKind, size: float) -> Predicted:
    """Return the prediction of a specimen at its truth, with mean dilatation."""
    model = model_on(specimen.case, specimen.problem, Discretisation(kind, size, True))
    found = model.predict(model.null_values() | dict(specimen.truth))
    motion = found.motion - found.motion.mean(axis=1, keepdims=True)
    return Predicted(len(model.microstructure.mesh.cells) ** (-1 / 3), motion, found.load)


def limit(larger: Predicted, smaller: Predicted, power: float) -> FloatArray:
    """Return the load with cells of no size, extrapolated by a power of the size [µN], (T,)."""
    fallen: float = (smaller.size / larger.size) ** power
    return smaller.load + fallen / (1.0 - fallen) * (smaller.load - larger.load)


def orders(three: Sequence[Predicted]) -> str:
    """Say by which powers of three sizes motion and load change, and how alike both changes are."""
    sizes = [one.size for one in three]
    told = []
    for what in ("motion", "load"):
        fields = [getattr(one, what) for one in three]
        first, second = fields[1] - fields[0], fields[2] - fields[1]
        lengths = float(np.linalg.norm(first)), float(np.linalg.norm(second))
        cosine = float(np.sum(first * second)) / (lengths[0] * lengths[1])
        power = power_of(sizes, lengths[0] / lengths[1])
        told.append(f"{what} with the power {power:.2f} (cosine {cosine:.3f})")
    return ", ".join(told)


def power_of(sizes: Sequence[float], ratio: float) -> float:
    """Return p for which (a^p − b^p)/(b^p − c^p) of three falling sizes is a ratio.

    NaN where no p within `_POWERS` is.
    """
    a, b, c = sizes

    def off(p: float) -> float:
        found: float = (a**p - b**p) / (b**p - c**p)
        return found - ratio

    if off(_POWERS[0]) * off(_POWERS[1]) > 0:
        return float("nan")
    power: float = brentq(off, *_POWERS)
    return power


if __name__ == "__main__":
    main()
