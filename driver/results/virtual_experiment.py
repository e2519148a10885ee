"""A virtual experiment on disk: its images, its history and its truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from driver.experiment.history import COLUMNS, History
from driver.results.files import (
    FLATS_TIF,
    HISTORY_CSV,
    IMAGES_TIF,
    LABELS_TIF,
    REPEATS_TIF,
    TRUTH,
    TRUTH_H5,
)
from driver.results.hdf5 import prismid_version, write_hdf5
from driver.results.json_files import write_json
from meshes.arrays import FloatArray, IntArray

Levels = Sequence[NDArray[np.generic]]


@dataclass(frozen=True, eq=False)
class Truth:
    """What happened and how it was seen, T images of R rows and C columns, n nodes of the face.

    Attributes:
        seed: of relief, stage and noise.
        values: every parameter of the general model by name.
        units: unit of each.
        origin_error: by how much the pixels lie further along X and Y than the case states [µm],
            shape (2,).
        n_cells: cells of the mesh of the truth.
        settings: of the microscope and the face, as JSON has them.
        x: X of the pixels [µm], shape (R, C).
        y: Y of the pixels [µm], shape (R, C).
        relief: height of the surface before loading [µm], shape (R, C).
        pattern: fixed pattern as the flats show it [µm], shape (R, C).
        noise: standard deviation of a pixel of one image [µm], shape (R, C).
        stage: rigid translation of each image along X, Y, Z [µm], shape (T, 3).
        motion: motion of the material at the pixels, without the stage [µm], shape (T, R, C, 3).
        load: load reading without noise [µN], shape (T,).
        nodes: nodes of the face (X, Y) [µm], shape (n, 2).
        nodal_motion: their motion [µm], shape (T, n, 3).
    """

    seed: int
    values: Mapping[str, float]
    units: Mapping[str, str]
    origin_error: FloatArray
    n_cells: int
    settings: Mapping[str, Any]
    x: FloatArray
    y: FloatArray
    relief: FloatArray
    pattern: FloatArray
    noise: FloatArray
    stage: FloatArray
    motion: FloatArray
    load: FloatArray
    nodes: FloatArray
    nodal_motion: FloatArray


def write_images(folder: Path, images: Levels, repeats: Levels, flats: Levels) -> None:
    """Write the three stacks of height maps as levels.

    Args:
        folder: where they go.
        images: one after each stop of the stage, image 0 before loading, each of shape (R, C).
        repeats: images of the unloaded specimen.
        flats: images of a flat surface.
    """
    for name, stack in ((IMAGES_TIF, images), (REPEATS_TIF, repeats), (FLATS_TIF, flats)):
        tifffile.imwrite(folder / name, np.stack(stack), photometric="minisblack")


def write_labels(folder: Path, labels: IntArray) -> None:
    """Write the number of the grain at each pixel, shape (R, C).

    Args:
        folder: where `labels.tif` goes.
        labels: from 1.
    """
    tifffile.imwrite(folder / LABELS_TIF, labels.astype(np.uint16), photometric="minisblack")


def write_history(folder: Path, history: History, force: FloatArray) -> None:
    """Write times [s], stage travel [µm], and images with their forces [N].

    Args:
        folder: where `history.csv` goes.
        history: the rows of the test.
        force: force of each image at the load cell [N], shape (T,).
    """
    image_of = {int(row): image for image, row in enumerate(history.image_row)}
    lines = [",".join(COLUMNS)]
    for row, (time, stage) in enumerate(zip(history.time, history.stage, strict=True)):
        taken = f"{image_of[row]},{force[image_of[row]]:.4f}" if row in image_of else ","
        lines.append(f"{time:.10g},{stage:.10g},{taken}")
    (folder / HISTORY_CSV).write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_truth(folder: Path, truth: Truth) -> None:
    """Write `truth.json` and `truth.h5`.

    Args:
        folder: where they go.
        truth: what they hold.
    """
    record = {
        "prismid": prismid_version(),
        "seed": truth.seed,
        "values": {
            name: {"value": value, "unit": truth.units[name]}
            for name, value in truth.values.items()
        },
        "origin_error_um": truth.origin_error.tolist(),
        "n_cells": truth.n_cells,
        "settings": dict(truth.settings),
    }
    write_json(folder / TRUTH, record, indent=2)
    write_hdf5(
        folder / TRUTH_H5,
        {
            "x": (truth.x, "µm"),
            "y": (truth.y, "µm"),
            "relief": (truth.relief, "µm"),
            "pattern": (truth.pattern, "µm"),
            "noise": (truth.noise, "µm"),
            "stage": (truth.stage, "µm"),
            "motion": (truth.motion.astype(np.float32), "µm"),
            "load": (truth.load, "µN"),
            "nodes": (truth.nodes, "µm"),
            "nodal_motion": (truth.nodal_motion, "µm"),
        },
    )
