"""A process of its own that simulates once and prints what it needed: cells, images, bytes."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np

from driver.forward.build import adapter_of, build_model, mesh_of
from driver.virtual.truth import stage_program
from tools.three_grains import three_grains


def main(kind: str, size: float) -> None:
    """Pull a bar of three grains to its first turning point and back, in four images."""
    cells = {"cells": kind, "mesh_size_um": 2.0, "fine_mesh_size_um": 1.0}
    case = three_grains(specimen=cells, material={"strain_measure": "small"})
    mesh, history = mesh_of(case, size), stage_program([(2, 1)])
    model = build_model(case, mesh, history, np.array([[0.0, 6.0]]), adapter_of(case), 1)
    model.predict(model.null_values() | {"elongation_1": 0.1, "elongation_2": 0.09})
    # Of this program alone: `ru_maxrss` begins with what the process had that started it.
    (peak,) = re.findall(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text("utf-8"))
    print(len(mesh.cells), history.n_images, 1024 * int(peak))


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
