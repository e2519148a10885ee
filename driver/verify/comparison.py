"""Two readings of one result, number by number."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from driver.verify.numbers import NUMBER, Values

TOLERANCE = 1e-6
"""How far another machine may be off, of the largest number of an array (docs/reliability.md)."""

_FLOATS = "f"


@dataclass(frozen=True)
class Difference:
    """An array that is not the same in both readings.

    Attributes:
        name: of the array.
        stored: what was found in the stored result, at the place of the largest difference.
        computed: what was computed there.
        size: the difference, of the largest number of the array; infinite for counts and texts.
        within: whether it is one that another machine may make.
    """

    name: str
    stored: str
    computed: str
    size: float
    within: bool


@dataclass(frozen=True)
class Comparison:
    """What two readings of a file have in common.

    Attributes:
        count: numbers and texts that were compared.
        same: those that are the same to the last digit.
        differences: arrays that are not, the one with the largest difference first.
    """

    count: int
    same: int
    differences: tuple[Difference, ...]

    @property
    def largest(self) -> float:
        """The largest difference, of the largest number of its array."""
        return max((difference.size for difference in self.differences), default=0.0)

    def agrees(self, to_the_last_digit: bool) -> bool:
        """Whether both readings agree: to the last digit, or as far as two machines do."""
        return all(not to_the_last_digit and each.within for each in self.differences)


def compared(stored: Values, computed: Values, rounding: float = 0.0) -> Comparison:
    """Compare two readings of a result.

    Args:
        stored: arrays of the stored result by name.
        computed: those of the one that was computed anew.
        rounding: what numbers are rounded to when they are written, of their size.
    """
    count = same = 0
    differences: list[Difference] = []
    for name in dict.fromkeys((*stored, *computed)):
        count += max(reading[name].size for reading in (stored, computed) if name in reading)
        unlike = list(_unlike(name, stored, computed))
        if unlike:
            differences += unlike
            continue
        equal = _equal(stored[name], computed[name])
        same += int(equal.sum())
        if not equal.all():
            differences.append(_largest(name, stored[name], computed[name], equal, rounding))
    differences.sort(key=lambda difference: -difference.size)
    return Comparison(count, same, tuple(differences))


def _unlike(name: str, stored: Values, computed: Values) -> Iterator[Difference]:
    """Yield the difference of what cannot be compared place by place."""
    kinds = [_kind(reading, name) for reading in (stored, computed)]
    if kinds[0] != kinds[1]:
        yield Difference(name, kinds[0], kinds[1], float("inf"), False)


def _kind(reading: Mapping[str, NDArray[np.generic]], name: str) -> str:
    if name not in reading:
        return "nothing"
    array = reading[name]
    kind = "numbers" if array.dtype.kind in "iufb" else "texts"
    if array.ndim == 0:
        return kind.removesuffix("s")
    return f"{' x '.join(map(str, array.shape))} {kind}"


def _equal(stored: NDArray[np.generic], computed: NDArray[np.generic]) -> NDArray[np.bool_]:
    numbers = stored.dtype.kind in _FLOATS and computed.dtype.kind in _FLOATS
    return np.atleast_1d(np.equal(stored, computed) | (_nan(stored, numbers, computed)))


def _nan(stored: Any, numbers: bool, computed: Any) -> Any:
    return np.isnan(stored) & np.isnan(computed) if numbers else False


def _largest(
    name: str,
    stored: NDArray[np.generic],
    computed: NDArray[np.generic],
    equal: NDArray[np.bool_],
    rounding: float,
) -> Difference:
    """Return the largest difference of two arrays of one shape."""
    flat = equal.ravel()
    then, now = (np.atleast_1d(array).ravel() for array in (stored, computed))
    if _FLOATS not in (stored.dtype.kind, computed.dtype.kind):
        # Counts and marks agree or they do not; numbers in texts are rounded for reading.
        place, size = int(np.argmin(flat)), float("inf")
        within = bool(np.all(_words(then) == _words(now)))
    else:
        a, b = then.astype(np.float64), now.astype(np.float64)
        finite = np.isfinite(a) & np.isfinite(b)
        scale = float(np.max(np.abs(a[finite]), initial=0.0)) or 1.0
        apart = np.where(finite, np.abs(np.where(finite, a - b, 0.0)), np.inf) / scale
        apart[flat] = 0.0
        allowed = TOLERANCE + rounding * np.where(finite, np.abs(a), 0.0) / scale
        place, within = int(np.argmax(apart)), bool(np.all(apart <= allowed))
        size = float(apart[place])
    where = "" if stored.ndim == 0 else _place(place, stored.shape)
    return Difference(name + where, _shown(then[place]), _shown(now[place]), size, within)


def _words(texts: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return texts without their numbers, and numbers as they are."""
    if texts.dtype.kind not in "USO":
        return texts
    return np.array([NUMBER.sub("#", _text(text)) for text in texts.tolist()])


def _place(index: int, shape: tuple[int, ...]) -> str:
    places = ", ".join(str(int(i)) for i in np.unravel_index(index, shape))
    return f"[{places}]"


def _shown(value: Any) -> str:
    found = value.item() if isinstance(value, np.generic) else value
    text = repr(_text(found) if isinstance(found, bytes) else found)
    return text if len(text) <= 60 else text[:59] + "…"


def _text(text: Any) -> str:
    return text.decode(errors="replace") if isinstance(text, bytes) else str(text)
