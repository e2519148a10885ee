from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from driver.diagnosis.answer.result_types import DiscretisationCheck, Round
from driver.diagnosis.causes.causes import NUMERICS
from driver.diagnosis.search.discretisation_check import (
    discretisation_check,
    with_missing_share,
    with_what_is_needed,
)
from driver.diagnosis.statistics.score_test import NAMING_LEVEL
from driver.identification.correction import Correction, correction
from driver.identification.fit import Fit
from driver.identification.objective import Objective
from tools import closed_form
from tools.closed_form_diagnosis import finer, identified

BENCH = closed_form.problem()
OTHER_STEPS = finer(BENCH, 0.5)


@cache
def baseline() -> tuple[Objective, Fit]:
    return identified(BENCH, closed_form.objective(BENCH, BENCH.truth))


def change(times: float) -> Correction:
    """So many times what other steps change."""
    here = baseline()[1]
    one = correction(BENCH.model, OTHER_STEPS, here.best.prediction, here.values)
    return Correction(times * np.asarray(one.motion), times * np.asarray(one.load))


@pytest.mark.parametrize(
    ("times", "steps_differ", "needed", "told"),
    [
        (1.0, False, "mesh", "a mesh half as large is needed"),
        (1.0, True, "steps", "time steps half as long are needed"),
        (2.0, True, "mesh and steps", "a mesh and time steps half as large are needed"),
    ],
)
def test_what_the_steps_alone_do_not_explain_is_the_mesh(
    times: float, steps_differ: bool, needed: str, told: str
) -> None:
    """The fresh correction is that of other steps, or as large by the mesh, or twice as large."""
    fine = OTHER_STEPS if steps_differ else BENCH.model
    of = (*baseline(), change(times))
    check = discretisation_check(*of, [], ["tau0", "c"])
    assert not check.passed and check.needed is None
    found = with_what_is_needed(check, *of, fine, [], ["tau0", "c"])
    assert found.needed == needed and (found.effect, found.along) == (check.effect, check.along)
    assert found.words is not None and found.words.endswith(f"along {found.along.title}; {told}")


def test_a_correction_that_has_not_changed_passes() -> None:
    objective, here = baseline()
    found = discretisation_check(objective, here, objective.correction, [], ["tau0"])
    assert found.passed and found.effect == pytest.approx(0.0, abs=1e-9)
    assert found.along.name == "tau0" and found.needed is None and found.words is None


@pytest.mark.parametrize(("accepted", "share"), [(True, 0.8), (False, 0.8), (True, 1.3)])
def test_a_share_of_the_correction_is_missing_where_the_tests_accept_all_that_is_left(
    accepted: bool, share: float
) -> None:
    """Where they reject, or more than the whole is missing, it is another effect."""
    objective, here = baseline()
    own = SimpleNamespace(
        cause=NUMERICS, p=0.1 * NAMING_LEVEL, estimate=np.array([share]), sigma=np.array([0.1])
    )
    last = SimpleNamespace(scores=(own,), goodness_of_fit=SimpleNamespace(accepted=accepted))
    check = DiscretisationCheck(0.5, NUMERICS, "mesh")
    found = with_missing_share(
        check, cast(Round, last), objective, here, objective.correction, OTHER_STEPS
    )
    if accepted and share < 1.2:
        assert found.missing == (share, 0.1) and found.needed == "mesh"
    else:
        assert found is check


def test_where_no_cause_could_be_tried_nothing_can_be_mistaken() -> None:
    found = discretisation_check(*baseline(), change(1.0), [], [])
    assert found.passed and found.along == NUMERICS
