"""What other programs make of an image pair: run by their own interpreter, without prismid.

    PEERS/bin/python benchmarks/dic_peers.py pair.npz

The file holds f, g, roi ((x0, y0), (x1, y1)) and the true u, v (x right, y down) at the pixels of
f. Prints one JSON line per program and setting: root mean square error of u and v [px], CPU
time [s] from arrays in memory to nodal displacements, the best of the repeats.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

ELEMENT = 16  # px
SUBSET, STEP = 21, 8  # px
REACH = 16  # px, of the first search of pyvale: its default of 64 is too wide for the small pair
REPEATS = 3

Answer = tuple[float, float, float]


def timed(work: Callable[[], Any], repeats: int = REPEATS) -> tuple[Any, float]:
    """Return the result of the last call, CPU time of the fastest [s]."""
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        result = work()
        best = min(best, time.process_time() - start)
    return result, best


def rms(found: Any, truth: Any) -> float:
    """Root mean square of the difference."""
    return float(np.sqrt(np.mean((np.asarray(found) - truth) ** 2)))


def pyxel(pair: Any) -> Iterator[tuple[str, Answer]]:
    """Global DIC on Q4 elements: default solver, direct solver, more and fewer points."""
    import pyxel as px

    def image(values: Any) -> Any:
        made = px.Image("array")
        made.pix = values.astype(float)
        return made

    (x0, y0), (x1, y1) = pair["roi"]
    for name, points, direct in (
        ("one point a pixel, conjugate gradients", ELEMENT, False),
        ("one point a pixel, direct", ELEMENT, True),
        ("one point for 4 pixels, direct", ELEMENT // 2, True),
    ):

        def work(points: int = points, direct: bool = direct) -> Any:
            f, g = image(pair["f"]), image(pair["g"])
            mesh, camera = px.MeshFromROI(np.array([[x0, y0], [x1 - 1, y1 - 1]]), ELEMENT, 3)
            mesh.Connectivity()
            mesh.DICIntegrationFast(points)
            values, _ = px.Correlate(f, g, mesh, camera, disp=False, direct=direct)
            return mesh, camera, values

        (mesh, camera, values), cpu = timed(work)
        mesh.DICIntegrationFast(ELEMENT)
        x, y = (np.asarray(c) for c in camera.P(mesh.pgx, mesh.pgy))
        moved = camera.P(mesh.pgx + mesh.phix @ values, mesh.pgy + mesh.phiy @ values)
        yield (
            name,
            (rms(moved[0] - x, at(pair["u"], x, y)), rms(moved[1] - y, at(pair["v"], x, y)), cpu),
        )


def mudic(pair: Any) -> Iterator[tuple[str, Answer]]:
    """Global DIC on Q4 elements."""
    import muDIC as dic

    (x0, y0), (x1, y1) = pair["roi"]

    def work() -> Any:
        stack = dic.image_stack_from_list([pair["f"].astype(float), pair["g"].astype(float)])
        mesher = dic.Mesher(deg_e=1, deg_n=1, type="q4")
        mesh = mesher.mesh(
            stack, Xc1=x0, Xc2=x1 - 1, Yc1=y0, Yc2=y1 - 1,
            n_elx=round((x1 - x0 - 1) / ELEMENT), n_ely=round((y1 - y0 - 1) / ELEMENT), GUI=False,
        )  # fmt: skip
        results = dic.DICAnalysis(dic.DICInput(mesh, stack, maxit=30)).run()
        return mesh, results

    (mesh, results), cpu = timed(work, 1 if pair["f"].size > 1e5 else REPEATS)
    fields = dic.Fields(results, seed=ELEMENT)
    x, y = fields.coords()[0, :, :, :, 0]
    u, v = fields.disp()[0, :, :, :, 1]
    yield "Q4", (rms(u, at(pair["u"], x, y)), rms(v, at(pair["v"], x, y)), cpu)


def sundic(pair: Any) -> Iterator[tuple[str, Answer]]:
    """Local DIC, affine subsets, one process."""
    import sundic.post_process as post
    import sundic.settings as settings
    import sundic.sundic as sd
    from PIL import Image

    (x0, y0), (x1, y1) = pair["roi"]
    with tempfile.TemporaryDirectory() as folder:
        for name in "fg":
            values = np.clip(np.round(pair[name]), 0, 255).astype(np.uint8)
            Image.fromarray(values).save(Path(folder) / f"{name}.tif")
        choice = settings.Settings()
        choice.ImageFolder, choice.CPUCount, choice.DebugLevel = folder, 1, 0
        choice.SubsetSize, choice.StepSize = SUBSET, STEP
        choice.ROI = [int(x0), int(y0), int(x1 - x0), int(y1 - y0)]
        choice.DatumImage, choice.TargetImage, choice.Increment = 0, -1, 1
        file = str(Path(folder) / "out.sdic")
        _, cpu = timed(lambda: sd.planarDICLocal(choice, file), 1)
        table, *_ = post.getDisplacements(file, 0)
    x, y, u, v = (np.asarray(table)[:, k] for k in (0, 1, 3, 4))
    good = np.isfinite(u) & np.isfinite(v)
    x, y, u, v = x[good], y[good], u[good], v[good]
    yield f"subset {SUBSET}", (rms(u, at(pair["u"], x, y)), rms(v, at(pair["v"], x, y)), cpu)


def pyvale(pair: Any) -> Iterator[tuple[str, Answer]]:
    """Local DIC, one thread: affine and quadratic subsets, as dense as nodes too."""
    import pyvale.dic as pv

    (x0, y0), (x1, y1) = (tuple(map(int, corner)) for corner in pair["roi"])
    f, g = (np.clip(np.round(pair[name]), 0, 255).astype(np.uint8) for name in "fg")
    mask = np.zeros(f.shape, dtype=bool)
    mask[y0:y1, x0:x1] = True
    for shape, step in (("AFFINE", STEP), ("QUAD", STEP), ("QUAD", ELEMENT)):
        with tempfile.TemporaryDirectory() as folder:

            def work(folder: str = folder, shape: str = shape, step: int = step) -> None:
                pv.calculate_2d(
                    f, g, mask, [((x0 + x1) // 2, (y0 + y1) // 2)], SUBSET, step,
                    shape_function=shape, max_displacement=REACH, num_threads=1,
                    output_basepath=folder, output_delimiter=",", print_level=0,
                )  # fmt: skip

            _, cpu = timed(work)
            table = pv.import_2d(list(Path(folder).iterdir()), ",", layout="column", print_level=0)
        x, y, u, v = table.ss_x, table.ss_y, table.u_px[0], table.v_px[0]
        yield (
            f"{shape.lower()} subset {SUBSET}, step {step}",
            (rms(u, at(pair["u"], x, y)), rms(v, at(pair["v"], x, y)), cpu),
        )


def at(field: Any, x: Any, y: Any) -> Any:
    """Return a field at positions, linear between pixels."""
    column, row = np.clip(x, 0, field.shape[1] - 1.001), np.clip(y, 0, field.shape[0] - 1.001)
    i, j = row.astype(int), column.astype(int)
    s, t = row - i, column - j
    return (
        (1 - s) * ((1 - t) * field[i, j] + t * field[i, j + 1])
        + s * ((1 - t) * field[i + 1, j] + t * field[i + 1, j + 1])
    )  # fmt: skip


def main() -> None:
    """Let each program that is installed measure the pair."""
    pair = dict(np.load(sys.argv[1]))
    chosen = sys.argv[2:] or ["pyxel", "mudic", "sundic", "pyvale"]
    for program in (pyxel, mudic, sundic, pyvale):
        if program.__name__ not in chosen:
            continue
        try:
            with (
                contextlib.redirect_stdout(io.StringIO()),
                contextlib.redirect_stderr(io.StringIO()),
            ):
                answers = list(program(pair))
        except Exception as error:  # a peer's fault is a line of the report, not the end of it
            print(
                json.dumps(
                    {"program": program.__name__, "failed": f"{type(error).__name__}: {error}"}
                )
            )
            continue
        for setting, (u, v, cpu) in answers:
            line = {"program": program.__name__, "setting": setting, "u": u, "v": v, "cpu": cpu}
            print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
