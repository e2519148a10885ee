from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from driver.results.hdf5 import prismid_version
from driver.results.noise_floor import Errors, NoiseFloor, Row, over_motions, write_noise_floor

NAMES = ("u", "v", "w", "strain", "elongation")


def row(size: float, first: float) -> Row:
    """Two motions, the bias of the second twice and the scatter three times that of the first."""
    bias = {name: first * np.array([1.0, 2.0]) for name in NAMES}
    scatter = {name: first * np.array([1.0, 3.0]) for name in NAMES}
    return Row(size, size / 2, Errors(bias, scatter, predicted=0.02, converged=0.75), 0.025)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rows = (row(12, 0.001), row(24, 0.002))
    floor = NoiseFloor(
        rows=rows, take=rows[1], rule="the larger", noise=0.003, relief=0.05, n_reference=10,
        interpolation_error=2e-6, noise_in_slopes=0.1, series=4, draws=2, paper_gamma_u=0.026,
        freedom=9, motions=(("still", "rigid"), ("shift", "rigid")),
    )  # fmt: skip
    write_noise_floor(tmp_path, floor)
    return tmp_path


def test_lengths_stand_in_nanometres_and_strain_as_a_pure_number(folder: Path) -> None:
    record = json.loads((folder / "noise_floor.json").read_text("utf-8"))
    meshes = record.pop("meshes")
    assert record == {
        "prismid": prismid_version(), "element_px": 24, "height_element_px": 12.0,
        "rule": "the larger", "noise_nm": 3.0, "relief_nm": 50.0, "n_reference": 10,
        "interpolation_error_nm": pytest.approx(0.002), "share_of_noise_in_slopes": 0.1,
        "series": 4, "draws": 2, "gamma_u_paper_nm": 26.0, "gamma_u_measured_freedom": 9,
        "motions": [{"name": "still", "kind": "rigid"}, {"name": "shift", "kind": "rigid"}],
    }  # fmt: skip
    first = meshes[0]
    # Root of the mean of 1 + 1 and 4 + 9.
    for name, factor in (("u_nm", 1.0), ("v_nm", 1.0), ("w_nm", 1.0), ("strain", 1e-3),
                         ("elongation_nm", 1.0)):  # fmt: skip
        assert first.pop(name) == {
            "bias": pytest.approx([factor, 2 * factor]),
            "scatter": pytest.approx([factor, 3 * factor]),
            "total": pytest.approx(factor * np.sqrt(7.5)),
        }
    assert first == {
        "element_px": 12, "height_element_px": 6.0, "gamma_u_predicted_nm": 20.0,
        "gamma_u_laboratory_nm": pytest.approx(np.sqrt(5)), "gamma_u_measured_nm": 25.0,
        "converged": 0.75,
    }  # fmt: skip


def test_the_table_has_a_mesh_a_row_root_mean_square_over_the_motions(folder: Path) -> None:
    with (folder / "noise_floor.csv").open(encoding="utf-8", newline="") as file:
        first, second = csv.DictReader(file)
    assert list(first) == [
        "element_px", "height_element_px", "u_nm_bias", "u_nm_scatter", "v_nm_bias",
        "v_nm_scatter", "w_nm_bias", "w_nm_scatter", "strain_bias", "strain_scatter",
        "elongation_nm_bias", "elongation_nm_scatter", "gamma_u_predicted_nm",
        "gamma_u_measured_nm",
    ]  # fmt: skip
    assert float(second["u_nm_bias"]) == pytest.approx(2 * np.sqrt(2.5), rel=1e-5)
    assert float(second["strain_scatter"]) == pytest.approx(2e-3 * np.sqrt(5), rel=1e-5)
    assert (first["element_px"], first["gamma_u_measured_nm"]) == ("12", "25")


def test_over_the_motions_an_error_is_its_root_mean_square() -> None:
    assert over_motions(np.array([3.0, -4.0, 0.0])) == pytest.approx(5 / np.sqrt(3))
