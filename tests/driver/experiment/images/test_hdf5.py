from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy import io

from driver.experiment.images.heightmaps import ImageError, load_stack


def test_an_array_of_matlab_has_the_rows_and_columns_that_matlab_shows(tmp_path: Path) -> None:
    """MATLAB's (rows, columns, frames) lies in the file as (frames, columns, rows)."""
    shown = np.arange(4 * 5 * 3, dtype=np.float64).reshape(4, 5, 3)
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        file["frames"] = shown.T
        file["frames"].attrs["MATLAB_class"] = np.bytes_("double")
    levels = load_stack(tmp_path / "a.mat:/frames").levels
    assert levels.shape == (3, 4, 5)
    assert np.array_equal(levels, shown.transpose(2, 0, 1))


def test_an_older_file_of_matlab_is_told_the_version_that_is_read(tmp_path: Path) -> None:
    io.savemat(tmp_path / "a.mat", {"frames": np.ones((4, 5))})
    with pytest.raises(ImageError, match=r"a\.mat.*expected a MATLAB file of version 7\.3"):
        load_stack(tmp_path / "a.mat:/frames")


def test_a_filter_that_is_not_there_is_named(tmp_path: Path) -> None:
    unknown = 499  # of the numbers that are left to tests
    with h5py.File(tmp_path / "a.h5", "w") as file:
        created = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        created.set_chunk((1, 4, 5))
        created.set_filter(unknown, h5py.h5z.FLAG_OPTIONAL)
        space = h5py.h5s.create_simple((2, 4, 5))
        made = h5py.h5d.create(file.id, b"a", h5py.h5t.NATIVE_UINT8, space, created)
        for frame in range(2):
            h5py.Dataset(made).id.write_direct_chunk((frame, 0, 0), bytes(20), 0)
    told = r"compressed by filter 499 .*lacks, expected `pip install hdf5plugin`"
    with pytest.raises(ImageError, match=told):
        load_stack(tmp_path / "a.h5:/a")
