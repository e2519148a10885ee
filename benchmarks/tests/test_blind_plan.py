from __future__ import annotations

import numpy as np
import pytest

from benchmarks import blind_plan
from benchmarks.blind_figures import has_both, has_class, miss_of, wilson
from benchmarks.blind_plan import (
    ENOUGH,
    HIGH,
    KINDS,
    LARGES,
    NULLS,
    PAIRS,
    Q_LEVEL,
    Q_LIKE_BACK_STRESS_LEVEL,
    REPEATS,
    Trial,
    aims,
    magnitudes,
    plan,
)

CAUSES = {
    "isotropic_hardening": (1, True),
    "load_gain": (1, False),
    "elastic_stiffness": (1, False),
    "boundary_tilt": (2, False),
    "load_lag": (1, False),
}
ALIKE = {name: (name,) for name in CAUSES}
REACH = {
    "isotropic_hardening": (20.0, 0.0),
    "load_gain": (11.5, 12.0),
    "elastic_stiffness": (3.0, 2.0),
    "boundary_tilt": (12.0, 4.0),
    "load_lag": (8.0, 8.0),
}
FLIPS = ("ebsd_flip_x", "ebsd_flip_z")
TRIALS = plan(7, CAUSES, ALIKE, REACH, 1140.0, FLIPS)


def test_a_plan_is_drawn_from_its_seed_alone() -> None:
    assert plan(7, CAUSES, ALIKE, REACH, 1140.0, FLIPS) == TRIALS
    assert plan(8, CAUSES, ALIKE, REACH, 1140.0, FLIPS) != TRIALS
    assert len({trial.name for trial in TRIALS}) == len(TRIALS)
    assert len({trial.seed for trial in TRIALS}) == len(TRIALS)


def test_large_effects_are_of_each_sign_of_their_cause_and_leave_the_others_their_seeds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    large = [(t.truths[0], t.directions[0][0]) for t in TRIALS if t.kind == "large"]
    signs = {("isotropic_hardening", 1.0), ("load_lag", 1.0), ("load_lag", -1.0)}
    assert set(large) == signs and len(large) == len(signs) * LARGES
    monkeypatch.setattr(blind_plan, "LARGE", {})
    others = {t.name: t.seed for t in TRIALS if t.kind != "large"}
    assert others == {t.name: t.seed for t in plan(7, CAUSES, ALIKE, REACH, 1140.0, FLIPS)}


def test_a_new_cause_leaves_the_trials_of_the_others_as_they_are() -> None:
    more = {"a_new_one": (1, False), **CAUSES}
    reach = REACH | {"a_new_one": (12.0, 12.0)}
    alike = ALIKE | {"a_new_one": ("a_new_one",)}

    def drawn(trials: tuple[Trial, ...]) -> set[tuple[object, ...]]:
        return {(t.kind, t.truths, t.level, t.directions, t.seed) for t in trials}

    before = {t for t in drawn(TRIALS) if t[0] != "pair"}
    assert before < drawn(plan(7, more, alike, reach, 1140.0, FLIPS))


def test_a_plan_has_both_signs_and_magnitudes_of_every_cause() -> None:
    drawn = {(t.truths[0], t.level, t.directions[0][0] > 0) for t in TRIALS if t.kind == "cause"}
    # A one-sided cause has one sign.
    assert len(drawn) == 2 * (1 + 2 + 2 + 2 + 2)
    assert ("isotropic_hardening", HIGH, True) in drawn


def test_a_cause_is_hidden_no_larger_than_it_may_be_and_more_often_where_it_can_be_seen() -> None:
    assert magnitudes(20.0) == (10.0, 15.0) and magnitudes(11.5) == (10.0, 11.5)
    assert magnitudes(4.0) == (2.0, 4.0)
    gains = [t.level for t in TRIALS if t.kind == "cause" and t.truths == ("load_gain",)]
    assert max(gains) == 12.0 and len(gains) == 4 * REPEATS
    tilts = [t.level for t in TRIALS if t.kind == "cause" and t.truths == ("boundary_tilt",)]
    assert sum(level < ENOUGH for level in tilts) == 2


def test_a_hardening_with_the_b_of_the_back_stress_has_a_level_of_its_own() -> None:
    by_b = {dict(t.companions)["b"]: t.level for t in TRIALS if t.companions}
    assert by_b == {1140.0: Q_LIKE_BACK_STRESS_LEVEL, 30.0: Q_LEVEL}
    assert Q_LIKE_BACK_STRESS_LEVEL < Q_LEVEL


def test_every_beginning_of_a_plan_holds_every_kind_in_its_share() -> None:
    third = TRIALS[: len(TRIALS) // 3]
    for kind in KINDS:
        share = sum(t.kind == kind for t in third) / sum(t.kind == kind for t in TRIALS)
        assert share == pytest.approx(1 / 3, abs=0.18)
    assert sum(t.kind == "null" for t in TRIALS) == NULLS


def test_a_pair_is_of_two_causes_that_the_data_can_tell_apart() -> None:
    alike = ALIKE | {"load_gain": ("load_gain", "boundary_tilt"),
                     "boundary_tilt": ("boundary_tilt", "load_gain")}  # fmt: skip
    pairs = [t for t in plan(7, CAUSES, alike, REACH, 1140.0) if t.kind == "pair"]
    assert len(pairs) == PAIRS
    assert not any(set(t.truths) == {"load_gain", "boundary_tilt"} for t in pairs)


def test_directions_are_unit_vectors_and_one_sided_ones_go_up() -> None:
    towards = aims(7, CAUSES)
    assert all(np.linalg.norm(aim) == pytest.approx(1) for aim in towards.values())
    assert towards["isotropic_hardening"] == (1.0,)


def test_wilson_bounds_are_those_of_the_literature() -> None:
    # Newcombe, Stat. Med. 17 (1998) 857, table I, method 3: 81 of 263, 15 of 148, 0 of 20.
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson(15, 148) == pytest.approx((0.0624, 0.1605), abs=1e-4)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)


def line(kind: str, truths: list[str], sets: list[list[str]], verdict: str) -> dict[str, object]:
    return {
        "trial": {"name": "one", "kind": kind, "truths": truths}, "verdict": verdict,
        "sets": sets, "said": [named[0] for named in sets], "refits": [{}],
        "alike": {"load_gain": ["load_gain", "elastic_stiffness"], "tilt_drift": ["tilt_drift"]},
        "statistic": {"load_gain": 40.0},
    }  # fmt: skip


def test_an_answer_in_the_class_of_the_truth_is_right() -> None:
    assert has_class(line("cause", ["load_gain"], [["elastic_stiffness"]], "named"))
    assert not has_class(line("cause", ["load_gain"], [["tilt_drift"]], "named"))


def test_of_a_pair_each_truth_needs_a_set_of_its_own() -> None:
    truths = ["load_gain", "tilt_drift"]
    assert has_both(line("pair", truths, [["tilt_drift"], ["elastic_stiffness"]], "named"))
    assert not has_both(line("pair", truths, [["tilt_drift", "load_gain"]], "one of this set"))


def test_every_miss_has_a_reason_and_a_hit_has_none() -> None:
    truth = ["load_gain"]
    assert miss_of(line("null", [], [], "nothing wrong")) == ""
    assert miss_of(line("null", [], [["tilt_drift"]], "named")) == "a false alarm"
    assert miss_of(line("cause", truth, [["load_gain"]], "named")) == ""
    assert "statistic of the truth [40.0]" in miss_of(line("cause", truth, [], "nothing wrong"))
    assert "not among the refits" in miss_of(line("cause", truth, [["tilt_drift"]], "named"))
    assert miss_of(line("outside", ["notch"], [["tilt_drift"]], "named")) == "outside, yet named"
    assert miss_of(line("outside", ["soft_slice"], [["tilt_drift"]], "named")) != ""
    assert miss_of(line("outside", ["soft_slice"], [["band_grain2"]], "named")) == ""
