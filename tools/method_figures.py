"""Figures of the pages in docs/method, each computed by the functions of the program.

Run `python -m tools.method_figures` in the root of the repository. All specimens are synthetic.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyBboxPatch, Patch
from PIL import Image

from driver.diagnosis.answer.result_types import IMAGING, Diagnosis
from driver.diagnosis.answer.verdict import LEAST_EXPLAINED, MOST_ADDITIONS, Kind, decide
from driver.diagnosis.causes.all_causes import EVERY
from driver.diagnosis.search.selection_round import WITHIN
from driver.diagnosis.statistics.score_test import WORTH
from driver.dic.series import measure
from driver.experiment.history import History, turning_points
from driver.experiment.orientations import orientations_of
from driver.forward.build import build_model, geometry_of
from driver.forward.model import ForwardModel
from driver.identification.fit import Fit, fit
from driver.identification.identifiability import INSENSITIVE, prior_shares
from driver.identification.mesh_error import share_left
from driver.parameters.boundary import LAMBDAS, elongation_names, tilt_names
from driver.parameters.pose import POSE_DECLARATIONS
from driver.parameters.registry import declared_parameters
from driver.report.style import (
    AFTER,
    BEFORE,
    CATEGORIES,
    CYCLES,
    GREY,
    MEASURED,
    SIGNED,
    grid,
    new_figure,
    png,
    styled,
    typeset,
)
from meshes.arrays import FloatArray
from meshes.prism import generate
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.crystal import schmid_tensors
from solver_adapters.interface import Integration
from solver_adapters.material import Material
from tools import closed_form
from tools.boxes import uniaxial
from tools.closed_form_diagnosis import diagnosis_of, identified, priors
from tools.short_specimen import small_case

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "method"

_PAPER = Material(strain_measure="small")
_IDENTIFIED = replace(_PAPER, tau0=21.0, c=44e3, d=1140.0)  # MPa, MPa, 1: the paper's table 5
_LAMBDA_Y = 0.81  # of S+, the paper's table 4
_SIZES = (2.2, 1.5, 1.0)  # µm; working mesh, finer mesh, one that stands for the truth
_HIDDEN = {"load_gain": 0.12, "end_rotation": 0.2}  # µN/µN and 1
_TRUE_LAW = {"tau0": 30.0, "c": 44e3, "d": 1140.0, "lambda_plus_Y": _LAMBDA_Y}
_COLOURS = 256  # of a file
_SHOWN = 7  # causes of a round


@styled
def law() -> Figure:
    """Draw resolved shear stress against slip, and a hold in two schemes of integration."""
    figure = new_figure(3.9)
    loop, hold = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    strain = np.concatenate(
        [np.linspace(0, 0.004, 41), np.linspace(0.004, 0.0033, 15)[1:],
         np.linspace(0.0033, 0.008, 48)[1:], np.linspace(0.008, 0.0073, 15)[1:]]
    )  # fmt: skip
    time = 2.0 * np.arange(strain.size, dtype=np.float64)
    for material, colour, where in ((_PAPER, BEFORE, "start"), (_IDENTIFIED, AFTER, "identified")):
        slip, shear = most_active_system(material, time, strain)
        text = f"{where}: τ₀ {material.tau0:g} MPa, c/d {material.c / material.d:.0f} MPa"
        loop.plot(1e2 * slip, shear, color=colour, lw=1.5, label=text)
    loop.set_xlabel("slip of the most active system [%]")
    loop.set_ylabel("resolved shear stress τ [MPa]")
    loop.set_title("Two cycles in tension")
    loop.set_ylim(-20, 76)
    loop.legend(loc="lower right")
    grid(loop)
    strain = np.concatenate([np.linspace(0, 0.004, 41), np.full(8, 0.004)])
    times = [0.5 * np.arange(41), 20.0 + np.array([1, 3, 6, 10, 15, 22, 30, 40])]
    time = np.concatenate(times).astype(np.float64)
    runs: tuple[tuple[str, Integration, int, str], ...] = (
        ("exponential", "exponential", 1, "o"),
        ("backward Euler", "backward_euler", 1, "s"),
        ("backward Euler, steps / 4", "backward_euler", 4, "d"),
    )
    for (label, scheme, steps, marker), colour in zip(runs, CYCLES, strict=False):
        _, shear = most_active_system(_PAPER, time, strain, scheme, steps)
        hold.plot(
            time[40:] - time[40], shear[40:], color=colour, marker=marker, ms=4.5, label=label
        )
    hold.set_xlabel("time of the hold [s]")
    hold.set_ylabel("resolved shear stress τ [MPa]")
    hold.set_title("Relaxation in a hold at 0.4 % strain")
    hold.legend(loc="upper right")
    grid(hold)
    return figure


def most_active_system(
    material: Material,
    time: FloatArray,
    strain: FloatArray,
    integration: Integration = "exponential",
    steps: int = 1,
) -> tuple[FloatArray, FloatArray]:
    """Slip and resolved shear stress [MPa] of the system that slips most, grain 1, shape (T,) each.

    Args:
        material: the law, in small strain.
        time: instants [s], shape (T,).
        strain: along Y, the sides free of stress, shape (T,).
        integration: scheme of the time integration.
        steps: time steps between two instants.
    """
    rotation = orientations_of(small_case())[0]
    asked = replace(
        uniaxial(material, rotation, time, strain),
        integration=integration, steps_per_interval=steps, cell_fields=True,
    )  # fmt: skip
    cells = BundledAdapter().solve(asked).cells
    assert cells is not None
    xx, yy, zz, yz, xz, xy = cells.stress.mean(axis=1).T
    stress = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    shear = np.einsum(
        "ia,ijt,jb,sab->ts", rotation, stress, rotation, schmid_tensors(material.slip_systems)
    )
    slip = cells.slip.mean(axis=1)
    most = int(np.argmax(np.abs(slip[-1])))
    sense = np.sign(slip[-1, most])
    return sense * slip[:, most], sense * shear[:, most]


def _prism_model(size: float) -> ForwardModel:
    """Return the short prism of two grains, loaded once, on a mesh of this size [µm]."""
    case = small_case()
    stage = np.concatenate([np.linspace(0, 100, 13), np.linspace(100, 80, 4)[1:]])
    rows = np.arange(stage.size)
    history = History(
        time=np.asarray(16.0 * rows, dtype=np.float64), stage=stage, image_row=rows,
        force=np.zeros(stage.size), turning=turning_points(stage),
        cycle=np.ones(stage.size, dtype=np.int64),
    )  # fmt: skip
    mesh = generate(geometry_of(case), size)
    middle = np.array([[0.0, case.specimen.length / 2]])
    return build_model(case, mesh, history, middle, BundledAdapter(), 1)


def _values_of(model: ForwardModel, elongation: Sequence[float]) -> dict[str, float]:
    names = elongation_names(model.boundary.weights.shape[1])
    return model.null_values() | dict(zip(names, elongation, strict=True))


@styled
def boundary_motion() -> Figure:
    """Draw the prism from its side with the motion of its end faces, and knots against time."""
    figure = new_figure(4.0)
    side, course = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    model = _prism_model(2.0)
    at = model.microstructure.mesh.points[model.boundary.nodes]
    order = np.lexsort((at[:, 2], at[:, 1]))
    order = order[np.isclose(at[order, 0], 0.0, atol=0.3)]
    y, z = at[order, 1], at[order, 2]
    length, depth = float(y.max()), -float(z.min())
    side.fill([0, length, length, 0], [0, 0, -depth, -depth], color=GREY, alpha=0.12, lw=0)
    side.plot([0, length], [0, 0], color=MEASURED, lw=2.2)
    side.plot([0, length], [-depth, -depth], color=MEASURED, lw=1.2, ls="--")
    magnified = 25.0
    for amplitude, colour in ((1.0, GREY), (_LAMBDA_Y, AFTER)):
        values = _values_of(model, (0.060, 0.055)) | {"lambda_plus_Y": amplitude}
        values |= dict(zip(tilt_names(3), (0.020, 0.018), strict=True))
        peak = int(np.argmax(model.boundary.weights[:, 1]))
        moved = magnified * model.boundary.evaluate(values)[peak][order]
        for face in (y < length / 2, y > length / 2):
            side.plot(y[face] + moved[face, 1], z[face] + moved[face, 2], color=colour, marker="o",
                      ms=3.5, lw=1.6)  # fmt: skip
    for x, label in ((0.0, "S⁻"), (length, "S⁺")):
        side.plot([x, x], [-depth, 0], color=MEASURED, lw=1.2)
        side.annotate(label, (x, -depth / 2), xytext=(-18 if x else 8, 0), weight="bold",
                      textcoords="offset points", va="center")  # fmt: skip
    side.text(length / 2, 0.12, "measured face, ζ = 0", ha="center", va="bottom")
    side.text(length / 2, -depth - 0.12, "apex line, ζ = 1", ha="center", va="top")
    side.plot([], [], color=GREY, marker="o", ms=3.5, label="all amplitudes 1")
    side.plot([], [], color=AFTER, marker="o", ms=3.5, label=typeset(f"λ⁺_Y = {_LAMBDA_Y:g}"))
    side.legend(loc="lower center", bbox_to_anchor=(0.5, 0.28))
    side.set_aspect("equal")
    side.set_xlim(-1.6, length + 1.6)
    side.set_ylim(-depth - 1.0, 1.0)
    side.set_xlabel("Y [µm]")
    side.set_ylabel("Z [µm]")
    side.set_title(f"Motion of the end faces, {magnified:g} times")
    _draw_knots(course)
    return figure


def _draw_knots(course: Axes) -> None:
    """Draw elongation and tilt of a test against time, with their knots and the stage travel."""
    problem = closed_form.problem()
    boundary, history = problem.model.boundary, problem.history
    motion = boundary.evaluate(problem.truth)
    edge = np.isclose(problem.mesh.points[boundary.nodes, 2], 0.0)
    plus = boundary.side > 0
    travel = course.twinx()
    travel.plot(history.time, history.stage, color=GREY, ls="--", lw=1.2)
    travel.set_ylabel("stage travel [µm], dashed", color=GREY)
    travel.spines["right"].set_visible(True)
    for component, colour, name in ((1, AFTER, "elongation"), (2, BEFORE, "tilt")):
        upper, lower = (motion[:, edge & of, component].mean(axis=1) for of in (plus, ~plus))
        between = 1e3 * (upper - lower)
        course.plot(history.time, between, color=colour, marker=".", ms=4, label=name)
        course.plot(history.time[history.turning], between[history.turning], "o", ms=9,
                    mfc="none", mec=colour)  # fmt: skip
    course.plot([], [], "o", ms=9, mfc="none", mec=MEASURED, label="knots")
    course.legend(loc="upper left")
    course.set_xlabel("time [s]")
    course.set_ylabel("difference between the edges [nm]")
    course.set_title("Linear in stage travel")
    grid(course)


@styled
def images() -> Figure:
    """Draw reference, difference of two images, residual of correlation, and measured motion."""
    problem = closed_form.problem()
    images_ = closed_form.surface_images(problem, problem.truth, 1)
    motion = measure(images_)
    last = images_.n_frames - 1
    still = np.zeros((1, len(images_.xy), 3))
    before = images_.residual(still, np.array([last]))[0]
    after = images_.residual(motion.at_pixels()[[last]], np.array([last]))[0]
    figure = new_figure(4.6)
    grid_of = figure.add_gridspec(2, 3, height_ratios=(1.25, 1.0))
    height = 1e3 * (images_.reference - images_.reference.mean())
    maps = (
        ("Reference f, less its mean", height, "viridis", "height [nm]"),
        ("f − g, nothing removed", 1e3 * before, SIGNED, "f − g [nm]"),
        ("Residual ρ after correlation", 1e3 * after, SIGNED, "ρ [nm]"),
    )
    for column, (title, values, colours, label) in enumerate(maps):
        axes = figure.add_subplot(grid_of[0, column])
        picture = np.full(images_.shape, np.nan)
        picture[images_.rows, images_.cols] = values
        shown = picture[images_.rows.min() : images_.rows.max() + 1,
                        images_.cols.min() : images_.cols.max() + 1]  # fmt: skip
        x0, x1, y0, y1 = images_.bounds
        size = float(np.nanmax(np.abs(shown)))
        low = -size if colours == SIGNED else float(np.nanmin(shown))
        drawn = axes.imshow(shown, extent=(y0, y1, x1, x0), cmap=colours, vmin=low, vmax=size)
        axes.set_title(title)
        axes.set_xlabel("Y [µm]")
        axes.set_ylabel("X [µm]")
        figure.colorbar(drawn, ax=axes, label=label, location="bottom", aspect=30)
    profile = figure.add_subplot(grid_of[1, :2])
    truth = (
        problem.model.predict(problem.truth).motion[last] + closed_form.stage_error(problem)[last]
    )
    found = motion.at_pixels()[last]
    across = np.abs(images_.xy[:, 0])
    middle = images_.rows == images_.rows[np.argmin(across)]
    place = images_.xy[middle, 1]
    for component, colour, name in ((1, AFTER, "v, along Y"), (2, BEFORE, "w, along Z")):
        profile.plot(place, 1e3 * found[middle, component], ".", ms=4, color=colour, label=name)
        profile.plot(place, 1e3 * truth[middle, component], color=MEASURED, lw=0.9)
    profile.plot([], [], color=MEASURED, lw=0.9, label="true motion")
    profile.set_xlabel("Y [µm]")
    profile.set_ylabel("motion [nm]")
    profile.set_title("Measured motion on the middle line of the face, last image")
    profile.legend(loc="upper left", ncols=3)
    grid(profile)
    chi = figure.add_subplot(grid_of[1, 2])
    chi.plot(images_.chi(motion.at_pixels(), motion.system.freedom()), ".-", color=AFTER)
    chi.axhline(1.0, color=MEASURED, lw=0.9)
    chi.axhline(IMAGING, color=BEFORE, lw=1.1, ls="--")
    chi.set_ylim(0.8, 1.3)
    chi.set_xlabel("image")
    chi.set_ylabel("χ of free correlation")
    chi.set_title("1 is noise")
    grid(chi)
    return figure


def _closed_form_fit() -> tuple[Fit, tuple[str, ...]]:
    """Return the fit of a specimen in closed form from the nominal law, and what is free in it."""
    problem = closed_form.problem()
    made = closed_form.objective(problem, problem.truth | _TRUE_LAW)
    n_knots = len(closed_form.KNOTS) + 1
    knots = (*elongation_names(n_knots), *tilt_names(n_knots))
    free = (*LAMBDAS, *(p.name for p in POSE_DECLARATIONS), *knots, *closed_form.LAW)
    start = replace(made, prior=priors(problem.truth))
    return fit(start, problem.truth, free, 15), free


@styled
def identification() -> Figure:
    """Draw the misfit over the iterations, correlation of the parameters, share of the prior."""
    found, free = _closed_form_fit()
    figure = new_figure(3.9)
    course, matrix, share = figure.subplots(1, 3, width_ratios=(1.05, 1.15, 1.0))
    for key, colour, label in (("chi_load", AFTER, "χ_F, loads"), ("chi_image", BEFORE, "images")):
        course.semilogy([h[key] for h in found.history], "o-", color=colour, label=typeset(label))
    course.axhline(1.0, color=MEASURED, lw=0.9)
    course.set_xticks(range(len(found.history)))
    course.set_xlabel("Gauss–Newton iteration")
    course.set_ylabel("rms of the whitened residual [σ]")
    course.set_title("Misfit; 1 is noise")
    course.legend(loc="upper right")
    grid(course)
    names = [*LAMBDAS, *closed_form.LAW]
    parameters = declared_parameters(len(closed_form.KNOTS) + 1)
    labels = [typeset(parameters[name].label or name) for name in names]
    rows = [free.index(name) for name in names]
    covariance = found.covariance[np.ix_(rows, rows)]
    sigma = np.sqrt(np.diag(covariance))
    drawn = matrix.imshow(covariance / np.outer(sigma, sigma), cmap=SIGNED, vmin=-1, vmax=1)
    matrix.set_xticks(range(len(names)), labels)
    matrix.set_yticks(range(len(names)), labels)
    matrix.set_title("Correlation of the estimates")
    figure.colorbar(drawn, ax=matrix, location="bottom", aspect=30, label="correlation [1]")
    share.barh(range(len(names)), prior_shares(found.best)[rows], color=GREY)
    share.axvline(INSENSITIVE, color=BEFORE, ls="--", lw=1.1)
    share.set_yticks(range(len(names)), labels)
    share.invert_yaxis()
    share.set_xlim(0, 1)
    share.set_xlabel("share of the variance [1]")
    share.set_title("What the prior decides")
    return figure


@styled
def simulation_error() -> Figure:
    """Draw the load by the size of the elements, the correction, and what it leaves wrong."""
    runs = []
    for size in _SIZES:
        model = _prism_model(size)
        prediction = model.predict(_values_of(model, (0.060, 0.055)), ())
        runs.append((model.microstructure.mesh, prediction.load))
    (few, working), (more, finer), (many, truth) = runs
    figure = new_figure(3.9)
    load, difference = figure.subplots(1, 2)
    row = np.arange(working.size)
    for force, size, mesh, colour in zip(
        (working, finer, truth), _SIZES, (few, more, many), (BEFORE, AFTER, MEASURED), strict=True
    ):
        load.plot(row, force, color=colour, lw=1.4, label=f"{size:g} µm, {len(mesh.cells)} cells")
    load.set_xlabel("row of the history")
    load.set_ylabel("load [µN]")
    load.set_title("Load by the size of the elements")
    load.legend(loc="lower center")
    grid(load)
    kappa = share_left(few, _SIZES[:2])
    correction = finer - working
    difference.fill_between(row, -kappa * np.abs(correction), kappa * np.abs(correction),
                            color=AFTER, alpha=0.2, lw=0,
                            label=f"± κ · correction, κ = {kappa:.2f}")  # fmt: skip
    difference.plot(row, correction, color=AFTER, ls="--", label="correction: finer − working")
    difference.plot(row, truth - working, color=BEFORE, label="error of the working mesh")
    difference.plot(row, truth - finer, color=MEASURED, label="error after the correction")
    difference.axhline(0.0, color=MEASURED, lw=0.7)
    difference.set_xlabel("row of the history")
    difference.set_ylabel("difference of the load [µN]")
    difference.set_title(f"Errors, against {_SIZES[2]:g} µm")
    difference.legend(loc="upper left")
    grid(difference)
    return figure


def _hidden_effects() -> Diagnosis:
    """Return the diagnosis of a specimen in closed form with two hidden effects."""
    problem = closed_form.problem()
    made = closed_form.objective(problem, problem.truth | _HIDDEN)
    return diagnosis_of(problem, identified(problem, made))


@styled
def diagnosis() -> Figure:
    """Draw log Bayes factors of the best causes in the rounds of a diagnosis."""
    steps = _hidden_effects().rounds
    figure = new_figure(4.4)
    for number, (axes, step) in enumerate(
        zip(np.atleast_1d(figure.subplots(1, len(steps))), steps, strict=True), start=1
    ):
        refits = {refit.cause.name: refit.log_evidence for refit in step.refits}
        best = {s.cause.name: refits.get(s.cause.name, s.log_evidence) for s in step.scores}
        shown = sorted(step.scores, key=lambda s: -best[s.cause.name])[:_SHOWN]
        for place, scored in enumerate(shown):
            name = scored.cause.name
            axes.barh(place, best[name], color=CATEGORIES[scored.cause.category],
                      alpha=1.0 if name in refits else 0.45,
                      edgecolor=MEASURED, lw=1.8 if name in step.named else 0.0)  # fmt: skip
            if name in refits:
                axes.plot(scored.log_evidence, place, "D", ms=5, mfc="white", mec=MEASURED)
        axes.set_yticks(range(len(shown)), [s.cause.title for s in shown])
        axes.invert_yaxis()
        axes.axvline(WORTH, color=GREY, ls=":", lw=1.3)
        if step.named:
            axes.axvline(refits[step.named[0]] - WITHIN, color=BEFORE, ls="--", lw=1.2)
        axes.set_title(f"Round {number}")
        axes.set_xlabel("log Bayes factor")
        axes.grid(True, axis="x")
    key = [
        *(Patch(color=colour, label=name) for name, colour in CATEGORIES.items()),
        Patch(color=GREY, alpha=0.45, label="score alone"),
        Line2D([], [], marker="D", ls="", mfc="white", mec=MEASURED, label="score of a refit"),
        Patch(facecolor="white", edgecolor=MEASURED, lw=1.8, label="in the set"),
        Line2D([], [], color=BEFORE, ls="--", label=f"best less {WITHIN:g}"),
        Line2D([], [], color=GREY, ls=":", label=f"{WORTH:g}, the least"),
    ]
    figure.legend(handles=key, loc="outside lower center", ncols=5)
    return figure


def kind_of(
    numerics: bool = False,
    added: int = 0,
    rivals: int = 0,
    left: bool = False,
    imaging_limited: bool = False,
    explained: float = 1.0,
) -> Kind:
    """Return the kind of a verdict for an outcome of the steps (`decide`).

    Args:
        numerics: whether the simulation needs a refinement.
        added: how many causes were added.
        rivals: how many causes cannot be told from each.
        left: whether the tests of what is left reject.
        imaging_limited: whether χ of free correlation is too large.
        explained: share of the misfit that is no noise that the additions explain.
    """
    sets = [EVERY[k::added][: 1 + rivals] for k in range(added)]
    return decide(
        sets,
        ("structure",) if left else (),
        imaging_limited,
        "refine" if numerics else None,
        explained,
        True,
    ).kind


@styled
def verdicts() -> Figure:
    """Draw the flow of the decision; the answers at its ends are those of `decide`."""
    figure = new_figure(5.2)
    axes = figure.subplots()
    axes.set_xlim(0, 10.4)
    axes.set_ylim(0.5, 6.5)
    axes.axis("off")
    alone, ends_alone, added, ends_added = 1.35, 4.0, 6.6, 9.2
    questions = {
        (alone, 6.0): "simulation wrong by more\nthan 1 σ of a score?",
        (alone, 5.0): "was a cause added?",
        (alone, 4.0): f"χ of free correlation\nabove {IMAGING:g}?",
        (alone, 3.0): "do the tests of\nwhat is left reject?",
        (added, 5.0): f"{MOST_ADDITIONS} causes or more?",
        (added, 4.0): f"tests reject, and less than\n{1e2 * LEAST_EXPLAINED:.0f} % is explained?",
        (added, 3.0): "do the tests of\nwhat is left reject?",
        (added, 2.0): "does a set hold\nseveral causes?",
    }
    little, much = LEAST_EXPLAINED - 0.01, LEAST_EXPLAINED
    ends = {
        (ends_alone, 6.0): kind_of(numerics=True),
        (ends_alone, 4.0): kind_of(imaging_limited=True),
        (ends_alone, 3.0): kind_of(left=True),
        (alone, 2.0): kind_of(),
        (ends_added, 5.0): kind_of(added=MOST_ADDITIONS),
        (ends_added, 4.0): kind_of(added=1, left=True, explained=little),
        (ends_added, 3.0): kind_of(added=1, left=True, explained=much),
        (ends_added, 2.0): kind_of(added=1, rivals=1),
        (added, 1.0): kind_of(added=1),
    }
    for place, text in questions.items():
        _box(axes, place, text, "#eef3f8", "normal")
    for place, kind in ends.items():
        _box(axes, place, kind.replace(", ", ",\n"), "#fdebd8", "bold")
    for column, across in ((alone, ends_alone), (added, ends_added)):
        for x, y in questions:
            if x == column:
                target = added if (x, y) == (alone, 5.0) else across
                _arrow(axes, (x + _WIDE / 2, y), (target - _WIDE / 2, y), "yes")
                _arrow(axes, (x, y - _HIGH / 2), (x, y - 1 + _HIGH / 2), "no")
    return figure


_WIDE, _HIGH = 2.1, 0.62  # of a box, in units of the axes


def _box(axes: Axes, at: tuple[float, float], text: str, colour: str, weight: str) -> None:
    corner = at[0] - _WIDE / 2, at[1] - _HIGH / 2
    axes.add_patch(FancyBboxPatch(corner, _WIDE, _HIGH, boxstyle="round,pad=0,rounding_size=0.08",
                                  facecolor=colour, edgecolor=GREY, lw=0.9))  # fmt: skip
    axes.text(*at, text, ha="center", va="center", fontsize=9.0, weight=weight)


def _arrow(axes: Axes, begin: tuple[float, float], end: tuple[float, float], answer: str) -> None:
    axes.annotate("", end, begin, arrowprops={"arrowstyle": "-|>", "color": MEASURED, "lw": 1.0})
    across = begin[1] == end[1]
    at = (begin[0] + 0.12, begin[1] + 0.07) if across else (begin[0] + 0.08, begin[1] - 0.19)
    axes.text(*at, answer, fontsize=8.5, color=GREY, va="bottom" if across else "center")


FIGURES: dict[str, Callable[[], Figure]] = {
    "law": law,
    "boundary_motion": boundary_motion,
    "images": images,
    "identification": identification,
    "simulation_error": simulation_error,
    "diagnosis": diagnosis,
    "verdicts": verdicts,
}
"""What draws the figure of each page, by the name of both."""


def draw_all(folder: Path) -> None:
    """Write every figure into a folder as a PNG file of its name, in a palette of few colours."""
    for name, draw in FIGURES.items():
        picture = Image.open(BytesIO(png(draw()))).convert("RGB")
        picture.quantize(_COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
            folder / f"{name}.png", optimize=True
        )


if __name__ == "__main__":
    draw_all(FOLDER)
