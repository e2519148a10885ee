"""Images and loads as one whitened residual vector.

Image part: with ρ = f + w − g(x + u) of a predicted motion, b_j = Σ_pixels (∇f·ψ_j) ρ tests the
residual with the functions of the correlation mesh. Its noise covariance is σ² M, M_jk =
Σ (∇f·ψ_j)(∇f·ψ_k), times (δ_tt' + S_tt') between frames, for all share the reference and the error
of the flat pattern (`reference_noise`). The stage re-centres between images: what a rigid motion
explains is projected out.
Load part: (F_measured − F_predicted)/γ_F, whitened for AR(1) noise over the frames in use.
Both together are whitened for noise of the boundary motion, which moves images and loads alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from driver.forward.prediction import Prediction
from driver.identification.boundary_jitter import BoundaryJitter
from driver.identification.discretisation_covariance import DiscretisationError
from driver.identification.image_data import ImageData
from driver.identification.load_noise import whiten_markov
from driver.identification.step_error import StepError
from meshes.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Data:
    """All measurements of a case, or of some of its frames.

    Attributes:
        image: the image part.
        load: measured loads [µN] of all frames, shape (T_all,).
        load_noise: γ_F [µN].
        autocorrelation: of the load noise from one image to the next.
        index: the frames in use, shape (T,).
        with_loads: whether the loads are part of the residual.
        simulation_error: covariance of what the mesh leaves wrong, None if neglected.
        step_error: what time steps of first order leave wrong, one standard deviation of a pattern
            over images and loads together; None where there is none.
        left_out: frames whose images are not fitted, outliers of the series; their loads are.
        jitter: noise of the boundary motion, None if there is none.
        stated_bad_loads: frames whose loads the case states to be wrong; their images are fitted.
        bad_loads: others that were found to be wrong, and may be taken back.
        load_degrees: degrees of freedom from which γ_F was estimated, infinite if it is known.
    """

    image: ImageData
    load: FloatArray
    load_noise: float
    autocorrelation: float
    index: IntArray
    with_loads: bool = True
    simulation_error: DiscretisationError | None = None
    step_error: StepError | None = None
    left_out: tuple[int, ...] = ()
    jitter: BoundaryJitter | None = None
    stated_bad_loads: tuple[int, ...] = ()
    bad_loads: tuple[int, ...] = ()
    load_degrees: float = np.inf

    @property
    def n_load(self) -> int:
        """Numbers in the load part."""
        return self.load_index.size if self.with_loads else 0

    @property
    def load_index(self) -> IntArray:
        """The frames in use whose loads are fitted, shape (n_load,) where loads are."""
        return self.index[~np.isin(self.index, (*self.stated_bad_loads, *self.bad_loads))]

    @property
    def with_image(self) -> BoolArray:
        """Which of the frames in use have an image that is fitted, shape (T,)."""
        return ~np.isin(self.index, self.left_out)

    def images_alone(self) -> Data:
        """Return the same frames without their loads."""
        return replace(self, with_loads=False)

    def frames(self, index: IntArray) -> Data:
        """Return some of the frames."""
        return replace(self, index=index)

    def residual(
        self, motion: FloatArray, load: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Whitened residual of a prediction for all frames.

        Args:
            motion: at the pixels [µm], shape (T_all, n_pix, 3).
            load: predicted reading [µN], shape (T_all,).

        Returns:
            residual [loads | images] (n,); the rigid motion of each frame (T, n_rigid) [µm];
            ρ (T, n_pix) [µm].
        """
        z, shift, rho = self.image.residual(motion[self.index], self.index)
        parts = [self._whiten_images(z[self.with_image]).ravel()]
        if self.with_loads:
            parts.insert(0, self._whiten_loads((self.load - load)[self.load_index]))
        return self._whiten_patterns(np.concatenate(parts)), shift, rho

    def sensitivity(self, prediction: Prediction) -> FloatArray:
        """Whitened derivatives of a prediction with respect to k parameters, shape (k, n)."""
        z = self._whiten_images(self.image_sensitivity(prediction))
        parts = [z.reshape(len(z), z.shape[1] * self.image.n_z)]
        if self.with_loads:
            parts.insert(0, self._whiten_loads(prediction.d_load[:, self.load_index]))
        return self._whiten_patterns(np.concatenate(parts, axis=1))

    def image_sensitivity(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the fitted images, each whitened by itself, (k, T, n_z)."""
        seen = self.index[self.with_image]
        z = self.image.sensitivity(prediction.d_surface[:, seen], prediction.projection.value, seen)
        for row, motion in prediction.carried.items():
            z[row] += self.image.pixel_sensitivity(motion[seen], seen)
        return z

    def load_changes(self, changes: FloatArray) -> FloatArray:
        """Whitened effect of changes of the loads in use [µN], (m, n_load) → (m, n)."""
        images = np.count_nonzero(self.with_image) * self.image.n_z
        parts = [self._whiten_loads(changes), np.zeros((len(changes), images))]
        return self._whiten_patterns(np.concatenate(parts, axis=1))

    def change(self, motion: FloatArray, load: FloatArray) -> FloatArray:
        """Whitened effect of a change of the measurements, to first order, shape (n,).

        Args:
            motion: change of the motion at the pixels [µm], shape (T_all, n_pix, 3).
            load: change of the loads [µN], shape (T_all,).
        """
        seen = self.index[self.with_image]
        z = self.image.pixel_sensitivity(motion[seen], seen)
        parts = [self._whiten_images(z).ravel()]
        if self.with_loads:
            parts.insert(0, self._whiten_loads(load[self.load_index]))
        return self._whiten_patterns(np.concatenate(parts))

    def shape_changes(self, shapes: FloatArray, course: FloatArray) -> FloatArray:
        """Whitened effect of motions that keep their shapes, to first order, shape (k, n).

        Args:
            shapes: motions at the pixels [µm], shape (k, n_pix, 3).
            course: how large they are in each frame, shape (T_all,).
        """
        over_time = course[self.index[self.with_image], None]
        z = over_time * self.image.pixel_sensitivity(shapes)[:, None, :]
        parts = [self._whiten_images(z).reshape(len(shapes), -1)]
        if self.with_loads:
            parts.insert(0, np.zeros((len(shapes), self.n_load)))
        return self._whiten_patterns(np.concatenate(parts, axis=1))

    def image_part(self, residual: FloatArray) -> FloatArray:
        """Return the image part of a residual, of the images that are fitted, shape (T, n_z)."""
        return residual[self.n_load :].reshape(-1, self.image.n_z)

    def effect_of_stops(self, jitter: BoundaryJitter) -> FloatArray:
        """σ_e Gᵀ of the stop of each image, whitened as all but the boundary, shape (T_all, n)."""
        seen = jitter.image[:, self.index[self.with_image]] / self.image.noise_factor
        parts = [self._whiten_images(seen).reshape(len(seen), -1)]
        if self.with_loads:
            parts.insert(0, self._whiten_loads(jitter.load[:, self.load_index]))
        return np.concatenate(parts, axis=1)

    def _whiten_patterns(self, white: FloatArray) -> FloatArray:
        """(I + σ_e² G Gᵀ + s sᵀ)^(−1/2) on (..., n), boundary and steps whitened as the rest."""
        if self.jitter is None and self.step_error is None:
            return white
        return np.asarray(white - (white @ self._pattern_root.T) @ self._pattern_root)

    @cached_property
    def _pattern_root(self) -> FloatArray:
        """R with (I + FᵀF)^(−1/2) = I − RᵀR, shape (m, n).

        The rows of F are σ_e Gᵀ, one for each stop, and the error of the steps, whitened as the
        rest.
        """
        rows = [] if self.jitter is None else [self.effect_of_stops(self.jitter)]
        if self.step_error is not None:
            alone = replace(self, jitter=None, step_error=None)
            rows.append(alone.change(self.step_error.motion, self.step_error.load)[None])
        factor = np.concatenate(rows)
        # With F Fᵀ = V diag(λ) Vᵀ: RᵀR = FᵀV diag((1 − (1 + λ)^(−1/2))/λ) VᵀF.
        strength, modes = np.linalg.eigh(factor @ factor.T)
        seen_at_all = strength > 1e-12 * strength[-1]
        strength, modes = strength[seen_at_all], modes[:, seen_at_all]
        gain = -np.expm1(-0.5 * np.log1p(strength)) / strength
        return np.asarray((np.sqrt(gain) * modes).T @ factor)

    def noise_part(self, rows: FloatArray) -> FloatArray:
        """Return what measurement noise alone makes of estimates from whitened numbers.

        Whitened numbers have unit covariance, R (I + Σ) R with Σ that of the simulation's error
        and of the noise of the boundary, and R = (I + Σ)^(−1/2): an estimate e = row · r owes
        |row R|² of its variance |row|² to the noise of images and loads.

        Args:
            rows: weights of the whitened numbers, shape (k, n).

        Returns:
            row R, shape (k, n).
        """
        rows = self._whiten_patterns(rows)
        if self.simulation_error is None:
            return rows
        loads, images = rows[:, : self.n_load], rows[:, self.n_load :]
        z = self._whiten_simulation(images.reshape(len(rows), -1, self.image.n_z))
        if self.with_loads:
            loads = self._whiten_load_simulation(loads)
        return np.concatenate([loads, z.reshape(images.shape)], axis=1)

    def _whiten_images(self, z: FloatArray) -> FloatArray:
        return self._whiten_simulation(self._whiten_reference(z))

    def _whiten_simulation(self, white: FloatArray) -> FloatArray:
        if self.simulation_error is None:
            return white
        seen = self.index[self.with_image]
        shapes = self._whiten_reference(self.simulation_error.shapes[seen])
        return self.simulation_error.whiten_images(white, shapes)

    def _whiten_reference(self, z: FloatArray) -> FloatArray:
        """(I + S)^(−1/2) over the frames, axis −2, S what they share."""
        return np.asarray(self._shared_root @ z)

    @cached_property
    def _shared_root(self) -> FloatArray:
        seen = self.index[self.with_image]
        strength, modes = np.linalg.eigh(self.image.shared[np.ix_(seen, seen)])
        return np.asarray((modes / np.sqrt(1.0 + strength)) @ modes.T)

    def _whiten_loads(self, load: FloatArray) -> FloatArray:
        return self._whiten_load_simulation(self._whiten_series(load))

    def _whiten_load_simulation(self, white: FloatArray) -> FloatArray:
        if self.simulation_error is None:
            return white
        pattern = self._whiten_series(self.simulation_error.load[self.load_index])
        return self.simulation_error.whiten_loads(white, pattern)

    def _whiten_series(self, load: FloatArray) -> FloatArray:
        return whiten_markov(load / self.load_noise, self.load_index, self.autocorrelation)
