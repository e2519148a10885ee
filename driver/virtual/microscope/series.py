"""A series of height maps of a face in motion, with repeats and images of a flat surface."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from driver.virtual.microscope.camera import Camera, Scene
from driver.virtual.microscope.face_motion import Face, NodalMotion
from driver.virtual.microscope.inversion import Motion, material_points
from driver.virtual.microscope.relief import Relief
from driver.virtual.microscope.slip_steps import SlipSteps
from meshes.arrays import FloatArray

Image = NDArray[np.generic]


@dataclass(frozen=True, eq=False)
class Subject:
    """What is looked at: a face that moves.

    Attributes:
        face: the face, n nodes.
        motion: motion of its nodes as a stage at rest would show it [µm], shape (T, n, 3).
        relief: heights of the undeformed face.
        steps: slip steps, or None.
        half_width: beyond this |X| of the material there is a trench out of range [µm]; infinite
            for none.
    """

    face: Face
    motion: FloatArray
    relief: Relief
    steps: SlipSteps | None
    half_width: float

    def at_rest(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Heights f of the undeformed face [µm], NaN in the trench."""
        return np.where(np.abs(x) <= self.half_width, self.relief(x, y), np.nan)

    def moved(self, image: int) -> Scene:
        """Heights g of an image [µm]: g(x + u, y + v) = f(x, y) + w(x, y)."""
        steps = self.steps

        def surface(x: FloatArray, y: FloatArray) -> FloatArray:
            return self.at_rest(x, y) + (0.0 if steps is None else steps(image, x, y))

        return carried(surface, NodalMotion(self.face, self.motion[image]))


def carried(relief: Scene, motion: Motion) -> Scene:
    """Return a relief carried along by a motion: g with g(x + u, y + v) = f(x, y) + w(x, y)."""

    def heights(x_now: FloatArray, y_now: FloatArray) -> FloatArray:
        x, y, w = material_points(motion, x_now, y_now)
        return np.asarray(relief(x, y) + w)

    return heights


@dataclass(frozen=True)
class Stage:
    """How well the stage comes back between two images.

    Attributes:
        recentring: largest error along X and along Y [µm].
        refocusing: largest error along Z [µm].
    """

    recentring: float
    refocusing: float

    def errors(self, rng: np.random.Generator, number: int) -> FloatArray:
        """Where the stage is at each image [µm], shape (number, 3)."""
        largest = np.array([self.recentring, self.recentring, self.refocusing])
        return np.asarray(largest * rng.uniform(-1, 1, (number, 3)))


def frames(
    camera: Camera, subject: Subject, stage: FloatArray, rng: np.random.Generator
) -> Iterator[Image]:
    """Yield the images of the test.

    Args:
        camera: the instrument.
        subject: the face, T images.
        stage: where the stage is at each image [µm], shape (T, 3).
        rng: source of the noise.
    """
    for image, shift in enumerate(stage):
        yield camera.photograph(rng, subject.moved(image), shift)


def repeats(camera: Camera, subject: Subject, number: int, rng: np.random.Generator) -> list[Image]:
    """Images of the unloaded face between which nothing moves: noise alone parts them."""
    return [camera.photograph(rng, subject.at_rest, np.zeros(3)) for _ in range(number)]


def flats(camera: Camera, stage: FloatArray, rng: np.random.Generator) -> list[Image]:
    """Images of a flat surface, one for each height of the stage (n, 3) [µm]."""
    return [camera.photograph(rng, None, shift) for shift in stage]
