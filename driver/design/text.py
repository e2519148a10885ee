"""A design as lines of text."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from driver.design.comparison import by_group, gain
from driver.design.detectability import NAMED_AT
from driver.design.forecast import Forecast
from driver.design.information import SOURCES, groups_of
from driver.diagnosis.statistics.score_test import SEEN_AT
from driver.results.design import Gain, Knowledge, Outlook

_SAME = 0.02  # a change of σ that is not worth a number
_HIDDEN = 0.5  # share of an effect that is left, below which what takes the rest is told
_BLIND = 20.0  # prior scales; an effect that has to be larger is none that there is


def shown(value: float, unit: str, relative: bool = False) -> str:
    """Write a magnitude in the unit that people take; a logarithm in percent or as a factor."""
    if not np.isfinite(value):
        return "—"
    if relative:
        return f"{100 * value:.2g} %" if value < 1.0 else f"× {np.exp(min(value, 20.0)):.2g}"
    for small, large, factor in (("rad", "°", 180 / np.pi), ("µm", "nm", 1e3)):
        if unit == small and (unit == "rad" or abs(value) < 0.1):
            value, unit = value * factor, large
    number = f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}"
    return f"{number} {unit}".strip()


def lines_of(base: Forecast, surface: str, others: Sequence[Forecast]) -> list[str]:
    """All that is told of a design."""
    lines = [*_assumed(base, surface), "", *_parameters(base), "", *_causes(base)]
    if others:
        lines += ["", *_gains(base, others)]
    return lines


def _assumed(base: Forecast, surface: str) -> list[str]:
    stretch = ", ".join(f"{1e3 * e:.0f}" for e in base.elongation)
    load = ", ".join(f"{f:.0f}" for f in base.load)
    return [
        f"surface: {surface}",
        f"test: {base.n_images} images in {base.duration / 60:.0f} min; at the turning points an "
        f"elongation of {stretch} nm and, by the model, a load of {load} µN, "
        f"± {base.variant.case.loads.noise_uN:g} µN",
    ]


def _parameters(base: Forecast) -> list[str]:
    heads = "".join(f"{source:>11}" for source in SOURCES)
    lines = [
        "what the fitted parameters would be known to, and what their variance comes from",
        f"{'parameter':<16}{'assumed':>12}{'±':>20}{heads}  limited by",
    ]
    for group, members in groups_of([p.name for p in base.parameters]).items():
        known = [p for p in base.parameters if p.name in members]
        if group == "the knots":
            lines += [_knots(known, start) for start in ("elongation", "tilt")]
        else:
            lines += [_parameter(p) for p in known]
    return [line for line in lines if line]


def _parameter(p: Knowledge) -> str:
    parts = "".join(f"{p.parts[source]:>11.0%}" for source in SOURCES)
    value, sigma = shown(p.value, p.unit), shown(p.sigma, p.unit)
    if p.relative:
        sigma += f" ({shown(p.theta, '', relative=True)})"
    return f"{p.name:<16}{value:>12}{sigma:>20}{parts}  {p.limit}"


def _knots(known: Sequence[Knowledge], start: str) -> str:
    """Return the worst known of the knots of a motion."""
    ones = [p for p in known if p.name.startswith(start)]
    if not ones:
        return ""
    worst = max(ones, key=lambda p: p.sigma)
    parts = "".join(f"{worst.parts[source]:>11.0%}" for source in SOURCES)
    name, sigma = f"{start}_1…{len(ones)}", "≤ " + shown(worst.sigma, worst.unit)
    return f"{name:<16}{'':>12}{sigma:>20}{parts}  {worst.limit}"


def _causes(base: Forecast) -> list[str]:
    if not base.causes:
        return ["none of the causes that the case asks for can be forecast"]
    lines = [
        "what would show of the causes, most visible first: the smallest magnitude that would be "
        f"seen ({SEEN_AT:g} σ), also",
        f"in usual sizes (at most 1: it would show at its usual size; {NAMED_AT:g} σ, "
        f"{NAMED_AT / SEEN_AT - 1:.0%} more, name it), and the share in the loads",
        f"{'cause':<25}{'usual size':>12}{'seen from':>26}{'in sizes':>10}{'in loads':>10}  "
        "hidden by; not told from",
    ]
    return lines + [_cause(o) for o in sorted(base.causes, key=lambda o: o.in_scales)]


def _cause(outlook: Outlook) -> str:
    first = outlook.parameters[0]
    best = min(outlook.parameters, key=lambda p: p.in_scales)
    seen = " / ".join(
        shown(p.seen, p.unit, p.relative) if p.in_scales < _BLIND else "—"
        for p in outlook.parameters
    )
    size = shown(first.scale, first.unit, first.relative)
    sizes = f"{outlook.in_scales:.2g}" if outlook.in_scales < _BLIND else "—"
    words = []
    if best.in_scales >= _BLIND:
        words.append("undetectable here")
    elif best.left < _HIDDEN:
        words.append(f"{1 - best.left:.0%} of it by {best.hidden_by}")
    if outlook.alike:
        words.append("not told from " + ", ".join(outlook.alike))
    return (
        f"{outlook.cause.name:<25}{size:>12}{seen:>26}{sizes:>10}{best.loads:>10.0%}  "
        + "; ".join(words)
    )


def _gains(base: Forecast, others: Sequence[Forecast]) -> list[str]:
    gains = [gain(base, other) for other in others]
    columns = "".join(f"{f'[{k + 1}]':>7}" for k in range(len(others)))
    lines = ["what a change would buy: σ, or the smallest magnitude seen, over that of the case"]
    for k, (other, won) in enumerate(zip(others, gains, strict=True)):
        lines.append(f"[{k + 1}] {other.variant.name}{_effort(base, other)}: {in_words(won)}")
    lines.append(f"{'':<27}{columns}")
    means = [by_group(won.sigma) for won in gains]
    for group in by_group({p.name: 1.0 for p in base.parameters}):
        lines.append(f"{group:<27}" + "".join(_cell(mean.get(group)) for mean in means))
    for outlook in sorted(base.causes, key=lambda o: o.in_scales):
        name = outlook.cause.name
        lines.append(f"{name:<27}" + "".join(_cell(won.seen.get(name)) for won in gains))
    return lines


def _effort(base: Forecast, other: Forecast) -> str:
    """Return what a change costs, where it costs images or time."""
    if (base.n_images, base.duration) == (other.n_images, other.duration):
        return ""
    return f" ({other.n_images} images in {other.duration / 60:.0f} min)"


def _cell(ratio: float | None) -> str:
    if ratio is None:
        return f"{'':>7}"
    return f"{'·':>7}" if abs(ratio - 1.0) < _SAME else f"{ratio:>7.2f}"


def in_words(won: Gain) -> str:
    """Return gain of a change in one line: what it does best, what it shows, parts and loses."""
    everything = by_group(won.sigma) | dict(won.seen)
    best = sorted(everything.items(), key=lambda item: item[1])[:3]
    better = [f"{name} × {ratio:.2f}" for name, ratio in best if ratio < 1.0 - _SAME]
    parts = ["best for " + ", ".join(better) if better else "buys nothing"]
    for verb, names in (("shows", won.shown), ("no longer shows", won.lost)):
        if names:
            parts.append(f"{verb} {', '.join(names)}")
    for verb, pairs in (("parts", won.parted), ("merges", won.merged)):
        if pairs:
            parts.append(f"{verb} " + ", ".join(f"{a} and {b}" for a, b in pairs))
    return "; ".join(parts)
