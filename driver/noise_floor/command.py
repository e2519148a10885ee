"""`prismid noise-floor`: from a case to the table, the files and the picture."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

import numpy as np

from driver.common.atomic_write import write_whole
from driver.common.errors import InputError
from driver.common.formatting import cost_told
from driver.dic.slope_noise import squared_slopes
from driver.experiment.reading import read_experiment
from driver.forward.build import surface_images
from driver.noise_floor.floor import (
    PAPER_GAMMA_U,
    RULE,
    chosen,
    measured_gamma_u,
    relief_rms,
    repeats_as_frames,
    sizes,
)
from driver.noise_floor.laboratory import DRAWS, SERIES, errors, laboratory
from driver.noise_floor.motions import known_motions
from driver.noise_floor.picture import draw
from driver.report.style import png
from driver.results.files import (
    NOISE_FLOOR,
    NOISE_FLOOR_CSV,
    NOISE_FLOOR_PICTURE,
    make_folder,
    results_of,
)
from driver.results.mesh_sizes import sized_case
from driver.results.noise_floor import (
    QUANTITIES,
    NoiseFloor,
    Row,
    over_motions,
    write_noise_floor,
)

logger = logging.getLogger(__name__)

_UNITS = {"strain": (1e2, "%")}  # factor and unit of a table; nm for what is not named
# Seconds of one core for one pixel of one image on one mesh, all passes and iterations.
_PIXEL_SECONDS = 10e-6
# Bytes of libraries; and for each pixel, of all moved images and of what they are found to move.
_BYTES, _PIXEL_BYTES = 0.4e9, 14e3


def noise_floor(case_path: Path) -> None:
    """Measure the noise floor of the images of a case.

    Args:
        case_path: the case; its images, flats and repeats are read.

    Raises:
        InputError: the case cannot be used or names no repeats.
        ImageError: an image cannot be used.
    """
    case = sized_case(case_path)
    experiment = read_experiment(case)
    if experiment.repeats is None:
        raise InputError(
            "images.repeats: found nothing, expected at least 3 images (the noise of the "
            "elongation is measured from them; a noise that is stated cannot tell it)"
        )
    if len(experiment.repeats) < 3:
        raise InputError(
            f"images.repeats: found {len(experiment.repeats)} images, expected at least 3 (the "
            "noise of the elongation is measured from them)"
        )
    folder = results_of(case)
    make_folder(folder, case.file)
    images = surface_images(case, experiment)
    pixel, specimen = images.pixel, case.specimen
    relief = relief_rms(images)
    motions = known_motions(pixel, specimen.length, specimen.width, relief)
    frames = SERIES * (DRAWS * len(motions)) + images.n_reference
    ratio = case.dic.height_element_px / case.dic.element_px
    elements = sizes(images, ratio)
    seconds = _PIXEL_SECONDS * len(elements) * frames * len(images.xy)
    memory = _BYTES + _PIXEL_BYTES * len(images.xy)
    logger.info(
        f"{len(motions)} motions of the reference, {SERIES} series of {DRAWS} images of each, "
        f"{len(elements)} meshes: {cost_told(seconds, memory)}"
    )
    repeats = repeats_as_frames(case, experiment)
    lab = laboratory(images, motions, specimen.length)
    square, noise = squared_slopes(images)
    noise_share = noise / float(square.mean())
    interpolation = lab.relief.error()
    logger.info(
        f"noise {1e3 * images.sigma:.2f} nm, relief {1e3 * relief:.1f} nm; the reference is moved "
        f"with an interpolation error of {1e3 * interpolation:.2g} nm; {noise_share:.0%} of its "
        "squared slopes are noise"
    )
    roughness = case.dic.roughness_um(pixel)
    rows: list[Row] = []
    freedom, start, steps = 1, perf_counter(), 0

    def done() -> None:
        nonlocal steps
        steps += 1
        if steps % SERIES == 0:
            left = (perf_counter() - start) * (len(elements) * SERIES / steps - 1)
            logger.info(f"  mesh {steps // SERIES} of {len(elements)}, about {left:.0f} s to go")

    for size in elements:
        size_w = ratio * size
        uv, w = size * pixel, size_w * pixel
        measured, freedom = measured_gamma_u(
            repeats, specimen.length, uv, w, roughness, case.dic.penalty
        )
        measured_errors = errors(lab, uv, w, done, roughness, case.dic.penalty)
        rows.append(Row(size, size_w, measured_errors, measured))
    take = chosen(rows)
    for line in table(rows, take, freedom):
        logger.info(line)
    write_noise_floor(
        folder,
        NoiseFloor(
            rows=tuple(rows),
            take=take,
            rule=RULE,
            noise=images.sigma,
            relief=relief,
            n_reference=images.n_reference,
            interpolation_error=interpolation,
            noise_in_slopes=noise_share,
            series=SERIES,
            draws=DRAWS,
            paper_gamma_u=PAPER_GAMMA_U,
            freedom=freedom,
            motions=tuple((motion.name, motion.kind) for motion in motions),
        ),
    )
    write_whole(folder / NOISE_FLOOR_PICTURE, png(draw(rows, take, freedom)))
    logger.info(f"{folder}: {NOISE_FLOOR}, {NOISE_FLOOR_CSV}, {NOISE_FLOOR_PICTURE}")


def table(rows: Sequence[Row], take: Row, freedom: int) -> list[str]:
    """Return the noise floor as lines of text.

    Args:
        rows: the meshes.
        take: the mesh to take.
        freedom: degrees of freedom of the scatter of the repeats.
    """
    heads = ["u nm", "v nm", "w nm", "ε_YY %", "elong. nm"]
    lines = [
        "bias / scatter, root mean square over all motions; γ_u is that of the elongation",
        "element px" + "".join(f"{head:>15}" for head in heads) + f"{'γ_u predicted':>15}"
        f"{'by repeats':>15}",
    ]
    for row in rows:
        cells = []
        for quantity in QUANTITIES:
            factor = _UNITS.get(quantity, (1e3, "nm"))[0]
            bias, scatter = (
                factor * over_motions(part[quantity])
                for part in (row.errors.bias, row.errors.scatter)
            )
            cells.append(f"{bias:.3g} / {scatter:.3g}")
        gamma = [f"{1e3 * row.errors.predicted:.1f} nm", f"{1e3 * row.measured:.1f} nm"]
        mark = "← take" if row is take else ""
        lines.append(f"{row.size:10g}" + "".join(f"{c:>15}" for c in cells + gamma) + f"  {mark}")
    predicted, measured = 1e3 * take.errors.predicted, 1e3 * take.measured
    known = measured / np.sqrt(2 * freedom)
    lines += [
        f"take dic.element_px = {take.size:g}, height_element_px = {take.size_w:g}: {RULE}",
        f"γ_u of the elongation there: predicted {predicted:.1f} nm, by {freedom + 1} repeats "
        f"{measured:.1f} ± {known:.1f} nm; the paper {1e3 * PAPER_GAMMA_U:.0f} nm",
    ]
    stopped = [f"{row.size:g}" for row in rows if row.errors.converged < 1]
    if stopped:
        lines.append(f"some images did not converge with elements of {', '.join(stopped)} px")
    return lines
