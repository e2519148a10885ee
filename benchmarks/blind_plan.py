"""The list of blind trials, drawn from one seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

Kind = Literal[
    "null",
    "cause",
    "pair",
    "outside",
    "noise level",
    "jitter",
    "AR(1)",
    "known",
    "noise",
    "flip",
    "large",
]
KINDS: tuple[Kind, ...] = (
    "null", "cause", "pair", "outside", "noise level", "jitter", "AR(1)", "known", "noise", "flip",
    "large",
)  # fmt: skip
LOW, HIGH = 10.0, 15.0  # projected misfit by the ruler [σ]; an experiment may see a third less
FAINTEST = 0.1  # σ, at which a cause is hidden that leaves no trace
ENOUGH = 6.5  # σ, from which on a cause is hidden several times
REPEATS = 5
PAIR_LEVEL = 10.0
OUTSIDE_LEVELS = (14.0, 22.0)  # by the ruler, where the effect can be as large
OUTSIDE_EFFECTS = ("soft_slice", "notch", "creep", "lens", "blister", "slip_band")
DESCRIBED = {"soft_slice": "band_grain2"}
"""Those of them that a cause has described since; their trials have kept their places."""
LOAD_NOISE_RATIOS = (0.7, 1.3)  # true over stated
JITTER_NM = (0.3, 1.0)
AUTOCORRELATIONS = (0.4, 0.7)
NULLS, PAIRS, OUTSIDES, DISTURBED, KNOWN, LARGES = 1000, 90, 84, 30, 4, 2
NOISES = {"boundary_noise": (0.5, 1.0), "noise_not_uniform": (2.0, 3.0)}
"""Noises that the case does not state, with their sizes: nm at a stop, last over first column."""
QUIET = 1 / 3  # noise of a better load cell
ELASTIC, ELASTIC_LEVEL = ("load_gain", "elastic_stiffness"), 10.0
"""Of both no more than 3 σ within four prior scales: they are larger, below a quieter load cell.
A viscosity K that is known parts them, for a gain scales it with all other stresses: here it is
identified, too. By the ruler, which knows K; 7 to 10 σ are left."""
LARGE = {
    "load_lag": 32.0, "isotropic_hardening": 33.0, "second_back_stress": 40.0,
    "load_offset": 22.0, "stretch_not_proportional": 55.0,
}  # fmt: skip
"""Causes that make a χ_F of 10 and more below a quieter load cell, and their misfit by the ruler,
without a bound of their prior: others would have to be tens of prior scales larger, or leave
their bounds (to first order, by the ruler)."""
Q_LEVEL, Q_LIKE_BACK_STRESS_LEVEL = 12.0, 2.0
"""By the ruler, whose b is 30; where b is d it sees 2 σ of 9 MPa, which leave 6.5 σ."""


@dataclass(frozen=True)
class Trial:
    """One experiment and its diagnosis.

    Attributes:
        name: unique; by it a run that was stopped finds what is done.
        kind: what is true.
        truths: causes of the library, or the effect outside it; empty where the model is right.
        directions: of the parameters of each cause, unit vectors in prior scales.
        level: projected misfit of each truth [σ]; of a disturbance its size.
        companions: values of parameters that exist only under the alternative.
        seed: of relief, stage and noise.
    """

    name: str
    kind: Kind
    truths: tuple[str, ...]
    directions: tuple[tuple[float, ...], ...]
    level: float
    companions: tuple[tuple[str, float], ...]
    seed: int


def aims(seed: int, causes: Mapping[str, tuple[int, bool]]) -> dict[str, tuple[float, ...]]:
    """Return a direction for each cause, a unit vector in prior scales.

    Args:
        seed: of the plan.
        causes: by name the number of parameters, and whether they are one-sided.
    """
    return {
        name: _direction(_generator(seed, "aim", name), *shape) for name, shape in causes.items()
    }


def plan(
    seed: int, causes: Mapping[str, tuple[int, bool]], alike: Mapping[str, tuple[str, ...]],
    reach: Mapping[str, tuple[float, float]], hardening_d: float, flips: Sequence[str] = (),
) -> tuple[Trial, ...]:  # fmt: skip
    """All trials, in an order of which every beginning holds every kind in its share.

    Each draws from a stream of its own, so that a new cause leaves the trials of the others as
    they are.

    Args:
        seed: of all that is drawn.
        causes: by name the number of parameters, and whether they are one-sided.
        alike: by name the causes that do the same to the data.
        reach: by name the largest projected misfit along its aim, and against it [σ].
        hardening_d: the d of the truth.
        flips: half turns of the EBSD frame that make other lattices.
    """
    groups: dict[Kind, list[Trial]] = {kind: [] for kind in KINDS}

    def add(
        kind: Kind, truths: tuple[str, ...], level: float,
        directions: tuple[tuple[float, ...], ...] = (),
        companions: tuple[tuple[str, float], ...] = (),
    ) -> None:  # fmt: skip
        name = f"{kind} {len(groups[kind])}"
        before = sum(trial.truths == truths for trial in groups[kind])
        draw = int(_generator(seed, kind, *truths, str(before)).integers(2**31))
        groups[kind].append(Trial(name, kind, truths, directions, level, companions, draw))

    towards = aims(seed, causes)
    for _ in range(NULLS):
        add("null", (), 0.0)
    for name, (_, one_sided) in causes.items():
        for sign, most in zip((1,) if one_sided else (1, -1), reach[name], strict=False):
            for level in magnitudes(most):
                for _ in range(REPEATS if level >= ENOUGH else 1):
                    add("cause", (name,), level, (tuple(sign * a for a in towards[name]),))
    for_pairs = [name for name in causes if reach[name][0] >= PAIR_LEVEL]
    of_pairs = _generator(seed, "pairs")
    while len(groups["pair"]) < PAIRS:
        first, second = (str(n) for n in of_pairs.choice(for_pairs, 2, replace=False))
        if second not in alike[first]:
            add("pair", (first, second), PAIR_LEVEL, (towards[first], towards[second]))
    for k in range(OUTSIDES):
        turn, effect = divmod(k, len(OUTSIDE_EFFECTS))
        add("outside", (OUTSIDE_EFFECTS[effect],), OUTSIDE_LEVELS[turn % 2])
    for k in range(DISTURBED):
        add("noise level", (), LOAD_NOISE_RATIOS[k % 2])
        add("jitter", (), JITTER_NM[k % 2])
        add("AR(1)", (), AUTOCORRELATIONS[k % 2])
    for k in range(KNOWN if {*ELASTIC} <= {*causes} else 0):
        add("known", (ELASTIC[k % 2],), ELASTIC_LEVEL, ((1.0,),))
    if "isotropic_hardening" in causes:
        for _ in range(KNOWN // 2):
            for b, level in ((hardening_d, Q_LIKE_BACK_STRESS_LEVEL), (30.0, Q_LEVEL)):
                add("known", ("isotropic_hardening",), level, ((1.0,),), (("b", b),))
    for noise, sizes in NOISES.items():
        for size in sizes * REPEATS:
            add("noise", (noise,), size)
    for flip in (*flips,) * REPEATS:
        add("flip", (flip,), 0.0)
    for name, size_of in LARGE.items():
        for sign in (1,) if causes.get(name, (1, True))[1] else (1, -1):
            for _ in range(LARGES if name in causes else 0):
                add("large", (name,), size_of, ((float(sign),),))
    for kind, trials in groups.items():
        # Names are given already: the order says nothing of the truth.
        _generator(seed, "order", kind).shuffle(trials)
    ranked = [
        ((k + 0.5) / len(trials), trial)
        for trials in groups.values()
        for k, trial in enumerate(trials)
    ]
    return tuple(trial for _, trial in sorted(ranked, key=lambda pair: pair[0]))


def magnitudes(most: float) -> tuple[float, float]:
    """Return the two sizes at which a cause is hidden; the larger may be its largest [σ]."""
    high = max(min(HIGH, most), FAINTEST)
    low = LOW if high > LOW + 1 else high / 2
    return round(low, 2), round(high, 2)


def _generator(seed: int, *names: str) -> np.random.Generator:
    """Return the stream of one thing that is drawn, known by its names."""
    return np.random.default_rng([seed, *" ".join(names).encode()])


def _direction(rng: np.random.Generator, n: int, one_sided: bool) -> tuple[float, ...]:
    drawn = rng.standard_normal(n)
    if one_sided:
        drawn = np.abs(drawn)
    return tuple((drawn / np.linalg.norm(drawn)).tolist())
