"""The images of an experiment that has not been made: the surface, its noise, no frame.

The user's own repeats are taken where there are any, else a face of the virtual microscope.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from driver.case.model import Case
from driver.common.splines.images import SplineImages
from driver.design.settings import Settings
from driver.dic.slope_noise import squared_slopes
from driver.dic.surface_images import SurfaceImages, over_region
from driver.experiment.history import History
from driver.experiment.images.flatfield import flat_pattern
from driver.experiment.images.noise import Noise
from driver.experiment.images.reference import Reference
from driver.experiment.images.region import region_codes
from driver.experiment.reading import Experiment, read_unloaded
from driver.forward.build import reference_of, used_face
from driver.virtual.writing import random_relief

_SEED = 0  # of the virtual face


@dataclass(frozen=True, eq=False)
class Surface:
    """What the images will show.

    Attributes:
        images: without frames, the gradient that of the pattern alone.
        experiment: without frames and loads.
        told: where it comes from, to be told.
        case: the case that it was made for.
    """

    images: SurfaceImages
    experiment: Experiment
    told: str
    case: Case

    def with_noise(self, ratio: float, n_reference: int | None) -> SurfaceImages:
        """Return the images with their noise times a ratio and, if given, other repeats."""
        n = self.images.n_reference if n_reference is None else n_reference
        return replace(self.images, sigma=ratio * self.images.sigma, n_reference=n)


def expected_surface(case: Case, settings: Settings, history: History) -> Surface:
    """Return the surface of a specimen.

    Raises:
        InputError: repeats, flats or mask are there and cannot be used.
    """
    unloaded = read_unloaded(case, history)
    return _virtual(case, settings, history) if unloaded is None else _own(case, unloaded)


def _own(case: Case, unloaded: Experiment) -> Surface:
    flat = None if unloaded.flats is None else flat_pattern(unloaded.flats)
    reference = reference_of(case, unloaded, flat)
    images = over_region(
        reference, _no_frames(unloaded, reference), reference.heights, flat, used_face(case)
    )
    # A test has many images to average; what the few repeats leave of noise is no pattern.
    square, noise = squared_slopes(images)
    share = np.clip(noise / square, 0.0, 1.0)
    described = (
        f"{reference.n} repeats of the case: noise {1e3 * images.sigma:.2f} nm; "
        f"{noise / square.mean():.0%} of the squared slopes are noise and taken out"
    )
    images = replace(images, gradient=images.gradient * np.sqrt(1.0 - share))
    return Surface(images, unloaded, described, case)


def _virtual(case: Case, settings: Settings, history: History) -> Surface:
    pixel, (rim_x, rim_y) = case.images.pixel_um, settings.microscope.rim_px
    rows = round(case.specimen.width / pixel) + 1 + 2 * rim_x
    columns = round(case.specimen.length / pixel) + 1 + 2 * rim_y
    origin = ((rows - 1) / 2, float(rim_y))
    x, y = np.meshgrid(
        (np.arange(rows) - origin[0]) * pixel, (np.arange(columns) - origin[1]) * pixel,
        indexing="ij",
    )  # fmt: skip
    heights = random_relief(case, settings.face, np.random.default_rng(_SEED))(x, y)
    codes = region_codes(np.ones(heights.shape, dtype=bool), pixel, origin, used_face(case))
    noise = settings.microscope.noise_nm
    experiment = Experiment(
        frames=np.zeros((0, *heights.shape)), flats=None, repeats=None, pixel_um=pixel,
        origin=origin, mask=None, history=history, force=np.zeros(history.n_images),
        gamma_f=case.images.gamma_f if noise is None else noise * 1e-3,
        gamma_F=case.loads.gamma_F,
    )  # fmt: skip
    reference = Reference(
        heights=heights,
        codes=codes,
        noise=Noise(experiment.gamma_f, 0),
        n=settings.microscope.repeats,
        shifts=np.zeros((settings.microscope.repeats, 3)),
        registered=False,
    )
    images = over_region(
        reference, _no_frames(experiment, reference), heights, None, used_face(case)
    )
    face = settings.face
    described = (
        f"no repeats yet: a virtual face with dots of {face.dot_height_nm:g} nm, "
        f"{face.dots_per_um2:g} a µm², polish of {face.roughness_nm:g} nm; "
        f"noise {1e3 * images.sigma:.2f} nm, {images.n_reference} repeats"
    )
    return Surface(images, experiment, described, case)


def _no_frames(experiment: Experiment, reference: Reference) -> SplineImages:
    none = np.zeros((0, *reference.heights.shape))
    return SplineImages(none, experiment.pixel_um, experiment.origin)
