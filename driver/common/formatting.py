"""How numbers are written for a reader."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Sequence

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SMALLEST_P = 1e-99


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with significant digits, “–” where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if -4 < exponent < 6:
        text = f"{value:.{max(digits - 1 - exponent, 0)}f}"
    else:
        text = _scientific(value, digits)
    return text.replace("-", "−")


def compact(value: float) -> str:
    """Return a number of any size in a few characters: “430”, “−4·10⁵”."""
    if value == 0.0 or 0.01 <= abs(value) < 9995.0:
        return number(value, 2)
    return _scientific(value, 1).replace("-", "−")


def chi(value: float) -> str:
    """Return a χ: two decimals up to ten, then three digits."""
    return f"{value:.2f}" if value < 9.995 else number(value)


def signed(value: float, digits: int = 3) -> str:
    """Return a number with its sign."""
    return ("+" if value > 0 else "") + number(value, digits)


def with_sigma(value: float, sigma: float | None) -> str:
    """“value ± σ”: σ with two digits if it begins with 1 or 2, else with one; value to match."""
    if sigma is None or not math.isfinite(sigma) or sigma <= 0:
        return number(value, 4)
    places = _places(sigma)
    if abs(places) > 5:
        # Both with the power of ten of the larger one.
        power = math.floor(math.log10(max(abs(value), sigma)))
        shown = max(places + power, 0)
        text = f"({value / 10.0**power:.{shown}f} ± {sigma / 10.0**power:.{shown}f})"
        return f"{text}·{_power(power)}".replace("-", "−")
    digits = max(places, 0)
    text = f"{round(value, places):.{digits}f} ± {round(sigma, places):.{digits}f}"
    return text.replace("-", "−")


def interval(low: float, high: float, sigma: float) -> str:
    """“low to high”, with the digits that a standard deviation leaves."""
    if not math.isfinite(sigma) or sigma <= 0 or _places(sigma) > 5:
        return f"{number(low)} to {number(high)}"
    places = _places(sigma)
    # 0.0 is added for an end that rounds to −0.
    texts = (f"{round(end, places) + 0.0:.{max(places, 0)}f}" for end in (low, high))
    return " to ".join(texts).replace("-", "−")


def percent(share: float) -> str:
    """Return a share from 0 to 1; only what is whole is 100 %."""
    if share < 0.01:
        return "< 1 %"
    return f"{min(round(100 * share), 99) if share < 1 else 100} %"


def duration(seconds: float) -> str:
    """“0.4 s”, “72 s”, “4.5 min” or “2.1 h”."""
    if seconds < 100:
        return f"{seconds:.1f} s" if seconds < 10 else f"{seconds:.0f} s"
    return f"{seconds / 60:.1f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def age(seconds: float) -> str:
    """“40 s”, “4.5 min”, “2.1 h” or “3 days”."""
    return duration(seconds) if seconds < 172_800 else f"{seconds / 86_400:.0f} days"


def byte_size(size: float) -> str:
    """“812 B”, “1.25 kB”, “98.7 MB”, “12.0 GB” or “3.40 TB”, thousands of thousands."""
    units = ("B", "kB", "MB", "GB", "TB")
    power = 0
    while size >= 999.5 and power < len(units) - 1:
        size, power = size / 1000, power + 1
    decimals = 0 if not power or size >= 99.95 else 1 if size >= 9.995 else 2
    return f"{size:.{decimals}f} {units[power]}"


def probability(p: float) -> str:
    """Return a probability: “0.23”, “4·10⁻⁷” or “< 10⁻⁹⁹”."""
    if p < _SMALLEST_P:
        return f"< {_power(-99)}"
    if p >= 1e-3:
        return f"{p:.2g}"
    return _scientific(p, 1)


def with_unit(text: str, unit: str) -> str:
    """Return a number and its unit; degrees stand close."""
    return text + unit if unit == "°" and "±" not in text else f"{text} {unit}".rstrip()


def joined(words: Sequence[str]) -> str:
    """Return “a”, “a and b”, “a, b and c”."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def printable(text: str) -> str:
    """Return a text with its control characters as escapes such as x1b, but for breaks and tabs."""
    return "".join(
        sign if sign in "\n\t" or not _controls(sign) else ascii(sign)[1:-1] for sign in text
    )


def _controls(sign: str) -> bool:
    """Whether a character is none: a control, a direction of writing, half of a pair, a break."""
    return unicodedata.category(sign)[0] == "C" or sign in "\u2028\u2029"


def _places(sigma: float) -> int:
    """Decimal places: two digits of σ if it begins with 1 or 2, else one."""
    exponent = math.floor(math.log10(sigma))
    return (1 if sigma / 10.0**exponent < 2.95 else 0) - exponent


def _scientific(value: float, digits: int) -> str:
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}·{_power(int(exponent))}"


def _power(exponent: int) -> str:
    return "10" + str(exponent).translate(_SUPERSCRIPT)


def cost_told(seconds: float, memory: float) -> str:
    """Return what a job will cost, in words.

    Args:
        seconds: wall-clock time on cores that do nothing else [s].
        memory: largest resident memory of all its processes together [bytes].
    """
    return f"about {duration(seconds)} on free cores and {memory / 1e9:.1f} GB of memory"
