from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.search.backward_elimination import eliminate
from driver.diagnosis.search.refit import with_prior
from driver.identification.fit import Fit, fit
from driver.identification.objective import Objective
from solver_adapters.parameter import Parameter
from tests.driver.analytic import formula

RNG = np.random.default_rng(5)
A = RNG.standard_normal((4, 80))
PARAMETERS = [
    Parameter("a", "", 0.0, 1.0), Parameter("p", "", 0.0, 1.0), Parameter("q", "", 0.0, 1.0),
    Parameter("r", "", 0.0, 1.0),
]  # fmt: skip
ZERO = {p.name: 0.0 for p in PARAMETERS}
CAUSES = [Cause(name, "material", (name,), "", "") for name in "pqr"]
FITTED = ("a",)  # without any cause


def with_all_causes(truth: tuple[float, ...]) -> tuple[Fit, Objective]:
    """A linear model with p, q and r free, fitted to data in which they have these values."""
    measured = np.array([0.5, *truth]) @ A + RNG.standard_normal(80)
    objective: Any = replace(
        formula(lambda p: (p @ A, A), measured, PARAMETERS),
        model=cast(Any, SimpleNamespace(null_values=lambda: ZERO)),
    )
    for cause in CAUSES:
        objective = with_prior(objective, cause)
    here = fit(objective, ZERO, ("a", "p", "q", "r"), 5)
    return here, objective


@pytest.mark.parametrize(
    ("truth", "left"),
    [((1.0, 1.0, 1.0), "pqr"), ((0.0, 1.0, 1.0), "qr"), ((0.0, 0.0, 1.0), "r")],
)
def test_what_later_causes_make_superfluous_goes_back_to_its_null(
    truth: tuple[float, ...], left: str
) -> None:
    here, objective = with_all_causes(truth)
    after, objective_after, kept = eliminate(here, objective, CAUSES, FITTED, ())
    assert "".join(cause.name for cause in kept) == left
    assert set(after.best.free) == {"a", *left} and set(objective_after.prior) == set(left)
    assert all(after.values[name] == 0.0 for name in "pqr" if name not in left)


@pytest.mark.parametrize(
    ("surpassed", "left"), [(["r"], 2), (["qr", "pr"], 3), (["pq", "p", ""], 1)]
)
def test_no_elimination_leads_back_to_a_model_to_which_evidence_has_added(
    surpassed: list[str], left: int
) -> None:
    """Neither p nor q is needed; that r, the last, is left is no way back."""
    by_name = {cause.name: cause for cause in CAUSES}
    models = [frozenset(by_name[name] for name in model) for model in surpassed]
    here, objective = with_all_causes((0.0, 0.0, 1.0))
    _, _, kept = eliminate(here, objective, CAUSES, FITTED, models)
    assert len(kept) == left and kept[-1].name == "r"


@pytest.mark.parametrize(
    "needs_r",
    [
        Cause("q", "material", ("q",), "", "", companions=("r",)),
        Cause("q", "material", ("q", "r"), "", ""),
    ],
)
def test_what_another_cause_needs_stays_free_and_a_flip_is_not_tested(needs_r: Cause) -> None:
    measured = np.array([0.5, 0.0, 1.0, 0.3]) @ A + RNG.standard_normal(80)
    objective = replace(
        formula(lambda p: (p @ A, A), measured, PARAMETERS),
        model=cast(Any, SimpleNamespace(null_values=lambda: ZERO)),
    )
    causes = [
        Cause("flip", "microstructure", (), "", ""),
        Cause("p", "material", ("p",), "", "", companions=("r",)),
        needs_r,
    ]
    for cause in causes:
        objective = cast(Any, with_prior(objective, cause))
    here = fit(objective, ZERO, ("a", "p", "q", "r"), 5)
    after, _, kept = eliminate(here, objective, causes, FITTED, ())
    assert [cause.name for cause in kept] == ["flip", "q"]
    assert after.best.free == ("a", "q", "r") and after.values["r"] != 0.0


def test_a_companion_that_is_fitted_without_any_cause_stays_fitted() -> None:
    here, objective = with_all_causes((0.0, 1.0, 2.0))
    companion = Cause("p", "material", ("p",), "", "", companions=("r",))
    causes = [companion, CAUSES[1]]
    after, objective_after, kept = eliminate(here, objective, causes, ("a", "r"), ())
    assert kept == [CAUSES[1]] and after.best.free == ("a", "q", "r")
    assert after.values["r"] == pytest.approx(2.0, abs=0.5) and "r" in objective_after.prior
