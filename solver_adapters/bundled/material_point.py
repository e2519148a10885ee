"""One point of a crystal: the bundled law under uniaxial stress, or along a path of strain.

Uniaxial stress along Y. Steps towards an instant, H the displacement gradient:
1. the component YY of H is the one that is asked for;
2. XY, ZY and XZ stay 0: the line along Y keeps its direction, and nothing spins about it;
3. the five others follow by Newton's method from P_XX = P_ZZ = P_YX = P_YZ = P_ZX = 0;
4. where the iteration fails, the step is taken in halves.
P Fᵀ is symmetric, so that with these five all of the nominal stress P vanishes but P_YY.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from numbers import Integral

import numpy as np

from meshes.arrays import FloatArray, IntArray
from solver_adapters.bundled.fem.initial import initial_state
from solver_adapters.bundled.law.gauss_points import Points, points_of_grains
from solver_adapters.bundled.law.law import StateLayout
from solver_adapters.checks.arrays import expect_finite, expect_increasing, expect_shape
from solver_adapters.checks.simulation import (
    refuse_bad_integration,
    refuse_bad_material,
    refuse_bad_rotation,
)
from solver_adapters.interface import BadSimulationError, Integration, SolverError
from solver_adapters.material import Material

_FREE = np.ravel_multi_index(([0, 2, 1, 1, 2], [0, 2, 0, 2, 0]), (3, 3))  # XX, ZZ, YX, YZ, ZX
_NONE = _FREE[:0]
_ITERATIONS = 25
_HALVINGS = 12
# Stress that a free component may keep, over the largest stress and the slip resistance.
_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class MaterialPointCurve:
    """What a point of a crystal has gone through, n instants; axes are X, Y, Z of the specimen.

    Attributes:
        time: the instants [s], shape (n,).
        gradient: displacement gradient ∂u_i/∂X_j [-], shape (n, 3, 3).
        stress: Cauchy stress, in small strain the stress [MPa], shape (n, 3, 3).
        nominal_stress: force over undeformed area, first Piola–Kirchhoff stress [MPa], force along
            the first axis and normal along the second, shape (n, 3, 3); `stress` in small strain.
        slip: signed slip of each system since the start [-], shape (n, n_systems), of BCC twelve
            {110}⟨111⟩, then twelve {112}⟨111⟩; n_systems is 24, or 48 where the crystal has more,
            and null ones that never slip follow the last.
        accumulated_slip: the same without signs [-], shape (n, n_systems).
        back_stress: of each system [MPa], shape (n, n_systems).
    """

    time: FloatArray
    gradient: FloatArray
    stress: FloatArray
    nominal_stress: FloatArray
    slip: FloatArray
    accumulated_slip: FloatArray
    back_stress: FloatArray

    @property
    def strain_along_Y(self) -> FloatArray:
        """Elongation along Y over the undeformed length [-], shape (n,)."""
        return self.gradient[:, 1, 1]

    @property
    def stress_along_Y(self) -> FloatArray:
        """Component YY of the stress [MPa], shape (n,)."""
        return self.stress[:, 1, 1]


def uniaxial_stress(
    material: Material,
    rotation: FloatArray,
    strain: FloatArray,
    time: FloatArray,
    *,
    grain: int = 1,
    integration: Integration = "exponential",
    steps_per_interval: int = 4,
) -> MaterialPointCurve:
    """Stress and strain of a single crystal that is pulled along Y and free across it.

    Args:
        material: the law; what varies inside a specimen (skin, modes of τ₀, eigenstrain) is left
            out.
        rotation: crystal → specimen rotation, shape (3, 3): `loaded_along`, `bunge_matrix`, or one
            of `orientations_of`.
        strain: elongation along Y over the undeformed length at each instant [-], the first 0,
            shape (n,).
        time: the instants [s], increasing, shape (n,).
        grain: number of the grain whose τ₀ is meant, from 1.
        integration: scheme of the time integration, "exponential" or "backward_euler".
        steps_per_interval: equal time steps between two instants.

    Raises:
        BadSimulationError: an array has another shape, does not increase or does not start at 0.
        UnsupportedError: a constant of the law is not admissible.
        SolverError: the law has no solution at an instant.

    Examples:
        >>> import numpy as np
        >>> import prismid
        >>> strain = np.linspace(0.0, 2e-4, 3)
        >>> curve = prismid.uniaxial_stress(
        ...     prismid.Material(), prismid.loaded_along((1, 0, 0)), strain, 10.0 * strain / 2e-4
        ... )
        >>> (curve.stress_along_Y / 1e3).round(4).tolist()  # GPa
        [0.0, 0.0134, 0.0268]
    """
    _refuse_bad_course("strain", strain, (), time, steps_per_interval)
    gradient = np.zeros((len(time), 3, 3))
    gradient[:, 1, 1] = strain
    point = _point_of(material, rotation, grain, integration)
    return _driven(point, material, gradient, time, _FREE, steps_per_interval)


def strain_path(
    material: Material,
    rotation: FloatArray,
    gradient: FloatArray,
    time: FloatArray,
    *,
    grain: int = 1,
    integration: Integration = "exponential",
    steps_per_interval: int = 4,
) -> MaterialPointCurve:
    """Stress of a single crystal whose displacement gradient is prescribed.

    Args:
        material: as in `uniaxial_stress`.
        rotation: as in `uniaxial_stress`.
        gradient: displacement gradient ∂u_i/∂X_j at each instant [-], the first 0, linear in time
            between them, shape (n, 3, 3); in small strain its symmetric part counts.
        time: as in `uniaxial_stress`.
        grain: as in `uniaxial_stress`.
        integration: as in `uniaxial_stress`.
        steps_per_interval: as in `uniaxial_stress`.

    Raises:
        BadSimulationError: as in `uniaxial_stress`.
        UnsupportedError: as in `uniaxial_stress`.
        SolverError: as in `uniaxial_stress`.

    Examples:
        >>> import numpy as np
        >>> import prismid
        >>> swollen = 1e-4 * np.linspace(0.0, 1.0, 2)[:, None, None] * np.eye(3)
        >>> law = prismid.Material(strain_measure="small")
        >>> curve = prismid.strain_path(law, np.eye(3), swollen, np.array([0.0, 1.0]))
        >>> np.diag(curve.stress[-1]).round(2).tolist()  # C11 + 2 C12 times 1e-4, MPa
        [50.45, 50.45, 50.45]
    """
    _refuse_bad_course("gradient", gradient, (3, 3), time, steps_per_interval)
    point = _point_of(material, rotation, grain, integration)
    return _driven(point, material, gradient, time, _NONE, steps_per_interval)


def loaded_along(direction: tuple[float, float, float]) -> FloatArray:
    """Return a crystal → specimen rotation that lays a direction of the crystal along Y.

    Args:
        direction: Miller indices [uvw] of a cubic crystal, of any length but 0.

    Returns:
        rotation, shape (3, 3); how far the crystal is turned about Y does not matter to
        `uniaxial_stress`.

    Raises:
        BadSimulationError: the direction has no length.

    Examples:
        >>> import numpy as np
        >>> import prismid
        >>> (prismid.loaded_along((1, 1, 0)) @ np.array([1.0, 1.0, 0.0])).round(6).tolist()
        [0.0, 1.414214, 0.0]
    """
    axis = np.array(direction, dtype=np.float64)
    expect_shape("direction", axis, (3,))
    expect_finite("direction", axis)
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        raise BadSimulationError("direction is (0, 0, 0); expected Miller indices of a direction")
    axis /= length
    across = np.cross(axis, np.eye(3)[np.argmin(abs(axis))])
    across /= np.linalg.norm(across)
    return np.stack([across, axis, np.cross(across, axis)])


def _point_of(
    material: Material, rotation: FloatArray, grain: int, integration: Integration
) -> Points:
    """Return the law of a point of a grain.

    Raises:
        BadSimulationError: rotation or grain are none.
        UnsupportedError: the law or the scheme cannot be integrated.
    """
    refuse_bad_material(material)
    refuse_bad_integration(integration, material.n)
    expect_shape("rotation", rotation, (3, 3))
    expect_finite("rotation", rotation)
    refuse_bad_rotation("rotation", rotation)
    known = 2 + len(material.tau0_grains)
    if not isinstance(grain, Integral) or not 1 <= grain <= known:
        raise BadSimulationError(
            f"grain is {grain!r}; expected a whole number from 1 to {known}, those of which the "
            "law has a ratio of tau0"
        )
    rotations = np.broadcast_to(rotation, (int(grain), 3, 3)).copy()
    return points_of_grains(material, integration, np.array([grain - 1]), rotations)


def _refuse_bad_course(
    name: str, values: FloatArray, shape: tuple[int, ...], time: FloatArray, steps: int
) -> None:
    """Raise where a point cannot follow what is prescribed.

    Args:
        name: of what is prescribed.
        values: what is prescribed, shape (n, *shape).
        shape: of it at an instant.
        time: the instants [s], shape (n,).
        steps: time steps between two of them.

    Raises:
        BadSimulationError: so it is.
    """
    expect_shape("time", time, (None,))
    if len(time) < 2:
        raise BadSimulationError(f"time has shape {time.shape}; expected two instants or more")
    expect_finite("time", time)
    expect_increasing("time", time)
    expect_shape(name, values, (len(time), *shape))
    expect_finite(name, values)
    if np.any(values[:1]):
        raise BadSimulationError(
            f"{name} is not 0 at the first instant; expected 0, from where the point starts"
        )
    if not isinstance(steps, Integral) or steps < 1:
        raise BadSimulationError(
            f"steps_per_interval is {steps!r}; expected a whole number, 1 or more"
        )


def _driven(
    point: Points,
    material: Material,
    gradient: FloatArray,
    time: FloatArray,
    free: IntArray,
    steps: int,
) -> MaterialPointCurve:
    """Drive a point from instant to instant.

    Args:
        point: its law.
        material: the same law.
        gradient: what is prescribed, shape (n, 3, 3).
        time: the instants [s], shape (n,).
        free: indices of the components that follow from no stress, of the nine row by row.
        steps: equal time steps between two instants.

    Raises:
        SolverError: the law has no solution.
    """
    driver = _Driver(point, free, _TOLERANCE * material.tau0)
    now = driver.at_rest(material)
    found = [now]
    for begin, end in pairwise(range(len(time))):
        span, change = (time[end] - time[begin]) / steps, gradient[end] - gradient[begin]
        for left in reversed(range(steps)):
            target = (gradient[end] - change * (left / steps)).reshape(9)
            try:
                now = driver.advanced(now, target, span)
            except _NoSolutionError:
                raise SolverError(
                    f"no solution between t = {time[begin]:g} s and {time[end]:g} s; expected a "
                    "smaller strain, or more instants"
                ) from None
        found.append(now)
    return _curve(time, found, material, point.layout)


def _curve(
    time: FloatArray, found: list[_State], material: Material, rows: StateLayout
) -> MaterialPointCurve:
    gradient, nominal, slip, state = (
        np.stack([getattr(one, name) for one in found])
        for name in ("gradient", "nominal", "slip", "state")
    )
    gradient, stress = gradient.reshape(-1, 3, 3), nominal.reshape(-1, 3, 3)
    nominal = stress
    if material.strain_measure == "finite":
        F = np.eye(3) + gradient
        stress = nominal @ np.swapaxes(F, 1, 2) / np.linalg.det(F)[:, None, None]
    back = material.c * state[:, rows.x : rows.over] + material.c2 * state[:, rows.x2 :]
    accumulated = state[:, rows.accumulated : rows.x2]
    return MaterialPointCurve(time, gradient, stress, nominal, slip, accumulated, back)


@dataclass(frozen=True, eq=False)
class _State:
    """The point at an instant: nine components row by row, state of the law, slips so far."""

    gradient: FloatArray
    nominal: FloatArray
    state: FloatArray
    slip: FloatArray
    last: FloatArray  # slips of the last step, from where the next one begins


class _NoSolutionError(Exception):
    """A step that no iteration has solved."""


@dataclass(frozen=True, eq=False)
class _Driver:
    """A point whose displacement gradient is prescribed but for some components.

    Attributes:
        law: of the point.
        free: indices of the components whose stress is null.
        tolerance: of that stress, beside its share of the largest stress [MPa].
    """

    law: Points
    free: IntArray
    tolerance: float

    @property
    def rotation(self) -> FloatArray:
        """Crystal → specimen, shape (3, 3)."""
        last: FloatArray = self.law.rotation[-1]
        return last

    def at_rest(self, material: Material) -> _State:
        """Return the point before loading."""
        depth = np.zeros(1)
        rotation = self.rotation[None]
        state = initial_state(
            material.strain_measure, material.slip_systems, material.x0, 0.0, rotation, depth
        )
        slip = np.zeros(self.law.n_systems)
        return _State(np.zeros(9), np.zeros(9), state[0], slip, slip)

    def advanced(self, start: _State, target: FloatArray, span: float, depth: int = 0) -> _State:
        """Return the point after a step, or after its halves where that has no solution.

        Args:
            start: of the step.
            target: gradient at its end; of free components not looked at, shape (9,).
            span: length of the step [s].
            depth: how often it was halved.

        Raises:
            _NoSolutionError: it has none, however often it is halved.
        """
        try:
            return self._solved(start, target, span)
        except _NoSolutionError:
            if depth == _HALVINGS:
                raise
        between = 0.5 * (start.gradient + target)
        middle = self.advanced(start, between, span / 2, depth + 1)
        return self.advanced(middle, target, span / 2, depth + 1)

    def _solved(self, start: _State, target: FloatArray, span: float) -> _State:
        H = target.copy()
        H[self.free] = start.gradient[self.free]
        slips = start.last
        for _ in range(_ITERATIONS):
            stress, tangent, state, slips = self._answer(start, H, slips, span)
            left, largest = stress[self.free], float(abs(stress).max())
            if not np.isfinite(largest):
                break
            if not left.size or abs(left).max() <= self.tolerance + _TOLERANCE * largest:
                return _State(H, stress, state, start.slip + slips, slips)
            try:
                H[self.free] -= np.linalg.solve(tangent[np.ix_(self.free, self.free)], left)
            except np.linalg.LinAlgError:
                break
        raise _NoSolutionError

    def _answer(
        self, start: _State, H: FloatArray, slips: FloatArray, span: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Nominal stress (9,), its tangent (9, 9), state and slips of a step in specimen axes."""
        R = self.rotation
        mixed, before = ((h.reshape(3, 3) @ R).reshape(1, 9) for h in (H, start.gradient))
        found = self.law.update(mixed, start.state[None], slips[None], span, before)
        if found.iterations[0] < 0:
            raise _NoSolutionError
        stress = (found.P.reshape(3, 3) @ R.T).reshape(9)
        tangent = np.einsum("iakb,ja,lb->ijkl", found.C.reshape(3, 3, 3, 3), R, R)
        return stress, tangent.reshape(9, 9), found.state[0], found.slips[0]
