from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

import pytest

from driver.diagnosis.answer.verdict import (
    BETTER_STARTS,
    MOST_ADDITIONS,
    REFINE,
    Kind,
    Verdict,
    decide,
    with_bounds,
    with_doubts,
    with_places,
    with_refinement,
    with_share_of_correction,
    with_what_one_mesh_shows,
)
from driver.diagnosis.causes.all_causes import EVERY
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.search.image_noise import with_uneven_noise

BY_NAME = {cause.name: cause for cause in EVERY}
SENTENCES = {cause.name: cause.sentence for cause in EVERY}
CHECKS = {cause.name: cause.check for cause in EVERY}
SLOW, SMOOTH = "a slow part of the loads", "a smooth motion"
CONTRAST, GAIN, DRIFT = ("grain_contrast",), ("load_gain", "section_depth"), ("tilt_drift",)


def causes(*names: str) -> tuple[Cause, ...]:
    return tuple(BY_NAME[name] for name in names)


def of(
    *added: Sequence[str],
    accepted: bool = True,
    imaging: bool = False,
    numerics: str | None = None,
    explained: float = 0.95,
    tried: bool = True,
) -> Verdict:
    left = () if accepted else (SLOW, SMOOTH)
    return decide([causes(*names) for names in added], left, imaging, numerics, explained, tried)


@pytest.mark.parametrize("kind", [of(), of(CONTRAST), of(GAIN)], ids=lambda one: one.kind)
def test_what_a_single_place_shows_stands_beside_a_verdict_by_which_nothing_is_left(
    kind: Verdict,
) -> None:
    missed = "the extended model misses what the loads show most in a hold (6.0 σ beyond noise)."
    said = with_places(kind, missed)
    assert said.kind == kind.kind and said.text == f"{kind.text} Yet {missed}"
    assert said.next.startswith("Look at the maps") and said.next.endswith(kind.next)
    assert with_places(kind, "") == kind


@pytest.mark.parametrize("accepted", [True, False])
def test_a_cause_that_would_have_to_be_beyond_its_bound_is_not_named(accepted: bool) -> None:
    named = of(DRIFT, accepted=accepted)
    said = with_bounds(named, ("tau0", "tilt_drift"))
    assert said.kind == "unexplained" and said.sets == named.sets
    assert said.text.startswith("Tilt drift would describe the data only beyond what occurs")
    assert "cause of your own" in said.next


def test_a_cause_beside_one_that_would_have_to_be_beyond_its_bound_stays_named() -> None:
    both = of(CONTRAST, DRIFT)
    beside = with_bounds(both, ("tilt_drift",))
    assert beside.kind == "named, but something is left" and beside.sets == both.sets
    assert beside.text.startswith(both.text) and "Yet tilt drift would" in beside.text
    assert beside.next.startswith(both.next)


@pytest.mark.parametrize(
    ("found", "held"),
    [
        (of(DRIFT), ()),
        (of(DRIFT), ("load_gain",)),
        (of(("heterogeneity_grain1",)), ("tau0_grain1_bend_Y",)),
        (of(("tilt_drift", "end_shear")), ("tilt_drift",)),
        (of(), ("tilt_drift",)),
        (of(DRIFT, numerics="finer"), ("tilt_drift",)),
    ],
)
def test_a_shape_at_its_bound_or_one_with_rivals_leaves_the_verdict(
    found: Verdict, held: tuple[str, ...]
) -> None:
    assert with_bounds(found, held) == found


def test_a_verdict_by_which_something_is_left_says_it_once() -> None:
    left = of(CONTRAST, accepted=False)
    assert with_places(left, "the extended model misses it.") == left


def test_where_no_cause_could_be_tried_nothing_is_said_of_any() -> None:
    found = of(tried=False)
    assert found.kind == "nothing wrong" and found.text.endswith("No cause was tried.")
    assert "smallest magnitude" not in found.next and "smallest magnitude" in of().next


@pytest.mark.parametrize(
    ("found", "kind", "names"),
    [
        (of(), "nothing wrong", ()),
        (of(accepted=False), "unexplained", ()),
        (of(imaging=True), "imaging-limited", ()),
        (of(imaging=True, accepted=False), "imaging-limited", ()),
        (of(CONTRAST), "named", ("grain_contrast",)),
        (of(CONTRAST, imaging=True), "named", ("grain_contrast",)),
        (of(CONTRAST, DRIFT), "named", ("grain_contrast", "tilt_drift")),
        (of(GAIN), "one of this set", GAIN),
        (of(CONTRAST, GAIN), "one of this set", ("grain_contrast", *GAIN)),
        (of(CONTRAST, accepted=False), "named, but something is left", ("grain_contrast",)),
        (of(GAIN, accepted=False), "named, but something is left", GAIN),
        (of(CONTRAST, accepted=False, explained=0.8), "unexplained", ("grain_contrast",)),
        (of(CONTRAST, explained=0.8), "named", ("grain_contrast",)),
        (of(CONTRAST, DRIFT, GAIN), "unexplained", ("grain_contrast", "tilt_drift", *GAIN)),
        (of(CONTRAST, numerics="a finer mesh is needed"), "numerics", ("discretisation",)),
    ],
)
def test_the_kind_of_the_answer(found: Verdict, kind: str, names: tuple[str, ...]) -> None:
    assert found.kind == kind and found.names == names and found.causes == causes(*names)
    assert found.text[0].isupper() and found.text.endswith(".") and found.next.endswith(".")


def test_as_many_additions_as_are_allowed_explain_nothing() -> None:
    assert MOST_ADDITIONS == 3
    text = of(CONTRAST, DRIFT, GAIN).text
    assert "their sum describes the data" in text and "shadow of one that was not tried" in text
    # A blister of the face left a χ of the images of 1.24 to three causes.
    left = of(CONTRAST, DRIFT, GAIN, accepted=False).text
    assert "even their sum leaves what is not noise" in left and "describes" not in left


def test_what_is_named_is_said_and_can_be_confirmed() -> None:
    found = of(CONTRAST, DRIFT)
    assert found.text.startswith("The two grains have different critical resolved shear stresses")
    assert SENTENCES["tilt_drift"] in found.text
    assert CHECKS["grain_contrast"] in found.next and CHECKS["tilt_drift"] in found.next


def test_what_cannot_be_told_apart_is_said_with_the_check_of_each() -> None:
    found = of(GAIN)
    assert found.text.startswith(
        f"Either {SENTENCES['load_gain']}, or {SENTENCES['section_depth']}"
    )
    assert found.next.startswith("These data cannot tell load gain or depth of the section.")
    assert CHECKS["load_gain"] in found.next and CHECKS["section_depth"] in found.next


@pytest.mark.parametrize("added", [(CONTRAST, GAIN), (GAIN, CONTRAST)])
def test_a_cause_that_is_sure_stays_so_beside_a_set(added: tuple[Sequence[str], ...]) -> None:
    found = of(*added)
    assert found.kind == "one of this set" and found.sets == tuple(
        causes(*names) for names in added
    )
    assert f"either {SENTENCES['load_gain']}, or" in found.text.lower()
    assert f"either {SENTENCES['grain_contrast']}" not in found.text.lower()
    assert f"Confirm grain contrast: {CHECKS['grain_contrast']}." in found.next
    assert "cannot tell load gain or depth of the section." in found.next


def test_a_cause_that_was_added_beside_another_is_no_rival_of_it() -> None:
    found = of(("load_gain", "tilt_drift"), DRIFT)
    assert found.kind == "named" and found.sets == (causes("load_gain"), causes(*DRIFT))


def test_what_is_left_is_said() -> None:
    told = f"{SLOW}, and {SMOOTH}."
    assert of(GAIN, accepted=False).text.endswith(f"still not noise: {told}")
    assert of(GAIN, accepted=False, explained=0.5).text.endswith(f"structured as well: {told}")
    assert of(accepted=False).text.endswith(f"no cause that was tried explains it: {told}")
    assert "maps of what is left" in of(accepted=False).next


def test_where_nothing_is_named_only_what_was_tried_is_spoken_of() -> None:
    """A case may ask for a few causes of the library."""
    for accepted in (True, False):
        text = of(accepted=accepted).text
        assert "no cause that was tried" in text and "library" not in text


def test_a_coarse_simulation_says_what_it_needs() -> None:
    found = of(CONTRAST, numerics="a mesh half as large is needed")
    assert "a mesh half as large is needed." in found.text


def test_what_one_mesh_alone_shows_is_told_with_an_answer_that_names_nothing() -> None:
    found = with_what_one_mesh_shows(of(), "depth of the section", 3.7)
    assert found.kind == "nothing wrong" and found.next.endswith(REFINE)
    assert "shows depth of the section, the mean of both does not: they differ by 3.7" in found.text
    assert with_what_one_mesh_shows(of(CONTRAST), "load gain", 3.7) == of(CONTRAST)


def test_a_correction_that_the_data_take_back_is_told_with_any_answer() -> None:
    for answer in (of(), of(CONTRAST)):
        found = with_share_of_correction(answer, -0.62, 0.11)
        assert found.kind == answer.kind and found.next == f"{answer.next} {REFINE}"
        assert "time steps the data take back 0.62 ± 0.11 of it:" in found.text
    assert "ask for another 0.30 ± 0.05 of it" in with_share_of_correction(of(), 0.3, 0.05).text


def test_a_refinement_that_is_known_is_named_in_place_of_a_request_for_one() -> None:
    coarse = of(CONTRAST, numerics="a mesh half as large is needed")
    assert coarse.next == REFINE
    named = with_refinement(coarse, "Write specimen.mesh_size_um = 1, then run again.")
    assert named.next == "Write specimen.mesh_size_um = 1, then run again."
    doubtful = with_doubts(coarse, ["the fit has not converged"], [], BETTER_STARTS)
    assert with_refinement(doubtful, "Refine so.").next == f"{BETTER_STARTS} Refine so."
    assert with_refinement(of(CONTRAST), "Refine so.") == of(CONTRAST)


def test_a_fit_that_has_not_converged_is_told_with_the_answer() -> None:
    answer = of(CONTRAST)
    assert with_doubts(answer, [], []) == answer
    why = ["the fit of the extended model has not converged (2 σ)"]
    told = with_doubts(answer, why, [], BETTER_STARTS)
    assert told.kind == answer.kind and told.sets == answer.sets
    assert told.text.startswith(answer.text) and told.text.endswith("not converged (2 σ).")
    assert told.next.startswith("Let the fit converge") and told.next.endswith(answer.next)


def test_what_could_not_be_added_is_told_with_the_answer_and_asks_for_no_other_fit() -> None:
    answer = of(CONTRAST)
    told = with_doubts(answer, [], ["load lag is not added, for the rounds come to no end"])
    assert told.text.startswith(answer.text) and told.text.endswith("come to no end.")
    assert told.next == answer.next


IDENTIFIERS = [cause.name for cause in EVERY if "_" in cause.name]


@pytest.mark.parametrize("cause", EVERY, ids=lambda cause: cause.name)
def test_no_identifier_of_a_cause_stands_in_the_text_of_a_verdict(cause: Cause) -> None:
    """Of every kind: the best of a set and its rival, alone and beside others."""
    one, other = (cause.name,), tuple(n for n in ("load_gain", "tilt_drift") if n != cause.name)
    answers = [
        of(), of(accepted=False), of(imaging=True), of(tried=False), of(one, numerics="coarse"),
        of(one), of((*one, *other)), of((*other, *one)), of(one, other), of(one, accepted=False),
        of((*one, *other), accepted=False), of(one, accepted=False, explained=0.5),
        of(one, CONTRAST, DRIFT, ("load_lag",)),
    ]  # fmt: skip
    assert {answer.kind for answer in answers} == set(get_args(Kind))
    for answer in (*answers, *map(with_uneven_noise, answers)):
        written = f"{answer.text} {answer.next}"
        assert not [name for name in IDENTIFIERS if name in written]
    assert cause.title in of(one).next and cause.title in of((*one, *other)).next


@pytest.mark.parametrize("added", [(CONTRAST,), (GAIN,), (CONTRAST, DRIFT, ("load_lag",))])
def test_a_verdict_writes_the_labels_that_its_causes_carry(
    added: tuple[Sequence[str], ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, cause in BY_NAME.items():
        monkeypatch.setitem(BY_NAME, name, replace(cause, label=f"label of {cause.title}"))
    answer = of(*added)
    assert all(cause.title.startswith("label of ") for cause in answer.causes)
    assert all(cause.title in f"{answer.text} {answer.next}" for cause in answer.causes)
