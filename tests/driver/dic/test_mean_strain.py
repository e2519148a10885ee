from __future__ import annotations

import numpy as np
import pytest

from driver.dic.basis import grid_basis
from driver.dic.mean_strain import ImageOfFace, mean_strains
from driver.dic.system import sensitivity
from meshes.arrays import FloatArray

BOUNDS = (-2.0, 2.0, 0.0, 6.0)
_X, _Y = np.meshgrid(np.linspace(-1.9, 1.9, 20), np.linspace(0.1, 5.9, 30), indexing="ij")
XY = np.column_stack([_X.ravel(), _Y.ravel()])
BASIS_UV, BASIS_W = grid_basis(XY, BOUNDS, 2.0), grid_basis(XY, BOUNDS, 1.0)
GRADIENT = np.random.default_rng(7).normal(0.0, 0.05, (len(XY), 2))
SEEN = sensitivity(GRADIENT, BASIS_UV, BASIS_W)
SIGMA = 0.01
PART = (XY[:, 1] > 3.0).astype(np.int64)  # as two elements of the grid part


def face(truth: FloatArray, found: FloatArray, noise: FloatArray | float = 0.0) -> ImageOfFace:
    """An image of a motion that was found as another one."""
    residual = SEEN @ (truth - found) + noise
    return ImageOfFace(XY, GRADIENT, found, residual, np.full(len(XY), SIGMA**2))


def motion() -> FloatArray:
    """Bilinear u and v, any w, as nodal values."""
    x, y = BASIS_UV.nodes.T
    w = np.random.default_rng(8).normal(size=len(BASIS_W.nodes))
    return np.concatenate([0.5 + 0.01 * x - 0.02 * y + 0.004 * x * y, 0.03 * y + 0.05 * x, w])


def strains_by_hand(part: int) -> list[float]:
    mean_x, mean_y = XY[PART == part].mean(axis=0)
    return [0.01 + 0.004 * mean_y, 0.03, -0.02 + 0.004 * mean_x + 0.05]


@pytest.mark.parametrize("share", [1.0, 0.2, 0.0])
def test_strains_are_exact_whatever_a_penalty_has_held_back(share: float) -> None:
    found = mean_strains(face(motion(), share * motion()), BASIS_UV, BASIS_W, PART, 3)
    for part in (0, 1):
        assert found.values[part] == pytest.approx(strains_by_hand(part), abs=1e-12)
    assert np.isnan(found.values[2]).all() and np.isnan(found.covariance[2]).all()


def test_rotation_and_translation_are_no_strain() -> None:
    x, y = BASIS_UV.nodes.T
    turn = np.concatenate([1.0 - 0.02 * y, 2.0 + 0.02 * x, np.ones(len(BASIS_W.nodes))])
    found = mean_strains(face(turn, 0.0 * turn), BASIS_UV, BASIS_W, PART, 2)
    assert found.values == pytest.approx(np.zeros((2, 3)), abs=1e-12)


def test_noise_scatters_the_strains_as_stated() -> None:
    rng, truth = np.random.default_rng(9), motion()
    repeated = np.array([
        mean_strains(
            face(truth, truth, rng.normal(0.0, SIGMA, len(XY))), BASIS_UV, BASIS_W, PART, 2
        ).values
        for _ in range(200)
    ])  # fmt: skip
    stated = mean_strains(face(truth, truth), BASIS_UV, BASIS_W, PART, 2).covariance
    for part in (0, 1):
        deviation = np.sqrt(stated[part].diagonal())
        scatter = np.cov(repeated[:, part].T) / np.outer(deviation, deviation)
        # Entries of a covariance of 200 are known to 0.1 at most.
        assert scatter == pytest.approx(stated[part] / np.outer(deviation, deviation), abs=0.3)


def test_pixels_without_a_height_are_passed_over() -> None:
    image = face(motion(), 0.0 * motion())
    image.residual[::3] = np.nan
    found = mean_strains(image, BASIS_UV, BASIS_W, PART, 2)
    whole = mean_strains(face(motion(), motion()), BASIS_UV, BASIS_W, PART, 2)
    assert found.values == pytest.approx(whole.values, abs=1e-12)
    assert (found.covariance[:, 1, 1] > whole.covariance[:, 1, 1]).all()


def test_an_element_with_next_to_no_heights_leaves_strains_undecided_and_never_impossible() -> None:
    element = np.flatnonzero((XY > [0.0, 4.0]).all(axis=1))
    for seed in range(20):
        image = face(motion(), motion())
        image.residual[np.random.default_rng(seed).permutation(element)[4:]] = np.nan
        found = mean_strains(image, BASIS_UV, BASIS_W, PART, 2)
        decided = np.isfinite(found.values).all(axis=1)
        assert not decided[1] and np.isnan(found.covariance[~decided]).all()
        np.linalg.cholesky(found.covariance[decided])


def test_a_face_without_relief_has_no_strain_to_tell() -> None:
    flat = ImageOfFace(XY, 0.0 * GRADIENT, motion(), np.zeros(len(XY)), np.ones(len(XY)))
    assert np.isnan(mean_strains(flat, BASIS_UV, BASIS_W, PART, 2).values).all()
