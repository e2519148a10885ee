"""A design as it is written."""

from __future__ import annotations

from collections.abc import Sequence

from driver.design.comparison import gain
from driver.design.detectability import NAMED_AT
from driver.design.forecast import Forecast
from driver.results.design import Design, PlannedExperiment


def design_of(base: Forecast, surface: str, noise: float, others: Sequence[Forecast]) -> Design:
    """Return what is written of forecasts.

    Args:
        base: the experiment of the case.
        surface: where its surface comes from.
        noise: of an image at a pixel [µm].
        others: the changed experiments.
    """
    return Design(
        surface=surface,
        noise=noise,
        load_noise=base.variant.case.loads.noise_uN,
        named_at=NAMED_AT,
        experiment=_experiment(base),
        changes=tuple((_experiment(other), gain(base, other)) for other in others),
    )


def _experiment(forecast: Forecast) -> PlannedExperiment:
    return PlannedExperiment(
        name=forecast.variant.name,
        change=forecast.variant.change,
        n_images=forecast.n_images,
        duration=forecast.duration,
        elongation=forecast.elongation,
        load=forecast.load,
        parameters=forecast.parameters,
        causes=forecast.causes,
    )
