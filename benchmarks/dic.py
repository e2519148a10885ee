"""Accuracy, covariance, speed and memory of the correlation, beside four other programs.

    python -m benchmarks.dic --data DIR [--peers PYTHON]   the reference pairs in DIR
    python -m benchmarks.dic --quick                       the small pairs of the tests, 45 s

DIR holds `synthetic`, `semi_afm`, `challenge1_sample14`, `opencorr_shear` and `afm_di6`. PYTHON is
an interpreter with pyxel-dic, muDIC, SUN-DIC and pyvale; they then measure the same pairs in the
same run.
Times are CPU times of one thread, after compilation, the best of three.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from matplotlib import image as mpl_image
from numpy.typing import NDArray

from benchmarks.measuring import in_child, show
from driver.case.model import load_case
from driver.dic.correlation import Correlation, Options, correlate
from driver.dic.elongation import edge_motion
from driver.dic.series import measure
from driver.experiment.history import knot_weights, read_history
from driver.experiment.images.rigid import shift_between
from driver.experiment.reading import read_experiment
from driver.forward.build import surface_images
from driver.noise_floor.floor import relief_rms
from driver.noise_floor.laboratory import elongation, laboratory
from driver.noise_floor.motions import known_motions
from meshes.arrays import FloatArray
from meshes.plane_mesh import PlaneMesh

ROOT = Path(__file__).parents[1]
SMALL = ROOT / "tests" / "data" / "dic"
ALPHA = ROOT / "examples" / "alpha" / "case.toml"
KNOTS = 1e-3 * np.array([0.0, 64, 56, 128, 120, 192, 184])  # µm, the truth of examples/alpha
LEVEL_NM, PIXEL_NM = 6.5, 110.0
GOALS = {"TN": "<= 0.014", "HN": "<= 0.030", "HW": "<= 0.042"}
FIXED = Options(roughness=0.3, roughness_w=np.inf)
NOISE = float(np.hypot(9.0 / LEVEL_NM, 12**-0.5))  # levels, rounding included
DRAWS = 100
MARGIN = 10  # px: half the subset of benchmarks/dic_peers.py, where subsets have no centres


def read_pair(folder: Path, name: str) -> dict[str, Any]:
    """f, g [levels], the mask of the region of interest, u, v [px], w [levels]."""
    f, g = (tifffile.imread(folder / f"{name}_{w}.tif").astype(np.float64) for w in "fg")
    truth = np.load(folder / f"{name}_truth.npz")
    (x0, y0), (x1, y1) = truth["roi"]
    mask = np.zeros(f.shape, dtype=bool)
    mask[y0:y1, x0:x1] = True
    return {"f": f, "g": g, "mask": mask, **{k: truth[k] for k in ("u", "v", "w", "roi")}}


def errors(found: Correlation, pair: dict[str, Any], margin: int = 0) -> FloatArray:
    """Root mean square error of u, v [px], w [levels]; u along the columns as in the truth.

    A margin [px] at the border of the region of interest is left out.
    """
    motion = found.at_pixels()
    truth = [pair[k][pair["mask"]] for k in ("v", "u", "w")]
    (x0, y0), (x1, y1) = pair["roi"]
    rows, cols = np.nonzero(pair["mask"])
    inner = np.minimum(np.minimum(cols - x0, x1 - 1 - cols), np.minimum(rows - y0, y1 - 1 - rows))
    deviation = (motion - np.column_stack(truth))[inner >= margin]
    v, u, w = np.sqrt(np.mean(deviation**2, axis=0))
    return np.array([u, v, w])


def cpu_of(pair: dict[str, Any], options: Options | None, repeats: int = 3) -> float:
    """CPU time of one correlation [s], the best of the repeats."""
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        correlate(pair["f"], pair["g"], mask=pair["mask"], sigma=NOISE, options=options)
        best = min(best, time.process_time() - start)
    return best


def synthetic(folder: Path, size: str, cases: tuple[str, ...]) -> None:
    """Errors on the synthetic pairs, everything left to its default."""
    for case in cases:
        p = read_pair(folder, f"{size}_{case}")
        motion = correlate(p["f"], p["g"], mask=p["mask"])
        u, v, w = errors(motion, p)
        goal = GOALS[case] if size == "m" else None
        show(f"u rmse {size} {case} [px]", u, goal)
        show(f"v rmse {size} {case} [px]", v)
        goal_w = "<= 0.75" if case == "HW" and size == "m" else None
        show(f"w rmse {size} {case} [levels]", w, goal_w)
        show(f"noise found {size} {case} [levels]", motion.sigma, f"{NOISE:.3f}")


def covariance(folder: Path) -> None:
    """Scatter over noise draws against the stated covariance, on the relief of a small pair."""
    pair = read_pair(folder, "s_HN")
    rng = np.random.default_rng(1)
    options = Options(roughness=1.0, roughness_w=np.inf)
    for name, image in (("still", pair["f"]), ("moved", pair["g"])):
        draws = image + NOISE * rng.normal(size=(DRAWS, *image.shape))
        motion = correlate(pair["f"], draws, mask=pair["mask"], sigma=NOISE, options=options)
        scatter = motion.coefficients - motion.coefficients.mean(axis=0)
        precision = np.linalg.inv(motion.covariance_one())
        n = scatter.shape[1]
        ratio = np.einsum("ti,ij,tj->", scatter, precision, scatter) / (n * (DRAWS - 1))
        show(f"scatter over stated covariance, 100 draws, {name} [sigma]", ratio**0.5, "0.9 to 1.1")


def sample14(folder: Path) -> None:
    """DIC Challenge: u varies along the columns only, so the elements are strips across."""
    folder = folder / "challenge1_sample14"
    f = tifffile.imread(folder / "Sample14 Reference.tif").astype(np.float64)
    g = tifffile.imread(folder / "Sample14 L3 Amp0.1b.tif").astype(np.float64)
    mask = inset(f.shape, 30)
    command = np.loadtxt(folder / "command.csv", delimiter=",")[:, 3]
    elastic = Options(penalty="elastic")
    for name, mesh, goal, options in (
        ("quad8 strips of 64 px", strips(f.shape, 30, 64), "<= 0.006", elastic),
        ("Q4 of 16 px", 16.0, None, None),
    ):
        motion = correlate(f, g, mask=mask, mesh_uv=mesh, mesh_w=200.0, options=options)
        error = motion.at_pixels()[:, 1] - command[motion.system.pixels.cols.astype(int)]
        show(f"u rmse sample 14, {name} [px]", float(np.sqrt(np.mean(error**2))), goal)


def shear(folder: Path) -> None:
    """Correlate a speckle sheared by 0.01 about (250, 250)."""
    names = ("Pattern_1.bmp", "Pattern_1_Shear.bmp")
    images = [np.asarray(mpl_image.imread(folder / "opencorr_shear" / n), float) for n in names]
    f, g = (i if i.ndim == 2 else i[..., 0] for i in images)
    motion = correlate(f, g, mask=inset(f.shape, 20))
    at = motion.system.pixels
    place = np.column_stack([at.rows, at.cols, np.ones_like(at.rows)])
    slopes = np.linalg.lstsq(place, motion.at_pixels()[:, :2], rcond=None)[0][:2]
    error = np.abs(slopes - [[0.0, 0.01], [0.01, 0.0]]).max()
    show("largest error of the mean strain, sheared speckle", float(error), "<= 1e-5")


def repeat_scans(folder: Path) -> None:
    """Measure rigid motions: of AFM texture of known shift, and of two AFM scans of one area."""
    pair = read_pair(folder / "semi_afm", "semi_afm_TN")
    truth = np.array([pair["v"].mean(), pair["u"].mean()])
    f, g = pair["f"], pair["g"]
    measured = np.array(shift_between(f, g, 1.0, pair["mask"])[:2])
    goal = "<= 0.02"
    show(
        "AFM texture, known shift: error of the rigid shift [px]",
        np.abs(measured - truth).max(),
        goal,
    )
    wrong = np.abs(np.array(whole_frame_phase(f, g)) - truth).max()
    show("the same by whitened phase correlation of the whole frame [px]", wrong)
    scans = np.load(folder / "afm_di6" / "afm_di6_trace_retrace.npz")
    f, g = (scans[k].astype(np.float64) for k in ("f_nm", "g_nm"))
    mask = inset(f.shape, 20)
    whole, rigid = whole_frame_phase(f, g), shift_between(f, g, 1.0, mask)
    correlated = correlate(f, g, mask=mask, mesh_uv=64.0, mesh_w=16.0)
    motion, at = correlated.at_pixels(), correlated.system.pixels
    line = np.polynomial.Polynomial.fit(at.cols, motion[:, 0], 1)
    for axis, name, stated in ((0, "rows", "0.30"), (1, "columns", "-0.03")):
        show(f"AFM scans, rigid shift along the {name} [px]", rigid[axis], f"{stated} +- 0.02")
        show(f"AFM scans, mean of the correlation along the {name} [px]", motion[:, axis].mean())
        show(
            f"AFM scans, whitened phase correlation, whole frame, {name} [px]", whole[axis], stated
        )
        show(f"AFM scans, scatter of the shift over the area, {name} [px]", motion[:, axis].std())
    show("AFM scans, shift along the rows at the first column [px]", float(line(0.0)), "1")
    show("AFM scans, shift along the rows at the last column [px]", float(line(511.0)), "0")


def whole_frame_phase(f: FloatArray, g: FloatArray, finer: int = 100) -> tuple[float, float]:
    """Peak of the whitened cross-power spectrum without a window, to 1/100 px.

    What `skimage.registration.phase_cross_correlation` does by default: the frame counts as
    periodic, and the jump at its border, at the same place in both images, as a pattern.
    """
    cross = np.conj(np.fft.fft2(f - f.mean())) * np.fft.fft2(g - g.mean())
    cross /= np.maximum(np.abs(cross), np.finfo(float).tiny)
    peak = np.fft.ifft2(cross).real
    frequency = [np.fft.fftfreq(n) for n in f.shape]
    near = np.arange(-2 * finer, 2 * finer + 1) / finer
    top = np.unravel_index(int(peak.argmax()), peak.shape)
    places = [(at + n // 2) % n - n // 2 + near for at, n in zip(top, peak.shape, strict=True)]
    waves = [np.exp(2j * np.pi * np.outer(x, k)) for x, k in zip(places, frequency, strict=True)]
    fine = (waves[0] @ cross @ waves[1].T).real
    row, col = np.unravel_index(int(fine.argmax()), fine.shape)
    return float(places[0][row]), float(places[1][col])


def laboratory_scatter() -> None:
    """Scatter of 96 images of each motion of the laboratory, against the stated covariance."""
    case = load_case(ALPHA)
    images = surface_images(case, read_experiment(case))
    size_uv, size_w = 16 * images.pixel, 8 * images.pixel
    length = case.specimen.length
    motions = known_motions(images.pixel, length, case.specimen.width, relief_rms(images))
    made = laboratory(images, motions, length)
    nodal, stretch, stated = [], [], []
    for number in range(DRAWS // 2):
        series = made.series(1000 + number)
        motion = measure(series, size_uv, size_w)
        n_uv = 2 * len(motion.basis_uv.nodes)
        # The two images of a motion in one series: their difference is free of the reference.
        p = motion.coefficients[:, :n_uv].reshape(len(motions), 2, -1)
        nodal.append(
            np.mean((p[:, 1] - p[:, 0]) ** 2 / 2 / motion.covariance_one.diagonal()[:n_uv])
        )
        measured, sigma = elongation(motion, series, length)
        stretch.append(np.var(measured.reshape(len(motions), 2), axis=1, ddof=1))
        stated.append(sigma**2 / (1 + 1 / motion.n_reference))
    ratio = np.sqrt(np.mean(stretch) / np.mean(stated))
    show(
        "laboratory, nodal u, v: scatter over stated [sigma]", np.sqrt(np.mean(nodal)), "0.9 to 1.1"
    )
    show("laboratory, elongation: scatter over stated [sigma]", ratio, "0.9 to 1.1")
    _, real = elongation(measure(images, size_uv, size_w), images, length)
    laboratory_sigma = np.sqrt(np.mean(stated) * (1 + 1 / images.n_reference))
    show("laboratory, stated elongation over that of the real series", laboratory_sigma / real, "1")


def alpha() -> None:
    """Elongation of the demo's images against its truth, and the time of 320 images."""
    case = load_case(ALPHA)
    images = surface_images(case, read_experiment(case))
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        motion = measure(images)
        best = min(best, time.process_time() - start)
    cpu = best * 320 / images.n_frames
    lower, upper = images.bounds[2:]
    reach = case.specimen.length / (upper - lower)
    edges = edge_motion(motion, images, lower, upper)
    history = read_history(ALPHA.parent / "history.csv")
    truth = knot_weights(history)[history.image_row] @ KNOTS
    deviation = (reach * edges.elongation - truth) / (reach * edges.elongation_sigma)
    within = 100 * float(np.mean(np.abs(deviation) <= 2))
    show("alpha, elongations within 2 sigma [%]", within, "95")
    show("alpha, largest deviation of an elongation [sigma]", float(np.abs(deviation).max()))
    show(
        "alpha, rms deviation of an elongation [sigma]", float(np.sqrt(np.mean(deviation**2))), "1"
    )
    show("320 images of the region of interest [CPU-s]", cpu, "<= 2")


def large_pair() -> float:
    """Correlate a pair of 4 Mpx; peak memory of the process [MB]."""
    rng = np.random.default_rng(2)
    spectrum = np.fft.rfft2(rng.normal(size=(2000, 2000)))
    k = np.hypot(np.fft.fftfreq(2000)[:, None], np.fft.rfftfreq(2000))
    spectrum *= np.exp(-0.5 * (2 * np.pi * 1.8 * k) ** 2)
    f = np.fft.irfft2(spectrum)
    g = np.fft.irfft2(spectrum * np.exp(-2j * np.pi * 0.3 * np.fft.fftfreq(2000)[:, None]))
    scale = 30 / f.std()
    motion = correlate(f * scale, g * scale, mask=inset(f.shape, 8), sigma=NOISE, options=FIXED)
    mean = motion.at_pixels()[:, 0].mean()
    if not abs(mean - 0.3) < 1e-3:
        raise RuntimeError(f"the pair of 4 Mpx was not followed: {mean} px instead of 0.3")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def peers(pair: dict[str, Any], python: str) -> list[dict[str, Any]]:
    """Return what the other programs make of the pair."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pair.npz"
        np.savez(file, **{k: pair[k] for k in ("f", "g", "u", "v", "roi")})
        command = [python, str(ROOT / "benchmarks" / "dic_peers.py"), str(file)]
        lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return [json.loads(line) for line in lines.splitlines()]


def beside(pair: dict[str, Any], size: str, python: str | None) -> None:
    """Time of a pair, and that of the other programs."""
    own = {"roughness given": cpu_of(pair, FIXED), "all estimated": cpu_of(pair, None)}
    for name, cpu in own.items():
        show(f"{size} pair, {name} [CPU-s]", cpu)
    if python is None:
        return
    inner = errors(correlate(pair["f"], pair["g"], mask=pair["mask"]), pair, MARGIN)
    for name, value in zip("uv", inner, strict=False):
        show(f"{size} pair, prismid {MARGIN} px from the border, {name} rmse [px]", value)
    best = np.inf
    for answer in peers(pair, python):
        if "failed" in answer:
            print(f"{answer['program']} failed: {answer['failed']}")
            continue
        name = f"{answer['program']} ({answer['setting']})"
        for axis in "uv":
            show(f"{size} pair, {name}, {axis} rmse [px]", answer[axis])
        show(f"{size} pair, {name} [CPU-s]", answer["cpu"])
        # Its best setting: the most accurate, the faster of equals.
        if answer["program"] == "pyxel" and "4 pixels" not in answer["setting"]:
            best = min(best, answer["cpu"])
    for name, cpu in own.items():
        show(f"{size} pair, CPU time of pyxel-dic over prismid, {name}", best / cpu, ">= 10")


def inset(shape: tuple[int, ...], margin: int) -> NDArray[np.bool_]:
    """All pixels but a margin."""
    mask = np.zeros(shape, dtype=bool)
    mask[margin:-margin, margin:-margin] = True
    return mask


def strips(shape: tuple[int, ...], margin: int, width: float) -> PlaneMesh:
    """Return a row of quad8 as high as the image."""
    n = round((shape[1] - 2 * margin) / width)
    x = np.linspace(margin, shape[0] - 1 - margin, 3)
    y = np.linspace(margin, shape[1] - 1 - margin, 2 * n + 1)
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    i = np.arange(3 * (2 * n + 1)).reshape(3, -1)
    left, middle, right = i[:, :-2:2], i[:, 1:-1:2], i[:, 2::2]
    corners = [left[0], left[2], right[2], right[0]]
    sides = [left[1], middle[2], right[1], middle[0]]
    cells = np.stack([*corners, *sides], axis=-1)
    used, local = np.unique(cells, return_inverse=True)
    return PlaneMesh(grid[used], local.reshape(cells.shape), "quad8")


def main() -> None:
    """Run the study and print a line for each figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the small pairs alone, within 45 s")
    parser.add_argument("--data", type=Path, help="folder of the reference pairs")
    parser.add_argument("--peers", help="Python interpreter of the other programs")
    choice = parser.parse_args()
    small = choice.data / "synthetic" if choice.data else SMALL
    synthetic(small, "s", ("HN", "HW"))
    covariance(small)
    laboratory_scatter()
    beside(read_pair(small, "s_HN"), "120 x 40", choice.peers)
    alpha()
    if choice.quick:
        return
    if choice.data is None:
        parser.error("--data DIR is needed without --quick: the folder of the reference pairs")
    synthetic(small, "m", ("TN", "HN", "HW"))
    sample14(choice.data)
    shear(choice.data)
    repeat_scans(choice.data)
    beside(read_pair(small, "m_HN"), "557 x 557", choice.peers)
    show("pair of 4 Mpx, peak memory [MB]", in_child(large_pair), "<= 2000")


if __name__ == "__main__":
    main()
