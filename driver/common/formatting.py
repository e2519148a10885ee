"""How parameters, causes and numbers are written for a reader."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence

from driver.common.progress import Log
from solver_adapters.interface import Progress

_DEGREE = 180.0 / math.pi

_LABELS = {
    "tau0": "τ₀",
    "tau0_112": "τ₀ of {112} / τ₀ of {110}",
    "tau0_grain2": "τ₀ of grain 2 / τ₀ of grain 1",
    "tau0_antitwinning": "τ₀ of {112}, antitwinning / twinning",
    "a1": "non-Schmid factor a₁",
    "h_latent": "latent hardening h",
    "Q_latent": "latent hardening Q",
    "c2": "c of the second back stress",
    "d2": "d of the second back stress",
    "x0": "initial back strain x₀",
    "eigenstrain": "eigenstrain, apex less face",
    "skin_tau0": "τ₀ of the skin / τ₀ inside",
    "skin_thickness": "thickness of the skin",
    "elastic_scale": "factor on C₁₁, C₁₂, C₄₄",
    "C44_scale": "factor on C₄₄",
    "apex_curvature": "apex amplitude growing with strain",
    "origin_X": "error of the image origin along X",
    "origin_Y": "error of the image origin along Y",
    "end_rotation": "in-plane turn of S⁺",
    "end_shear": "sideways motion of S⁺ / half elongation",
    "stretch_curvature": "bow of the elongation over stage travel",
    "boundary_shift": "shift of the boundary along Y",
    "boundary_tilt_x": "slope of the boundary along X",
    "boundary_tilt_z": "slope of the boundary along Z",
    "boundary_bow": "bow of the boundary",
    "depth_scale": "change of depth",
    "apex_shift": "X of the apex line",
    "load_gain": "error of the load gain",
    "load_offset": "load offset",
    "load_drift": "load drift over the test",
    "load_lag": "lag of the load behind the image",
    "height_scale": "error of the height scale",
    "hold_time_error": "holds longer than stamped by",
    "fixed_pattern": "share of the flat pattern left",
    "height_drift": "drift of the heights",
    "magnification_drift": "drift of magnification",
    "scan_shear_drift": "drift of the shear of the field",
    "tilt_drift": "drift of the tilt of the field",
    "sigma_e": "σ_e, noise of the elongation",
    "noise_ratio": "σ of noisy pixels / σ of quiet ones",
    "discretisation": "share of the finer-minus-working difference",
}
_CAUSES = {
    "non_schmid": "non-Schmid stress",
    "hold_time": "length of the holds",
    "lattice_gradient_grain1": "lattice gradient in grain 1",
    "lattice_gradient_grain2": "lattice gradient in grain 2",
    "noise_not_uniform": "uneven noise of the images",
    "family_112": "{112} family",
    "misorientation_grain1": "misorientation of grain 1",
    "misorientation_grain2": "misorientation of grain 2",
    "ebsd_frame": "EBSD frame",
    "boundary_noise": "noise of the boundary motion",
    "ebsd_flip_x": "EBSD frame turned by half a turn about X",
    "ebsd_flip_y": "EBSD frame turned by half a turn about Y",
    "ebsd_flip_z": "EBSD frame turned by half a turn about Z",
    "boundary_position": "position of the grain boundary",
    "boundary_tilt": "tilt of the grain boundary",
    "boundary_bow": "bow of the grain boundary",
    "apex_off_centre": "apex off centre",
    "section_depth": "depth of the section",
}
_LABELS |= {
    f"lambda_{side}_{axis}": f"λ{sign}_{axis}"
    for side, sign in (("plus", "⁺"), ("minus", "⁻"))
    for axis in "YZ"
}
_LABELS |= {
    f"rotation_{what}_{axis}": f"turn of {turned} about {axis.upper()}"
    for what, turned in (("grain1", "grain 1"), ("grain2", "grain 2"), ("frame", "the EBSD frame"))
    for axis in "xyz"
}
_LABELS |= {
    f"lattice_gradient_grain{grain}_{axis}": f"gradient of grain {grain} about {axis.upper()}"
    for grain in (1, 2)
    for axis in "xyz"
}
_SHORT = {"origin_X": "origin X", "origin_Y": "origin Y", "load_gain": "load gain"}
_KNOTS = {"elongation": "ΔU_Y", "tilt": "ΔU_Z"}
_PERCENT = frozenset(
    ("load_gain", "depth_scale", "height_scale", "stretch_curvature", "magnification_drift")
)
_SLOPES = frozenset(("scan_shear_drift", "tilt_drift"))
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SMALLEST_P = 1e-99


def label(name: str) -> str:
    """A parameter as it is written in tables and figures; K, n, c, d stand for themselves."""
    what, _, count = name.partition("_")
    if what in _KNOTS and count.isdigit():
        return f"{_KNOTS[what]}, knot {count}"
    return _LABELS.get(name, name)


def short_label(name: str) -> str:
    """A parameter where there is little room, as beside a matrix."""
    return _SHORT.get(name) or label(name).replace(", knot ", " ")


def cause_label(name: str) -> str:
    """A cause as it is written in text."""
    return _CAUSES.get(name, name.replace("_", " "))


def readable(text: str, causes: Iterable[str]) -> str:
    """A text with the names of these causes as they are written."""
    for name in sorted(causes, key=len, reverse=True):
        text = re.sub(rf"\b{name}\b", cause_label(name), text)
    return text


def named(text: str, parameters: Iterable[str]) -> str:
    """A text with these parameters as they are written."""
    for name in sorted(parameters, key=len, reverse=True):
        if len(name) > 1:
            text = re.sub(rf"\b{name}\b", label(name), text)
    return text


def reading_unit(name: str, unit: str) -> tuple[float, str]:
    """Factor and unit in which a parameter is read: degrees, nanometres, GPa or percent.

    Args:
        name: the parameter.
        unit: its internal unit.
    """
    if unit == "rad":
        return _DEGREE, "°"
    if unit == "rad/µm":
        return _DEGREE, "°/µm"
    if re.fullmatch(r"(elongation|tilt)_\d+|origin_[XY]|sigma_e|height_drift", name):
        return 1e3, "nm"
    if name == "c":
        return 1e-3, "GPa"
    if name in _PERCENT:
        return 100.0, "%"
    if name in _SLOPES:
        return 1e3, "mrad"
    return 1.0, unit


def number(value: float | None, digits: int = 3) -> str:
    """A number with significant digits, “–” where there is none."""
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
    """A number of any size in a few characters: “430”, “−4·10⁵”."""
    if value == 0.0 or 0.01 <= abs(value) < 9995.0:
        return number(value, 2)
    return _scientific(value, 1).replace("-", "−")


def chi(value: float) -> str:
    """A χ: two decimals up to ten, then three digits."""
    return f"{value:.2f}" if value < 9.995 else number(value)


def signed(value: float, digits: int = 3) -> str:
    """A number with its sign."""
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
    """A share from 0 to 1; only what is whole is 100 %."""
    if share < 0.01:
        return "< 1 %"
    return f"{min(round(100 * share), 99) if share < 1 else 100} %"


def duration(seconds: float) -> str:
    """“0.4 s”, “72 s”, “4.5 min” or “2.1 h”."""
    if seconds < 100:
        return f"{seconds:.1f} s" if seconds < 10 else f"{seconds:.0f} s"
    return f"{seconds / 60:.1f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def probability(p: float) -> str:
    """A probability: “0.23”, “4·10⁻⁷” or “< 10⁻⁹⁹”."""
    if p < _SMALLEST_P:
        return f"< {_power(-99)}"
    if p >= 1e-3:
        return f"{p:.2g}"
    return _scientific(p, 1)


def change(name: str, unit: str, amount: float, logarithmic: bool) -> str:
    """A departure from the null with its sign: in percent for parameters known by their log.

    Args:
        name: the parameter.
        unit: its internal unit.
        amount: departure in that unit, or of the logarithm.
        logarithmic: whether it is one of the logarithm.
    """
    if logarithmic:
        return f"{signed(100.0 * math.expm1(amount))} %"
    factor, shown = reading_unit(name, unit)
    return with_unit(signed(factor * amount), shown)


def smallest(name: str, unit: str, amount: float | None, logarithmic: bool) -> str:
    """The smallest magnitude that would have been seen, “not visible” if none would."""
    if amount is None:
        return "not visible"
    if logarithmic:
        relative = math.expm1(amount) if amount < 20.0 else math.inf
        if relative > 2.0:
            return "not visible below a factor of 3"
        return f"{number(100.0 * relative, 2)} %"
    factor, shown = reading_unit(name, unit)
    return with_unit(number(factor * amount, 2), shown)


def with_unit(text: str, unit: str) -> str:
    """A number and its unit; degrees stand close."""
    return text + unit if unit == "°" and "±" not in text else f"{text} {unit}".rstrip()


def joined(words: Sequence[str]) -> str:
    """“a”, “a and b”, “a, b and c”."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _places(sigma: float) -> int:
    """Decimal places: two digits of σ if it begins with 1 or 2, else one."""
    exponent = math.floor(math.log10(sigma))
    return (1 if sigma / 10.0**exponent < 2.95 else 0) - exponent


def _scientific(value: float, digits: int) -> str:
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}·{_power(int(exponent))}"


def _power(exponent: int) -> str:
    return "10" + str(exponent).translate(_SUPERSCRIPT)


def tenths(prefix: str, log: Log) -> Callable[[Progress], None]:
    """Progress of a simulation as a line for each tenth of its time."""
    told = 0

    def tell(progress: Progress) -> None:
        nonlocal told
        tenths = int(10 * progress.time / progress.end)
        if tenths > told:
            told = tenths
            left = progress.remaining
            to_go = "" if math.isnan(left) else f", {duration(left)} to go"
            log(f"{prefix}{10 * tenths} %{to_go}")

    return tell


def cost_told(seconds: float, memory: float) -> str:
    """What a job will cost, in words.

    Args:
        seconds: wall-clock time on cores that do nothing else [s].
        memory: largest resident memory of all its processes together [bytes].
    """
    return f"about {duration(seconds)} on free cores and {memory / 1e9:.1f} GB of memory"
