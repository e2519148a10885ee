"""How large an image shows the relief of the reference: the gain of its heights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from driver.dic.system import End, System
from meshes.arrays import BoolArray, FloatArray

_SURE = 5.0  # σ of a gain beyond which it is another one
_MATTERS = 0.01  # from 1; less bends no motion by what noise shows


@dataclass(frozen=True, eq=False)
class Gains:
    """Heights of each image over those of the reference, of relief that no motion makes.

    Attributes:
        value: shape (T,), NaN of an image that has not converged or is unlike the others.
        sigma: standard deviation by noise, infinite where the reference has no such relief.
        of_noise: what the noise of the reference would take from each gain, and was added.
    """

    value: FloatArray
    sigma: float
    of_noise: float

    def off(self, known: FloatArray) -> BoolArray:
        """Images whose gain is surely another one than is known, by what matters, shape (T,)."""
        change = np.where(np.isnan(self.value), 0.0, np.abs(self.value - known))
        return np.asarray(change > max(_SURE * self.sigma, _MATTERS) + self.of_noise)


@dataclass(frozen=True, eq=False)
class Relief:
    """The relief c of the reference about its mean, as one more unknown beside the motion.

    With J the sensitivity of the motion, A = JᵀJ + P and z = A⁻¹ Jᵀ c. c⊥ = c − J z is what no
    motion makes of it.

    Attributes:
        height: c [µm], shape (n_pix,).
        motion: z, shape (n,).
        pull: P z, shape (n,).
        sight: c·c⊥ [µm²].
    """

    height: FloatArray
    motion: FloatArray
    pull: FloatArray
    sight: float

    @staticmethod
    def of(system: System) -> Relief:
        """Return that of the reference of a weighed system."""
        at = system.pixels
        relief = at.height - at.height.mean()
        flat = np.zeros((int(at.rows.max()) + 2, int(at.cols.max()) + 2))
        right = system.at_heights(relief).compare(flat, np.zeros(system.size)).right
        z = system.solve(right)
        sight = float(relief @ relief - z @ right)
        return Relief(relief, z, system.penalty_force(z), sight)

    def along(self, end: End) -> float:
        """c⊥·ρ + (P z)·p, by which least squares change the gain [µm²].

        With b = Jᵀρ the former is c·ρ − z·b.
        """
        seen = np.isfinite(end.residual)
        whole = bool(seen.all())
        shown = self.height @ end.residual if whole else self.height[seen] @ end.residual[seen]
        return float(shown - self.motion @ end.right + self.pull @ end.p)

    def gains(
        self, system: System, along: FloatArray, known: FloatArray, sigma: float, n_reference: int
    ) -> Gains:
        """Estimate the gain a of each image from what it leaves along the relief.

        Least squares for p and a together, from ρ of the gain a₀, give
        a − a₀ = −(c⊥·ρ + zᵀP p)/(c·c⊥). The noise of the reference is in c as in ρ: σ²/n at each of
        n_pix − tr(A⁻¹M) degrees of freedom is taken from both products.

        Args:
            system: that of `of`.
            along: of each image, NaN of one whose gain is not asked for, shape (T,).
            known: a₀, shape (T,).
            sigma: noise of one image [µm].
            n_reference: images averaged into the reference.
        """
        of_noise = sigma**2 / n_reference * (self.height.size - system.freedom())
        sight = self.sight - of_noise
        if sight <= of_noise:  # relief that noise hides
            return Gains(known.copy(), np.inf, np.inf)
        value = known - (along - of_noise) / sight
        sure = sigma * float(np.sqrt((1.0 + 1.0 / n_reference) / sight))
        return Gains(value, sure, of_noise / sight)
