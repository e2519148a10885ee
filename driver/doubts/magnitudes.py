"""What travel, times, loads and orientations come to: strain, rate, stress, Schmid factors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from driver.experiment.history import History
from meshes.arrays import FloatArray
from solver_adapters.crystal import SystemTable, schmid_tensors


@dataclass(frozen=True)
class Magnitudes:
    """Sizes of a test.

    Attributes:
        travel: how far the stage goes from where it began [µm].
        strain: of the specimen at that travel [1].
        rate: of the strain while the stage moves [1/s].
        interval: time between two images, or two loads without images; the median [s].
        stress: largest nominal stress [MPa].
        schmid: largest Schmid factor along Y of each grain.
        shear_ratio: largest resolved shear stress at that stress, over tau0 of its grain.
        elastic: strain that this stress makes by elasticity alone, mean of the grains [1].
    """

    travel: float
    strain: float
    rate: float
    interval: float
    stress: float
    schmid: tuple[float, ...]
    shear_ratio: float
    elastic: float


def magnitudes(
    history: History,
    force: FloatArray,
    section: float,
    strain_per_travel: float,
    orientations: FloatArray,
    systems: SystemTable,
    tau0: FloatArray,
    stiffness: tuple[float, float, float],
) -> Magnitudes:
    """Return the sizes of a test.

    Args:
        history: times and stage travel.
        force: load at the specimen [µN], not a number where it does not count, shape (n_images,).
        section: of the specimen [µm²].
        strain_per_travel: strain of the specimen over stage travel [1/µm].
        orientations: crystal → specimen rotation of each grain, shape (n_grains, 3, 3).
        systems: the slip systems.
        tau0: critical resolved shear stress of each grain [MPa], shape (n_grains,).
        stiffness: C11, C12, C44 [MPa].
    """
    travel = float(np.abs(history.stage - history.stage[0]).max())
    # From one turning point to the next, for single intervals have the noise of the travel.
    moved = float(np.abs(np.diff(history.stage[history.turning])).sum())
    moving = float(np.diff(history.time)[np.diff(history.stage) != 0.0].sum())
    stress = float(np.nanmax(np.abs(force))) / section  # µN/µm² = MPa
    schmid = np.array([largest_schmid_factor(rotation, systems) for rotation in orientations])
    moduli = [youngs_modulus(rotation[1], *stiffness) for rotation in orientations]
    return Magnitudes(
        travel=travel,
        strain=strain_per_travel * travel,
        rate=strain_per_travel * moved / moving,
        interval=float(np.median(np.diff(history.time[history.image_row]))),
        stress=stress,
        schmid=tuple(schmid.tolist()),
        shear_ratio=float(np.max(stress * schmid / tau0)),
        elastic=float(np.mean(stress / np.array(moduli))),
    )


def largest_schmid_factor(rotation: FloatArray, systems: SystemTable) -> float:
    """Return the largest Schmid factor of the slip systems for tension along Y, at most 1/2.

    Args:
        rotation: crystal → specimen, shape (3, 3).
        systems: the slip systems.
    """
    along_y = np.einsum("i,sij,j->s", rotation[1], schmid_tensors(systems), rotation[1])
    return float(np.abs(along_y).max())


def youngs_modulus(direction: FloatArray, C11: float, C12: float, C44: float) -> float:
    """Return Young's modulus of a cubic crystal along a direction, in the unit of its constants.

    Args:
        direction: unit vector in crystal axes, shape (3,).
        C11: elastic constant.
        C12: elastic constant.
        C44: elastic constant.
    """
    determinant = (C11 - C12) * (C11 + 2.0 * C12)
    s11, s12, s44 = (C11 + C12) / determinant, -C12 / determinant, 1.0 / C44
    x, y, z = (np.asarray(direction) ** 2).tolist()
    return float(1.0 / (s11 - 2.0 * (s11 - s12 - s44 / 2.0) * (x * y + y * z + z * x)))
