"""What is said of a fit to loads alone, which no diagnosis follows."""

from __future__ import annotations

from driver.identification.loads_alone import doubts


def test_loads_that_the_model_does_not_carry_and_a_fit_that_did_not_end_are_told() -> None:
    misfit, ended = (doubts(65.2, 23, True), doubts(0.9, 23, False))
    assert misfit == (
        "χ_F 65.20 is more than noise makes (1 ± 0.15): the model does not carry these loads, and "
        "the uncertainties do not count that",
    )
    assert len(ended) == 1 and "has not converged" in ended[0]
    assert doubts(1.5, 23, True) == ()
