from __future__ import annotations

from benchmarks.blind_cases import measured_with, stated_by, uneven
from benchmarks.blind_plan import ELASTIC, LARGE, QUIET, Kind, Trial
from benchmarks.blind_specimen import known_case


def trial(kind: Kind, truths: tuple[str, ...] = (), level: float = 0.0, b: float = 0.0) -> Trial:
    companions = (("b", b),) if b else ()
    return Trial("one", kind, truths, ((1.0,),) * len(truths), level, companions, 1)


def test_the_case_of_a_known_trial_states_its_b() -> None:
    hidden = trial("known", ("isotropic_hardening",), 2.0, b=1140.0)
    stated = stated_by(hidden, measured_with(hidden))
    assert stated.material == known_case().material.model_copy(update={"b": 1140.0})
    assert stated.loads.noise_uN == known_case().loads.noise_uN


def test_the_case_of_an_elastic_or_a_large_effect_states_its_quieter_load_cell() -> None:
    usual = known_case()
    every: list[tuple[Kind, str]] = [("known", name) for name in ELASTIC]
    every += [("large", name) for name in LARGE]
    for kind, name in every:
        hidden = trial(kind, (name,), 2.5)
        stated = stated_by(hidden, measured_with(hidden))
        assert stated.loads.noise_uN == QUIET * usual.loads.noise_uN
        assert stated.material == usual.material
        unknown = set(stated.identification.parameters) - set(usual.identification.parameters)
        assert unknown == ({"K"} if kind == "known" else set())


def test_loads_noisier_or_more_alike_than_stated_are_not_stated() -> None:
    usual = known_case()
    noisy, alike = trial("noise level", level=1.3), trial("AR(1)", level=0.7)
    assert measured_with(noisy).loads.noise_uN == 1.3 * usual.loads.noise_uN
    assert stated_by(noisy, measured_with(noisy)).loads.noise_uN == usual.loads.noise_uN
    assert measured_with(alike).loads.autocorrelation == 0.7


def test_noise_of_the_boundary_that_is_no_cause_is_stated() -> None:
    shaken = trial("jitter", level=0.3)
    assert stated_by(shaken, measured_with(shaken)).boundary.jitter_nm == 0.3


def test_noise_is_uneven_where_that_is_hidden() -> None:
    assert uneven(trial("noise", ("noise_not_uniform",), 3.0)) == 3.0
    assert uneven(trial("cause", ("load_gain",), 3.0)) == 1.0
