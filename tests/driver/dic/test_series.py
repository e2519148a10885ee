from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from driver.dic.regularisation import Penalty, modes
from driver.dic.series import measure
from driver.dic.surface_images import SurfaceImages, prepare
from driver.dic.system import sensitivity
from driver.experiment.images.heightmaps import ImageError, load_stack
from meshes.plane_cells import CellKind
from meshes.plane_mesh import PlaneMesh
from tests.driver.dic.conftest import BOUNDS, ORIGIN, constant, deformed
from tests.meshes.plane_examples import distorted

DATA = Path(__file__).parents[2] / "data" / "dic"
PIXEL, LEVEL = 0.11, 0.0065
Field = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
Scene = Callable[..., SurfaceImages]


def linear(slope_x: float, slope_y: float) -> Field:
    return lambda x, y: slope_x * x + slope_y * y


STILL = constant(0.0)


@pytest.mark.parametrize("component", [0, 1, 2])
def test_each_component_has_its_sign_and_size(scene: Scene, component: int) -> None:
    motion = [STILL, STILL, STILL]
    motion[component] = linear(0.004, -0.007)
    images = scene([tuple(motion)], noise=1e-5)
    measured = measure(images)
    truth = np.zeros((len(images.xy), 3))
    truth[:, component] = motion[component](*images.xy.T)
    error = measured.at_pixels()[0] - truth
    assert measured.converged.all()
    assert np.abs(error[:, :2]).max() < 3e-3 * PIXEL
    assert np.abs(error[:, 2]).max() < 3e-4


def test_an_exact_translation_is_met_within_a_thousandth_pixel(scene: Scene) -> None:
    u, v, w = 0.37 * PIXEL, -0.21 * PIXEL, 0.02
    images = scene([(constant(u), constant(v), constant(w))], noise=1e-6)
    error = measure(images).at_pixels()[0] - [u, v, w]
    rms = np.sqrt(np.mean(error**2, axis=0))
    assert rms[0] < 1e-3 * PIXEL and rms[1] < 1e-3 * PIXEL and rms[2] < 1e-4


def test_a_frame_out_of_which_the_motion_runs_has_no_small_residual(scene: Scene) -> None:
    images = scene([(STILL, STILL, STILL)] * 3, noise=0.003)
    frames = np.array(images.frames.coefficients)
    frames[1] = 1e3 * np.random.default_rng(11).normal(size=frames[1].shape)
    measured = measure(replace(images, frames=replace(images.frames, coefficients=frames)))
    assert measured.lost.tolist() == [False, True, False]
    # The relief of 50 nm stands for its residual.
    assert measured.chi[1] > 10 and measured.chi[[0, 2]].max() < 1.1


@pytest.mark.parametrize("roughness", [np.inf, 0.05])
def test_covariance_agrees_with_the_scatter_over_noise_draws(
    scene: Scene, roughness: float
) -> None:
    n_draws = 48
    shift = (constant(0.37 * PIXEL), constant(-0.21 * PIXEL), STILL)
    images = scene([shift] * n_draws, noise=0.009, seed=3)
    measured = measure(images, roughness=roughness)
    p, covariance = measured.coefficients, measured.covariance_one
    n = p.shape[1]
    scatter = p - p.mean(axis=0)
    precision = np.linalg.inv(covariance)
    ratio = np.einsum("ti,ij,tj->", scatter, precision, scatter) / (n * (n_draws - 1))
    # sampling error of the ratio √(2/(n·47)) < 2 %; the pattern's noise and interpolation < 5 %
    assert ratio == pytest.approx(1.0, abs=0.08)
    n_uv = len(measured.basis_uv.nodes)
    for part in (slice(0, n_uv), slice(n_uv, 2 * n_uv), slice(2 * n_uv, n)):
        variance = scatter[:, part].var(axis=0).mean() * n_draws / (n_draws - 1)
        assert variance == pytest.approx(covariance.diagonal()[part].mean(), rel=0.2)
    # what the frames share is the noise of the reference: covariance_one (1/n_ref + 1/T)
    truth = np.repeat([0.37 * PIXEL, -0.21 * PIXEL, 0.0], [n_uv, n_uv, n - 2 * n_uv])
    shared = p.mean(axis=0) - truth
    expected = 1 / images.n_reference + 1 / n_draws
    chi2 = shared @ precision @ shared / (n * expected)
    assert chi2 == pytest.approx(1.0, abs=4 * np.sqrt(2 / n))
    assert measured.chi.mean() == pytest.approx(1.0, abs=0.02)


def test_the_hessian_is_not_inflated_by_noise_in_the_gradient(scene: Scene) -> None:
    shift = (constant(0.37 * PIXEL), constant(-0.21 * PIXEL), STILL)
    noisy = measure(scene([shift] * 40, noise=0.009, seed=4), roughness=np.inf)
    clean = measure(scene([shift], noise=1e-6), roughness=np.inf)
    n = 2 * len(noisy.basis_uv.nodes)
    ratio = noisy.covariance_one.diagonal()[:n] / clean.covariance_one.diagonal()[:n]
    ratio *= (1e-6 / 0.009) ** 2
    assert ratio.mean() == pytest.approx(1.0, abs=0.06)


def test_sensitivity_is_minus_the_derivative_of_the_residual(scene: Scene) -> None:
    images = scene([(STILL, STILL, STILL)], noise=1e-9)
    bases = measure(images)
    n = bases.coefficients.shape[1]
    step = 1e-4 * np.random.default_rng(5).normal(size=(n,))
    n_uv = len(bases.basis_uv.nodes)
    parts = (step[:n_uv], step[n_uv : 2 * n_uv], step[2 * n_uv :])
    functions = (bases.basis_uv, bases.basis_uv, bases.basis_w)
    motion = np.stack(
        [basis.values @ part for basis, part in zip(functions, parts, strict=True)], axis=-1
    )
    change = images.residual(motion[None])[0] - images.residual(0 * motion[None])[0]
    gradient = images.frames.gradient(0, images.xy[:, 0], images.xy[:, 1])
    predicted = -(sensitivity(gradient, bases.basis_uv, bases.basis_w) @ step)
    assert change == pytest.approx(predicted, abs=3e-3 * np.abs(predicted).max())


def test_threads_change_nothing_and_the_trace_of_the_volume_mesh_serves_as_basis(
    scene: Scene,
) -> None:
    motion = (linear(0.004, -0.007), linear(0.002, 0.01), STILL)
    images = scene([motion] * 5, noise=1e-5)
    square = distorted("tri6")
    mesh = PlaneMesh(square.points * [1.2, 2.4] - [1.8, 0.05], square.cells, "tri6")
    one, two = (measure(images, mesh, workers=n) for n in (1, 2))
    assert np.array_equal(one.coefficients, two.coefficients)
    assert one.converged.all()
    truth = np.stack([part(*images.xy.T) for part in motion], axis=-1)
    assert np.abs(one.at_pixels()[0] - truth)[:, :2].max() < 5e-3 * PIXEL


def pair(name: str) -> tuple[SurfaceImages, NDArray[np.float64]]:
    """A reference pair of a single noisy reference, and its true u, v, w [µm] at the pixels."""
    truth = np.load(DATA / f"{name}_truth.npz")
    f, g = (LEVEL * load_stack(DATA / f"{name}_{which}.tif")[0][None] for which in "fg")
    (col0, row0), (col1, row1) = truth["roi"]
    size = ((row1 - row0 - 1) * PIXEL, (col1 - col0 - 1) * PIXEL)
    # Two copies that differ by a hair stand in for repeats; the true noise is stated after.
    hair = 1e-9 * np.random.default_rng(0).normal(size=f.shape)
    images = prepare(
        g, np.concatenate([f + hair, f - hair]), None, PIXEL,
        (float(row0), float(col0)), (-1e-9, size[0] + 1e-9, -1e-9, size[1] + 1e-9),
    )  # fmt: skip
    images = replace(images, sigma=float(np.hypot(0.009, LEVEL / 12**0.5)), n_reference=1)
    at = images.rows, images.cols
    motion = [truth["v"][at] * PIXEL, truth["u"][at] * PIXEL, truth["w"][at] * LEVEL]
    return images, np.stack(motion, axis=-1).astype(np.float64)


def rms_px(images: SurfaceImages, truth: NDArray[np.float64], size_w: float) -> tuple[float, float]:
    """Error of the component along the columns and along the rows [px]."""
    error = measure(images, 16 * PIXEL, size_w).at_pixels()[0] - truth
    u, v, _ = np.sqrt(np.mean(error**2, axis=0)) / PIXEL
    return float(v), float(u)


def test_a_heterogeneous_motion_is_measured_as_well_as_the_mesh_allows() -> None:
    along, across = rms_px(*pair("s_HN"), 16 * PIXEL)
    assert along < 0.05 and across < 0.05


def test_a_finer_height_basis_keeps_roughening_out_of_the_plane() -> None:
    images, truth = pair("s_HW")
    same, fine = (rms_px(images, truth, size * PIXEL)[0] for size in (16, 8))
    assert fine < 0.06
    assert fine < 0.5 * same


def test_functions_that_see_no_pixel_are_held_by_a_stated_ridge(scene: Scene) -> None:
    images = scene([(constant(0.02), STILL, STILL)], noise=0.002)
    assert measure(images).ridge == 0.0
    wide = replace(images, bounds=(-1.76, 1.76, 0.0, 12.0))
    measured = measure(wide, roughness=np.inf)
    assert measured.ridge > 0.0
    assert measured.converged.all()
    assert measured.at_pixels()[0, :, 0].mean() == pytest.approx(0.02, abs=1e-3)


def test_heights_that_one_frame_lacks_are_left_out_of_it_alone() -> None:
    """A hole over a third of a frame, which its neighbours' values would fill with steps."""
    truth = (linear(0.004, -0.007), linear(0.002, 0.01), linear(0.001, 0.002))
    frames = np.repeat(deformed(*truth)[None], 2, axis=0)
    rng = np.random.default_rng(8)
    hole = np.zeros(frames.shape[1:], dtype=bool)
    hole[14:26, 20:50] = True
    hole |= rng.random(hole.shape) < 0.01
    repeats = np.repeat(deformed(STILL, STILL, STILL)[None], 4, axis=0)
    repeats += 1e-5 * rng.normal(size=repeats.shape)
    frames[1, hole] = np.nan
    images = prepare(frames, repeats, None, PIXEL, ORIGIN, BOUNDS)
    measured = measure(images)
    assert measured.converged.all()
    assert measured.compared[0].all() and 0.5 < measured.compared[1].mean() < 0.9
    error = measured.at_pixels() - np.stack([part(*images.xy.T) for part in truth], axis=-1)
    rms = np.sqrt(np.mean(error[1][measured.compared[1]] ** 2, axis=0))
    # Filled from its neighbours the hole puts the same frame off by 0.19 px and 13 nm.
    assert rms[:2].max() < 4e-3 * PIXEL and rms[2] < 4e-4
    residual = images.residual(measured.at_pixels())
    assert np.isfinite(residual[0]).all()
    assert np.array_equal(np.isfinite(residual[1]), measured.compared[1])


@pytest.mark.parametrize("penalty", ["tikhonov", "equilibrium_gap", "elastic"])
def test_the_roughness_is_that_of_the_motion_where_the_images_say_it(
    scene: Scene, penalty: Penalty
) -> None:
    def wave(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(0.03 * np.sin(2 * np.pi * (y + 0.3 * x) / 4.0))

    flat = (constant(0.02), linear(0.0, 0.004), STILL)
    found = {}
    for name, motion in (("smooth", flat), ("rough", (wave, wave, STILL))):
        images = scene([motion] * 6, noise=0.006, seed=5)
        measured = measure(images, roughness="estimated", penalty=penalty)
        assert measured.converged.all()
        found[name] = measured.roughness
        truth = np.stack([part(*images.xy.T) for part in motion], axis=-1)
        error = [
            np.sqrt(np.mean((m.at_pixels() - truth)[..., :2] ** 2))
            for m in (measured, measure(images, roughness=np.inf, penalty=penalty))
        ]
        assert error[0] < 1.02 * error[1]
    assert found["smooth"] < 0.5 * found["rough"]
    curved = measure(images, roughness=np.inf, penalty=penalty)
    part = curved.system.parts[0]
    p = curved.coefficients
    own = np.einsum("ti,ti->t", p, (part @ p.T).T).mean() / modes(curved.basis_uv, penalty)
    # Without a penalty the noise is part of the roughness, at this noise a small one.
    assert found["rough"] == pytest.approx(np.sqrt(own), rel=0.25)


@pytest.mark.parametrize("kind", ["tri3", "tri6", "quad4", "quad8"])
@pytest.mark.parametrize("penalty", ["tikhonov", "equilibrium_gap", "elastic"])
def test_every_penalty_is_ramped_down_to_the_true_motion_on_every_mesh(
    scene: Scene, kind: CellKind, penalty: Penalty
) -> None:
    square = distorted(kind)
    mesh = PlaneMesh(square.points * [1.2, 2.4] - [1.8, 0.05], square.cells, kind)
    # 2 % over 7 µm: the ends move by 1.3 px, and stiffness of the first pass must not keep them.
    motion = (linear(0.004, -0.007), linear(0.002, 0.02), linear(0.001, 0.002))
    images = scene([motion], noise=1e-5)
    measured = measure(images, mesh, mesh, penalty=penalty, roughness=PIXEL)
    truth = np.stack([part(*images.xy.T) for part in motion], axis=-1)
    assert measured.converged.all()
    assert np.abs(measured.at_pixels()[0] - truth)[:, :2].max() < 5e-3 * PIXEL


def test_elements_too_small_for_the_pixels_are_refused(scene: Scene) -> None:
    images = scene([(STILL, STILL, STILL)], noise=1e-3)
    with pytest.raises(
        ImageError, match=r"dic.element_px: found \d+ nodal values to be decided by"
    ):
        measure(images, PIXEL, PIXEL)
