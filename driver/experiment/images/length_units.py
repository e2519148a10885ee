"""Units of length as image files write them."""

from __future__ import annotations

_NANOMETRES = {
    "m": 1e9, "meter": 1e9, "metre": 1e9, "cm": 1e7, "mm": 1e6, "millimeter": 1e6,
    "um": 1e3, "micron": 1e3, "microns": 1e3, "micrometer": 1e3, "micrometers": 1e3,
    "nm": 1.0, "nanometer": 1.0, "nanometers": 1.0, "a": 0.1, "angstrom": 0.1, "pm": 1e-3,
    "inch": 2.54e7, "in": 2.54e7,
}  # fmt: skip


def nanometres(unit: str | None) -> float | None:
    """Nanometres of a unit of length.

    Args:
        unit: its name or symbol; µ may be the micro sign, the Greek letter, u, or what ImageJ
            writes for it.

    Returns:
        None where it is no unit of length that is known, such as “pixel”.
    """
    plain = (
        (unit or "").strip().replace("\\u00B5", "u").replace("\u00b5", "u").replace("\u03bc", "u")
    )
    return _NANOMETRES.get(plain.replace("Å", "a").replace("\u212b", "a").lower())
