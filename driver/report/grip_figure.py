"""The check of the grips as a picture: elongation over stage travel, and what its line leaves."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from driver.report.measured import BAND, MeasuredMotion
from driver.report.style import AFTER, BEFORE, GREY, MEASURED, grid, new_figure, styled


@styled
def grip(measured: MeasuredMotion) -> Figure:
    """Elongation of each image with the line of all of them, and the distance to that line."""
    motion, stage = measured.grip, measured.stage
    value, line = 1e3 * measured.elongation.value, 1e3 * motion.line
    noise = 1e3 * BAND * measured.elongation.sigma
    own = 1e3 * BAND * measured.grip_sigma
    figure = new_figure(3.6)
    curve, rest = figure.subplots(1, 2)
    order = np.argsort(stage, kind="stable")
    half = 1e3 * BAND * motion.line_sigma[order]
    curve.fill_between(stage[order], line[order] - half, line[order] + half, color=AFTER,
                       alpha=0.25, lw=0, label="its 95 % band")  # fmt: skip
    curve.plot(stage[order], line[order], color=AFTER, lw=1.4, label="line of all images")
    nominal = 1e3 * (motion.start + motion.nominal * stage[order])
    curve.plot(stage[order], nominal, "--", color=GREY, lw=1.2, label="distance of the grips")
    curve.errorbar(stage, value, noise, fmt=".", ms=4, lw=0.6, color=MEASURED, alpha=0.7,
                   label="free correlation, 95 %")  # fmt: skip
    curve.set(xlabel="stage travel [µm]", ylabel="elongation [nm]",
              title="Elongation over stage travel")  # fmt: skip
    curve.legend(loc="upper left")
    image = np.arange(stage.size)
    rest.axhspan(-own, own, color=GREY, alpha=0.15, lw=0, label="95 % of the noise")
    rest.axhline(0.0, color=GREY, lw=0.8)
    for phase in motion.phases:
        within = (image >= phase.first) & (image <= phase.last)
        colour, name = (AFTER, "loading") if phase.loading else (BEFORE, "unloading")
        shown = name not in rest.get_legend_handles_labels()[1]
        rest.plot(image[within], (value - line)[within], ".-", ms=4, lw=0.8, color=colour,
                  label=name if shown else None)  # fmt: skip
    off = list(motion.outliers)
    if off:
        rest.plot(off, (value - line)[off], "x", ms=8, mew=2, color=MEASURED, label="lies off")
    rest.set(xlabel="image", ylabel="elongation less the line [nm]",
             title="What the line leaves")  # fmt: skip
    low, high = rest.get_ylim()
    rest.set_ylim(low, 1.25 * high - 0.25 * low)
    rest.legend(loc="upper left", ncols=3)
    for axes in (curve, rest):
        grid(axes)
    return figure
