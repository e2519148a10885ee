from __future__ import annotations

import numpy as np
import pytest

from driver.noise_floor.command import table
from driver.noise_floor.floor import Row, chosen, share_of_noise
from driver.noise_floor.laboratory import QUANTITIES, Errors


def row(size: float, elongation: float, strain: float) -> Row:
    nothing = {quantity: np.zeros(1) for quantity in QUANTITIES}
    scatter = nothing | {"elongation": np.array([elongation]), "strain": np.array([strain])}
    return Row(size, size / 2, Errors(nothing, scatter, 0.02, 1.0), 0.025)


def test_the_mesh_to_take_has_the_least_strain_error_among_those_of_good_elongation() -> None:
    rows = [row(8, 0.0100, 0.02), row(16, 0.0109, 0.01), row(32, 0.0111, 0.005)]
    assert chosen(rows).size == 16
    assert chosen(rows[:1]).size == 8


def test_the_table_marks_the_mesh_and_sets_both_noises_beside_the_paper() -> None:
    rows = [row(8, 0.01, 0.02), row(16, 0.01, 0.01)]
    lines = table(rows, rows[1], 9)
    (marked,) = [line for line in lines if "← take" in line]
    assert marked.startswith("        16") and "0 / 1 " in marked
    # 25 nm by 10 repeats: ± 25/√18.
    assert "predicted 20.0 nm, by 10 repeats 25.0 ± 5.9 nm; the paper 26 nm" in lines[-1]


def test_a_mesh_on_which_images_did_not_converge_is_named() -> None:
    stopped = row(8, 0.01, 0.02)
    stopped = Row(8, 4, Errors(stopped.errors.bias, stopped.errors.scatter, 0.02, 0.9), 0.025)
    assert table([stopped], stopped, 9)[-1].endswith("elements of 8 px")


def test_the_share_of_noise_in_the_slopes_is_that_of_what_was_added() -> None:
    rng = np.random.default_rng(0)
    ramp = np.sin(np.arange(400) / 5)[:, None] * np.ones(300)
    sigma, n = 0.3, 9
    noisy = ramp + sigma / np.sqrt(n) * rng.normal(size=ramp.shape)
    region = np.zeros(ramp.shape, dtype=bool)
    region[5:-5, 5:-5] = True
    # Central differences: the wave has slopes of rms sin(1/5)/√2, noise σ/√2n in each direction.
    signal, noise = np.sin(0.2) ** 2 / 2, sigma**2 / n
    share = share_of_noise(noisy, region, sigma, n)
    assert share == pytest.approx(noise / (signal + noise), rel=0.03)
