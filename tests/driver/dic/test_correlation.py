from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import csc_array
from threadpoolctl import threadpool_info, threadpool_limits

from driver.common.machine import cores
from driver.common.splines.images import samples
from driver.dic import correlation, engine
from driver.dic.basis import grid_basis, mesh_basis
from driver.dic.correlation import Correlation, Options, correlate
from driver.dic.regularisation import Penalty, modes, penalties
from driver.dic.surface_images import SurfaceImages
from driver.experiment.images.heightmaps import ImageError
from meshes.arrays import FloatArray
from meshes.plane_cells import CellKind
from meshes.plane_mesh import PlaneMesh
from meshes.surface import SurfaceMesh
from tests.meshes.plane_examples import distorted

Field = Callable[[FloatArray, FloatArray], FloatArray]
Scene = Callable[..., SurfaceImages]
PIXEL = 0.11
NONE = Options(roughness=np.inf, roughness_w=np.inf)


def still(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.zeros(np.broadcast_shapes(x.shape, y.shape))


def arrays(images: SurfaceImages) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Reference, frames and mask; the first pixel becomes the origin."""
    mask = np.zeros(images.shape, dtype=bool)
    mask[images.rows, images.cols] = True
    return (
        images.reference_image,
        np.array([*map(samples, np.array(images.frames.coefficients))]),
        mask,
    )


def error(
    found: Correlation, images: SurfaceImages, motion: Sequence[Field], t: int = 0
) -> FloatArray:
    """Found less true u, v, w [µm] at the pixels."""
    at = found.system.pixels
    x, y = ((p - o) * PIXEL for p, o in zip((at.rows, at.cols), images.frames.origin, strict=True))
    return found.at_pixels(t) - np.stack([part(x, y) for part in motion], axis=-1)


@pytest.mark.parametrize("component", [0, 1, 2])
def test_each_component_has_its_sign_and_size(scene: Scene, component: int) -> None:
    motion = [still, still, still]
    motion[component] = lambda x, y: 0.004 * x - 0.007 * y + 0.02
    images = scene([tuple(motion)], noise=1e-6)
    f, g, mask = arrays(images)
    found = correlate(f, g, PIXEL, mask, sigma=1e-6, options=Options(tolerance=1e-4))
    wrong = error(found, images, motion)
    assert found.converged.all()
    assert np.abs(wrong[:, :2]).max() < 3e-3 * PIXEL
    assert np.abs(wrong[:, 2]).max() < 3e-4


def covering(kind: CellKind, scale: float = 3.3) -> PlaneMesh:
    """A distorted mesh that holds the region of interest, 1.1 or 2.2 µm a cell."""
    mesh = distorted(kind, scale=scale)
    return PlaneMesh(mesh.points + [0.4, 0.3], mesh.cells, kind)


@pytest.mark.parametrize("kind", ["tri3", "tri6", "quad4", "quad8"])
def test_an_affine_motion_is_met_on_any_mesh_with_its_own_for_w(
    scene: Scene, kind: CellKind
) -> None:
    motion = (
        lambda x, y: 0.010 * x + 0.004 * y,
        lambda x, y: 0.03 - 0.006 * x + 0.008 * y,
        lambda x, y: 0.01 + 0.002 * y,
    )
    images = scene([motion], noise=1e-7)
    f, g, mask = arrays(images)
    found = correlate(f, g, PIXEL, mask, covering(kind), 12.0, sigma=1e-7, options=NONE)
    assert found.converged.all()
    assert found.basis_uv.mesh.kind == kind
    wrong = error(found, images, motion)
    assert np.sqrt(np.mean(wrong[:, :2] ** 2)) < 3e-3 * PIXEL
    assert np.sqrt(np.mean(wrong[:, 2] ** 2)) < 1e-4


def test_the_trace_of_the_volume_mesh_is_a_basis(scene: Scene) -> None:
    mesh = covering("tri6")
    surface = SurfaceMesh(mesh.points, mesh.cells, np.arange(len(mesh.points)))
    images = scene([(still, still, still)], noise=1e-4)
    f, g, mask = arrays(images)
    found = correlate(f, g, PIXEL, mask, surface.plane)
    assert found.coefficients.shape[1] == 2 * len(mesh.points) + len(found.basis_w.nodes)
    assert np.abs(found.at_pixels()[:, :2]).max() < 0.02 * PIXEL


SHIFT = (
    lambda x, y: still(x, y) + 0.37 * PIXEL,
    lambda x, y: still(x, y) - 0.21 * PIXEL,
    still,
)


@pytest.mark.parametrize(
    "options",
    [
        NONE,
        Options(roughness=0.05, roughness_w=0.05),
        Options(penalty="equilibrium_gap", roughness=0.02, roughness_w=np.inf),
        Options(penalty="elastic", roughness=0.05, roughness_w=np.inf),
    ],
    ids=["none", "tikhonov", "equilibrium_gap", "elastic"],
)
def test_the_covariance_is_the_scatter_of_100_draws_under_each_regularisation(
    scene: Scene, options: Options
) -> None:
    images = scene([(still, still, still)] * 100, noise=0.009, n_repeats=400, seed=5)
    f, g, mask = arrays(images)
    found = correlate(f, g, PIXEL, mask, sigma=0.009, n_reference=400, options=options)
    scatter = found.coefficients - found.coefficients.mean(axis=0)
    covariance = found.covariance_one()
    for part in np.split(np.arange(scatter.shape[1]), [2 * found.system.n_uv]):
        precision = np.linalg.inv(covariance[np.ix_(part, part)])
        squares = np.einsum("ti,ij,tj->", scatter[:, part], precision, scatter[:, part])
        ratio = squares / (99 * len(part))  # known to √(2/(99·50)) = 2 %
        assert ratio == pytest.approx(1.0, abs=0.1)
    if options is not NONE:
        free = correlate(f, g[:1], PIXEL, mask, sigma=0.009, n_reference=400, options=NONE)
        less = covariance.diagonal() / free.covariance_one().diagonal()
        assert (less < 1).all() and less.min() < 0.8


def test_noise_and_roughness_are_estimated_from_the_images(scene: Scene) -> None:
    images = scene([SHIFT] * 3, noise=0.009, seed=6)
    f, g, mask = arrays(images)
    found = correlate(f, g, PIXEL, mask, n_reference=10)
    assert found.sigma == pytest.approx(0.009, rel=0.03)
    assert found.chi == pytest.approx(1.0, abs=0.03)
    # a translation has no second differences: what is granted is far below a pixel
    assert found.roughness < 0.1
    fixed = correlate(f, g, PIXEL, mask, sigma=0.009, n_reference=10, options=NONE)
    rms = [np.sqrt(np.mean(error(c, images, SHIFT)[:, :2] ** 2)) for c in (found, fixed)]
    assert rms[0] < 0.5 * rms[1]


def test_threads_change_nothing(scene: Scene) -> None:
    images = scene([SHIFT, (still, still, still), SHIFT] * 2, noise=0.009, seed=7)
    f, g, mask = arrays(images)
    one, three = (
        correlate(f, g, PIXEL, mask, options=Options(workers=n)).coefficients for n in (1, 3)
    )
    assert np.array_equal(one, three)


def test_pixels_without_height_take_no_part_in_either_image(scene: Scene) -> None:
    images = scene([SHIFT], noise=1e-4)
    f, g, mask = arrays(images)
    f, g = f.copy(), g.copy()
    f[20:24, 40:44] = np.nan
    g[0, 10:14, 60:64] = np.nan
    found = correlate(f, g, PIXEL, mask, sigma=1e-4)
    assert np.sqrt(np.mean(error(found, images, SHIFT)[:, :2] ** 2)) < 0.01 * PIXEL
    picture = found.residual_map()
    assert np.isnan(picture[20:24, 40:44]).all() and np.isnan(picture[11:13, 61:63]).all()
    assert np.isfinite(picture).sum() > 0.9 * mask.sum()
    in_sigma = found.residual_map(in_sigma=True)
    used = np.isfinite(in_sigma)
    assert np.sqrt(np.mean(in_sigma[used] ** 2)) < 3
    assert np.array_equal(np.sign(in_sigma[used]), np.sign(picture[used]))


def test_what_failed_says_what_to_try(scene: Scene) -> None:
    images = scene([SHIFT], noise=1e-3)
    f, _, mask = arrays(images)
    other = np.random.default_rng(8).normal(size=f.shape)
    found = correlate(f, other, PIXEL, mask, sigma=1e-3, options=NONE)
    assert not found.converged[0]
    assert "; try" in found.reason[0]


def test_affine_motions_are_in_equilibrium_and_rigid_ones_cost_no_energy(scene: Scene) -> None:
    images = scene([SHIFT], noise=1e-3)
    f, g, mask = arrays(images)
    for kind in ("tri3", "tri6", "quad4", "quad8"):
        found = correlate(f, g, PIXEL, mask, covering(kind), 12.0, sigma=1e-3, options=NONE)
        x, y = found.basis_uv.nodes.T
        n = len(x)
        rest = np.zeros(len(found.basis_w.nodes))
        affine = np.concatenate([0.3 * x - 0.1 * y, 0.2 * x + 0.5 * y, rest])
        turned = np.concatenate([1 - y, x, rest])
        bent = np.concatenate([x**2, np.zeros(n), rest])
        cases: list[tuple[Penalty, FloatArray, FloatArray]] = [
            ("equilibrium_gap", affine, bent),
            ("elastic", turned, affine),
        ]
        for penalty, free, costs in cases:
            r = penalties(found.basis_uv, found.basis_w, penalty)[0]
            assert free @ (r @ free) < 1e-20 + 1e-12 * (costs @ (r @ costs))
            assert costs @ (r @ costs) > 1e-3


AWAY = PlaneMesh(distorted("tri3").points - 9, distorted("tri3").cells, "tri3")


def relief() -> FloatArray:
    return np.random.default_rng(9).normal(size=(40, 60))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"images": np.zeros((40, 61))}, r"image 0 of \(40, 61\) px, but the reference has"),
        ({"images": []}, "the stack is empty"),
        ({"images": np.zeros((40, 60), complex)}, "image 0 of complex numbers"),
        ({"images": np.full((40, 60), np.nan)}, "image 0: no pixel carries a height"),
        ({"reference": np.zeros(40)}, r"reference of shape \(40,\)"),
        ({"reference": np.ones((40, 60))}, "no relief"),
        ({"mask": np.zeros((40, 60))}, "no pixel to correlate"),
        ({"reference": relief()[:1], "images": relief()[:1]}, "none lies in 2 × 2 whole pixels"),
        ({"mask": np.zeros((40, 50))}, r"mask of \(40, 50\) px"),
        ({"pixel": 0.0}, "pixel = 0.0"),
        ({"sigma": -1.0}, "sigma = -1.0"),
        ({"n_reference": 0}, "n_reference = 0"),
        ({"n_reference": np.nan}, "n_reference = nan"),
        ({"mesh_uv": -8.0}, "element of -8.0 px"),
        ({"gradient": np.zeros((40, 60))}, r"gradient of shape \(40, 60\)"),
        ({"gradient": np.full((40, 60, 2), np.nan)}, "gradient without a value"),
        ({"start": np.zeros((40, 60))}, r"start of shape \(40, 60\); one that spreads over"),
        ({"start": np.array([np.nan, 0.0])}, "start without a value at some pixels"),
        ({"mesh_uv": AWAY}, "no pixel lies in the mesh"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(change: dict[str, Any], said: str) -> None:
    arguments = {"reference": relief(), "images": relief(), **change}
    with pytest.raises(ImageError, match=said):
        correlate(**arguments)


def test_what_a_masked_array_masks_carries_no_height() -> None:
    f, gap = relief(), np.zeros((40, 60), dtype=bool)
    gap[10:14, 20:24] = True
    masked = np.ma.array(np.where(gap, 1e3, f), mask=gap)
    absent = np.where(gap, np.nan, f)
    for reference, image, same in ((masked, f, (absent, f)), (f, masked, (f, absent))):
        found = correlate(reference, [image], options=NONE).coefficients
        assert np.array_equal(found, correlate(same[0], [same[1]], options=NONE).coefficients)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"roughness": 0.0}, "roughness = 0.0"),
        ({"roughness_w": -1.0}, "roughness_w = -1.0"),
        ({"workers": 0}, "workers = 0"),
        ({"tolerance": 0.0}, "tolerance = 0.0"),
        ({"penalty": "none"}, "penalty = none; one of tikhonov, equilibrium_gap, elastic"),
    ],
)
def test_impossible_options_are_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(ImageError, match=said):
        Options(**change)


@pytest.mark.parametrize("kind", ["tri3", "tri6", "quad4", "quad8"])
def test_second_derivatives_on_any_mesh_cost_nothing_for_an_affine_motion(kind: CellKind) -> None:
    mesh = distorted(kind)
    basis = mesh_basis(np.array([[1.1, 1.3]]), mesh)
    part, _ = penalties(basis, basis, "tikhonov")
    x, y = mesh.points.T
    affine = np.concatenate([1 + 2 * x - y, 3 * x + y, 0 * x])
    bent = np.concatenate([x**2, 0 * x, 0 * x])
    assert abs(affine @ part @ affine) < 1e-10 * (bent @ part @ bent)
    assert bent @ part @ bent > 1e-3
    assert modes(basis, "tikhonov") == np.linalg.matrix_rank(np.asarray(part))


@pytest.mark.parametrize("penalty", ["tikhonov", "equilibrium_gap", "elastic"])
def test_the_modes_that_cost_are_the_rank_of_the_penalty(penalty: Penalty) -> None:
    xy = np.array([[1.1, 1.3]])
    for basis in (grid_basis(xy, (0, 3, 0, 4), 1.0), mesh_basis(xy, distorted("tri6"))):
        part, _ = penalties(basis, basis, penalty)
        assert modes(basis, penalty) == np.linalg.matrix_rank(np.asarray(part))


@pytest.fixture(scope="module")
def drifting() -> tuple[FloatArray, list[FloatArray]]:
    """Reference and two images of a relief of 1 that moves and stretches, noise 0.05."""
    rng = np.random.default_rng(1)
    relief = ndimage.gaussian_filter(rng.normal(size=(180, 220)), 2.5)
    row, col = np.mgrid[:110, :150].astype(float)

    def image(u: float, v: float) -> FloatArray:
        at = [row + 30 - u * (1 + 0.001 * row), col + 30 - v * (1 + 0.002 * col)]
        seen = ndimage.map_coordinates(relief / relief.std(), at, order=5)
        return np.asarray(seen + rng.normal(0.0, 0.05, seen.shape))

    return image(0.0, 0.0), [image(0.4, 0.3), image(1.0, 0.8)]


@pytest.mark.parametrize("element", [16.0, 40.0], ids=["sparse", "dense"])
@pytest.mark.parametrize(("unit", "pixel"), [(1e-9, 1.0), (1e6, 1.0), (1e-9, 1e6), (1e6, 1e-9)])
def test_the_units_of_heights_and_of_pixels_change_nothing(
    drifting: tuple[FloatArray, list[FloatArray]], element: float, unit: float, pixel: float
) -> None:
    f, g = drifting
    plain = correlate(f, g, mesh_uv=element, mesh_w=element / 2)
    found = correlate(f * unit, [h * unit for h in g], pixel, None, element, element / 2)
    motion = found.at_pixels(1) / [pixel, pixel, unit]
    assert motion == pytest.approx(plain.at_pixels(1), abs=1e-6)
    assert found.chi == pytest.approx(plain.chi, rel=1e-6)
    assert found.sigma == pytest.approx(plain.sigma * unit, rel=1e-6)
    assert found.roughness == pytest.approx(plain.roughness, rel=1e-6)
    assert found.system.freedom() == pytest.approx(plain.system.freedom(), rel=1e-6)
    assert found.reason == plain.reason


def test_the_unknowns_that_images_decide_are_counted_in_any_unit(
    drifting: tuple[FloatArray, list[FloatArray]],
) -> None:
    f, g = drifting
    system = correlate(f * 1e-6, [g[0] * 1e-6]).system
    matrix, *parts = (csc_array(part).toarray() for part in (system.hessian, *system.parts))
    held = sum(w * part for w, part in zip(system.weights, parts, strict=True))
    exact = float(np.trace(np.linalg.solve(matrix + held, matrix)))
    # of 456 unknowns, whose share that is held is known to 1 %
    assert system.freedom() == pytest.approx(exact, abs=0.01 * system.size)


def out_of_focus(image: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(ndimage.gaussian_filter(image, 4.0))


def another_field(image: FloatArray, other: FloatArray) -> FloatArray:
    return other


def mirrored(image: FloatArray, other: FloatArray) -> FloatArray:
    return image[::-1]


@pytest.fixture(scope="module")
def series() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Five images of a relief of 1 that moves and stretches, noise 0.05; and one of another."""
    rng = np.random.default_rng(3)
    reliefs = [ndimage.gaussian_filter(rng.normal(size=(130, 150)), 2.5) for _ in range(2)]
    row, col = np.mgrid[:90, :110].astype(float)

    def image(relief: FloatArray, t: int) -> FloatArray:
        at = [row + 20 - 0.2 * t, col + 20 + 0.15 * t - 0.0002 * t * col]
        seen = ndimage.map_coordinates(relief / relief.std(), at, order=5)
        return np.asarray(seen + rng.normal(0.0, 0.05, seen.shape))

    images = np.array([image(reliefs[0], t) for t in range(6)])
    return images[0], images[1:], image(reliefs[1], 3)


@pytest.mark.parametrize(("spoil", "at"), [(out_of_focus, 3), (another_field, 0), (mirrored, 2)])
def test_a_bad_image_spoils_no_other(
    series: tuple[FloatArray, FloatArray, FloatArray],
    spoil: Callable[[FloatArray, FloatArray], FloatArray],
    at: int,
) -> None:
    f, images, other = series
    spoilt = images.copy()
    spoilt[at] = spoil(images[at], other)
    good, found = correlate(f, images), correlate(f, spoilt)
    others = np.arange(len(images)) != at
    assert found.unlike.tolist() == (~others).tolist()
    assert found.converged[others].all() and found.chi[at] > 5
    assert found.converged[at] or "its motion was not found" in found.reason[at]
    assert found.sigma == pytest.approx(good.sigma, rel=0.01)
    # 0.02 px; a bad image that had a say asked for 4 px and more
    assert found.roughness == pytest.approx(good.roughness, rel=0.5)
    for t in np.flatnonzero(others).tolist():
        wrong = found.at_pixels(t) - good.at_pixels(t)
        assert np.sqrt(np.mean(wrong**2)) < 2e-3


def test_images_alike_are_all_heard(series: tuple[FloatArray, FloatArray, FloatArray]) -> None:
    assert not correlate(series[0], series[1][:2]).unlike.any()


@pytest.mark.skipif(cores() < 2, reason="one core has one thread")
def test_blas_has_one_thread_in_a_correlation(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its matrices are small: on a busy machine threads that wait for each other took 20 times."""
    threads: list[int] = []

    def solve(*arguments: Any, **named: Any) -> Any:
        found = threadpool_info()
        threads.extend(each["num_threads"] for each in found if each["user_api"] == "blas")
        return engine.solve(*arguments, **named)

    monkeypatch.setattr(correlation, "solve", solve)
    f, g, mask = arrays(scene([(still, still, still)], noise=1e-3))
    with threadpool_limits(2, "blas"):
        correlate(f, g, PIXEL, mask)
    assert threads and set(threads) == {1}
