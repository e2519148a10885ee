"""The images of an experiment that has not been made: the surface, its noise, no frame.

The user's own repeats are taken where there are any, else a face of the virtual microscope.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from driver.case import Case
from driver.design.settings import Settings
from driver.dic.interpolation import SplineImages, spline_images
from driver.dic.surface_images import SurfaceImages
from driver.experiment import Experiment, read_unloaded
from driver.history import History
from driver.images.flatfield import FlatField, flat_pattern
from driver.images.region import CodeArray, Excluded, region_codes
from driver.specimen import reference_of, used_face
from driver.virtual_record import random_relief

FloatArray = NDArray[np.float64]

# Variance of the slope of a cubic spline at a sample, through white samples of unit variance: the
# mean over all frequencies of (3 sin ω/(2 + cos ω))².
SLOPE_GAIN = 9.0 * (2.0 / np.sqrt(3.0) - 1.0)
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
        """The images with their noise times a ratio and, if given, other repeats."""
        n = self.images.n_reference if n_reference is None else n_reference
        return replace(self.images, sigma=ratio * self.images.sigma, n_reference=n)


def expected_surface(case: Case, settings: Settings, history: History) -> Surface:
    """The surface of a specimen.

    Raises:
        InputError: repeats, flats or mask are there and cannot be used.
    """
    unloaded = read_unloaded(case, history)
    return _virtual(case, settings, history) if unloaded is None else _own(case, unloaded)


def _own(case: Case, unloaded: Experiment) -> Surface:
    flat = None if unloaded.flats is None else flat_pattern(unloaded.flats)
    reference = reference_of(case, unloaded, flat)
    images = _images(
        unloaded, reference.heights, reference.codes, used_face(case), reference.noise.sigma,
        reference.n, reference.noise.dof, flat,
    )  # fmt: skip
    # A test has many images to average; what the few repeats leave of noise is no pattern.
    noise = SLOPE_GAIN * (images.sigma / images.pixel) ** 2 / images.n_reference
    square = np.mean(images.gradient**2, axis=0)
    share = np.clip(noise / square, 0.0, 1.0)
    told = (
        f"{reference.n} repeats of the case: noise {1e3 * images.sigma:.2f} nm; "
        f"{noise / square.mean():.0%} of the squared slopes are noise and taken out"
    )
    images = replace(images, gradient=images.gradient * np.sqrt(1.0 - share))
    return Surface(images, unloaded, told, case)


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
    images = _images(
        experiment, heights, codes, used_face(case), experiment.gamma_f,
        settings.microscope.repeats, 0, None,
    )  # fmt: skip
    face = settings.face
    told = (
        f"no repeats yet: a virtual face with dots of {face.dot_height_nm:g} nm, "
        f"{face.dots_per_um2:g} a µm², polish of {face.roughness_nm:g} nm; "
        f"noise {1e3 * images.sigma:.2f} nm, {images.n_reference} repeats"
    )
    return Surface(images, experiment, told, case)


def _images(
    experiment: Experiment,
    heights: FloatArray,
    codes: CodeArray,
    bounds: tuple[float, float, float, float],
    sigma: float,
    n_reference: int,
    noise_dof: int,
    flat: FlatField | None,
) -> SurfaceImages:
    pixel, origin = experiment.pixel_um, experiment.origin
    rows, cols = np.nonzero(codes == Excluded.USED)
    xy = np.column_stack([(rows - origin[0]) * pixel, (cols - origin[1]) * pixel])
    slopes = spline_images(heights[None], pixel, origin).gradient(0, xy[:, 0], xy[:, 1])
    return SurfaceImages(
        xy=xy, rows=rows, cols=cols, reference=heights[rows, cols], gradient=slopes,
        frames=SplineImages(np.zeros((0, *heights.shape)), pixel, origin), sigma=sigma,
        n_reference=n_reference, shape=(heights.shape[0], heights.shape[1]), pixel=pixel,
        bounds=bounds, reference_image=heights, noise_dof=noise_dof, codes=codes,
        sigma_flat=0.0 if flat is None else flat.sigma,
        flat_error=np.zeros(heights.shape) if flat is None else flat.error,
    )  # fmt: skip
