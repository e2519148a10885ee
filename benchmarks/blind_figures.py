"""Figures of the blind trial: goals with Wilson bounds, and a table of every miss."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import mean

import numpy as np
from scipy.stats import binomtest

from benchmarks.blind_plan import DESCRIBED, ELASTIC, ELASTIC_LEVEL, KINDS
from benchmarks.blind_store import Record
from driver.diagnosis.statistics.score_test import NAMING_LEVEL, SEEN_AT

SILENT = ("null", "noise level", "jitter", "AR(1)")  # kinds of which nothing is to be said
LOUD = ("cause", "pair", "outside", "known", "noise", "flip", "large")
NAMING = ("named", "one of this set", "named, but something is left")


def wilson(hits: int, number: int) -> tuple[float, float]:
    """Bounds of a share at 95 % (Wilson, J. Am. Stat. Assoc. 22 (1927) 209)."""
    bounds = binomtest(hits, number).proportion_ci(method="wilson")
    return float(bounds.low), float(bounds.high)


def show_share(name: str, hits: Sequence[bool], goal: str) -> None:
    """Print a share in percent with its bounds and its number; a goal is met when its bound is."""
    if not hits:
        print(f"{name} = not measured (goal: {goal})")
        return
    low, high = (100 * bound for bound in wilson(sum(hits), len(hits)))
    relation, _, limit = goal.partition(" ")
    met = {">=": lambda: low >= float(limit), "<=": lambda: high <= float(limit)}
    judged = f": {'met' if met[relation]() else 'missed'}" if relation in met else ""
    print(
        f"{name} = {100 * mean(hits):.1f} [{low:.1f}, {high:.1f}] "
        f"of {len(hits)} (goal: {goal}{judged})"
    )


def print_figures(lines: Sequence[Record]) -> None:
    """All figures of the trials that are done, then every miss."""
    ran = [line for line in lines if "verdict" in line]
    kinds = {kind: _of(ran, kind) for kind in KINDS}
    for kind in SILENT:
        of = _of(ran, kind)
        # The verdict of a simulation that is not exact enough names no cause, and is a miss.
        named = [line["verdict"] in NAMING for line in of]
        show_share(f"{kind}: something named [%]", named, "<= 0.5" if kind == "null" else "<= 1")
        silent = [line["verdict"] == "nothing wrong" for line in of]
        show_share(f"{kind}: nothing wrong [%]", silent, ">= 97" if kind == "null" else ">= 97.5")
    own = [p < NAMING_LEVEL for x in kinds["null"] if (p := x.get("discretisation")) is not None]
    show_share("null: the simulation's own error is significant [%]", own, "none")
    if len(own) < len(kinds["null"]):
        print(f"  {len(kinds['null']) - len(own)} null(s) of earlier programs do not say it")
    large = [line for line in kinds["cause"] if line["misfit"] >= 6]
    _of_causes("misfit >= 6 sigma", large, "96")
    loud = [line for line in kinds["cause"] + kinds["large"] if line["chi_load"][0] >= 10]
    show_share("chi_F >= 10: class [%]", [has_class(line) for line in loud], ">= 95")
    below = [line for line in kinds["cause"] if line["misfit"] < 6]
    show_share("misfit < 6 sigma: class [%]", [has_class(line) for line in below], "none")
    for what, visible, wanted in (
        (f"pairs, each >= {SEEN_AT} sigma", True, ">= 85"),
        (f"pairs, one < {SEEN_AT} sigma", False, "none"),
    ):
        of = [x for x in kinds["pair"] if (min(x["like_itself"]) >= SEEN_AT) == visible]
        show_share(f"{what}: both [%]", [has_both(line) for line in of], wanted)
    # With the first one in the model the second may leave less than alone.
    known = [x for x in kinds["pair"] if "beside" in x]
    apart = [has_both(x) for x in known if min(x["beside"]) >= SEEN_AT]
    show_share(f"pairs, each >= {SEEN_AT} sigma beside the other: both [%]", apart, ">= 85")
    if len(known) < len(kinds["pair"]):
        print(f"  {len(kinds['pair']) - len(known)} pair(s) of earlier programs do not say it")
    strong = [line for line in kinds["outside"] if line["misfit"] >= 8]
    seen = [line["verdict"] != "nothing wrong" for line in strong]
    show_share("outside the library, misfit >= 8 sigma: seen [%]", seen, ">= 97")
    unexplained = [line["verdict"] == "unexplained" for line in strong if not _described_by(line)]
    show_share("outside the library, misfit >= 8 sigma: unexplained [%]", unexplained, ">= 85")
    for effect, cause in DESCRIBED.items():
        held = [cause in line["said"] for line in strong if _described_by(line) == cause]
        show_share(f"{effect}, misfit >= 8 sigma: {cause} in the answer [%]", held, "none")
    for kind in ("noise", "flip"):
        for truth in sorted({line["trial"]["truths"][0] for line in _of(ran, kind)}):
            of = [line for line in _of(ran, kind) if line["trial"]["truths"] == [truth]]
            show_share(f"{truth}: named [%]", [truth in line["said"] for line in of], "none")
    held = [
        line["held_out"]["chi_load_after"]
        for line in large
        if line["held_out"] is not None and has_class(line)
    ]
    if held:
        print(f"held-out chi_F of library truths, mean = {mean(held):.2f} (goal: <= 1.3)")
        show_share("held-out chi_F <= 1.3 [%]", [h <= 1.3 for h in held], "100")
    every_elastic = [x for x in kinds["known"] if x["trial"]["truths"][0] in ELASTIC]
    elastic = [x for x in every_elastic if x["trial"]["level"] == ELASTIC_LEVEL]
    of_Q = [x for x in kinds["known"] if x["trial"]["companions"]]
    with_30, with_d = ([x for x in of_Q if _of_b_30(x) == is_30] for is_30 in (True, False))
    show_share("Q with b = 30: named [%]", [_as_known(line) for line in with_30], "100")
    not_apart = [_as_known(line) for line in elastic]
    show_share("load gain against elastic scale: not told apart [%]", not_apart, "100")
    if len(elastic) < len(every_elastic):
        print(f"  {len(every_elastic) - len(elastic)} of an earlier plan, of other sizes, left out")
    show_share("Q with b = d: not told apart [%]", [_as_known(x) for x in with_d], "100")
    for kind, goal in (*((kind, 6) for kind in SILENT), *((k, 30) for k in LOUD)):
        times = [line["cpu"] for line in _of(ran, kind)]
        if times:
            times_told = f"{np.median(times):.1f}, mean {np.mean(times):.1f}"
            print(f"{kind}: CPU time of a diagnosis, median [s] = {times_told} (goal: <= {goal})")
    made = [line["cpu_of_truth"] for line in ran]
    print(
        f"CPU time of all truths, of all diagnoses [h] = {sum(made) / 3600:.2f}, "
        f"{sum(line['cpu'] for line in ran) / 3600:.2f}"
    )
    print(f"trials = {len(ran)} (goal: >= 1300)")
    of_library = [line for kind in ("cause", "pair", "known", "large") for line in kinds[kind]]
    sized = sum(line["misfit"] >= 6 for line in of_library)
    print(f"trials of causes and pairs with a misfit >= 6 sigma = {sized} (goal: >= 100)")
    tried: dict[str, set[float]] = {}
    for line in kinds["cause"]:
        tried.setdefault(line["trial"]["truths"][0], set()).add(line["trial"]["level"])
    print(f"causes at two magnitudes = {sum(len(m) > 1 for m in tried.values())} (goal: >= 28)")
    print(f"failed = {sum(line['answer'] == 'failed' for line in lines)} (goal: 0)")
    _misses(lines)


def _of_causes(what: str, lines: Sequence[Record], goal: str) -> None:
    show_share(f"{what}: class [%]", [has_class(line) for line in lines], f">= {goal}")
    alone = [line for line in lines if len(_alike(line)) == 1]
    show_share(f"{what}: name where it is alone in its class [%]",
               [_first(line) == line["trial"]["truths"][0] for line in alone], ">= 92")  # fmt: skip
    holds = [line["trial"]["truths"][0] in _set(line) for line in lines]
    show_share(f"{what}: the set holds the truth [%]", holds, ">= 97")
    sizes = [len(_set(line)) for line in lines if _set(line)]
    if sizes:
        print(f"{what}: mean set = {mean(sizes):.2f} (goal: <= 1.5)")
    spurious = [len(line["added"]) > len(line["trial"]["truths"]) for line in lines]
    show_share(f"{what}: spurious addition [%]", spurious, "<= 3")


def has_class(line: Record) -> bool:
    """Whether what is named first does the same to the data as the truth."""
    return _first(line) in _alike(line)


def has_both(line: Record) -> bool:
    """Whether each of two truths is in a set of its own."""
    first, two = (set(line["alike"][name]) for name in line["trial"]["truths"])
    sets = [set(named) for named in _sets(line)]
    return any(
        first & a and two & b for k, a in enumerate(sets) for m, b in enumerate(sets) if k != m
    )


def miss_of(line: Record) -> str:
    """Why an answer is wrong, or nothing."""
    kind = line["trial"]["kind"]
    if "verdict" not in line:
        return f"{line['answer']}: {line['why'].partition(chr(10))[0][:90]}"
    if kind in SILENT:
        return "" if line["verdict"] == "nothing wrong" else "a false alarm"
    if line["verdict"] == "numerics":
        return f"numerics, {line['numerics']['effect_sigma']:.1f} σ on {line['numerics']['on']}"
    if kind == "outside":
        good_answer = line["verdict"] == "unexplained" or _described_by(line) in line["said"]
        return "" if good_answer else f"outside, yet {line['verdict']}"
    if line["verdict"] == "nothing wrong":
        statistic = [round(s, 1) for s in line["statistic"].values() if s is not None]
        return f"not seen; statistic of the truth {statistic}"
    good: Callable[[Record], bool] = {"pair": has_both, "known": _as_known}.get(kind, has_class)
    if kind in ("noise", "flip"):
        return "" if line["trial"]["truths"][0] in line["said"] else "another answer"
    if good(line):
        return ""
    truths = [t for t in line["trial"]["truths"] if any(t in refits for refits in line["refits"])]
    if not truths:
        return "the truth was not among the refits"
    if line["verdict"] == "unexplained":
        return f"unexplained after {', '.join(line['added']) or 'no addition'}"
    return f"the refit preferred another: {line['refits'][0]}"


def _described_by(line: Record) -> str | None:
    """Return the cause that describes an effect once outside the library."""
    return DESCRIBED.get(line["trial"]["truths"][0])


def _misses(lines: Sequence[Record]) -> None:
    print("\n| trial | truth | misfit [σ] | answer | reason |\n|---|---|---|---|---|")
    for line in lines:
        why = miss_of(line)
        if why:
            truth = ", ".join(f"{k} = {v:.3g}" for k, v in line.get("hidden", {}).items())
            truth = truth or ", ".join(line["trial"]["truths"]) or f"{line['trial']['level']:g}"
            size = f"{line['misfit']:.1f}" if "misfit" in line else "–"
            print(f"| {line['trial']['name']} | {truth} | {size} | {line['answer']} | {why} |")


def _of(lines: Sequence[Record], kind: str) -> list[Record]:
    return [line for line in lines if line["trial"]["kind"] == kind]


def _alike(line: Record) -> list[str]:
    return list(line["alike"][line["trial"]["truths"][0]])


def _sets(line: Record) -> list[list[str]]:
    """Return sets that the answer names; one that explains nothing or doubts itself names none."""
    return list(line["sets"]) if line["verdict"] in NAMING else []


def _set(line: Record) -> list[str]:
    sets = _sets(line)
    return sets[0] if sets else []


def _first(line: Record) -> str:
    return _set(line)[0] if _set(line) else ""


def _as_known(line: Record) -> bool:
    """Whether an answer is the right one: of some causes, that they cannot be told apart."""
    if line["trial"]["truths"][0] in ELASTIC:
        return {*ELASTIC} <= {*_set(line)}
    return _named_alone(line) if _of_b_30(line) else _in_a_set(line)


def _of_b_30(line: Record) -> bool:
    return bool(dict(line["trial"]["companions"])["b"] == 30.0)


def _in_a_set(line: Record) -> bool:
    """Whether the truth is one of several that the answer names, or nothing of it is seen."""
    names = _set(line)
    return not names or (len(names) > 1 and line["trial"]["truths"][0] in names)


def _named_alone(line: Record) -> bool:
    return bool(_set(line) == line["trial"]["truths"])
