"""The check of the grips in words."""

from __future__ import annotations

from driver.common.formatting import joined, number, with_sigma
from driver.dic.grip_check import Estimate, GripMotion


def sentences(grip: GripMotion) -> list[str]:
    """Return what the check found: the ratio, its phases, and what is wrong or that nothing is."""
    return [_ratio(grip), _phases(grip), *(_findings(grip) or [_nothing(grip)])]


def _ratio(grip: GripMotion) -> str:
    return (
        f"The elongation of the specimen is {_share(grip.ratio)} of "
        f"the stage travel, {number(100 * grip.ratio.value / grip.nominal, 2)} % of the "
        f"{number(1e4 * grip.nominal)}·10⁻⁴ that its length over the distance of the grips makes."
        f"{_held(grip)}"
    )


def _held(grip: GripMotion) -> str:
    carries = "regularisation, which carries the stretch of the middle on to the ends."
    if grip.unpenalised:
        return f" It is read without {carries}"
    if not grip.held:
        return ""
    held = number(1e4 * grip.held * grip.ratio.value, 2)
    return f" Of its deviation ± {held}·10⁻⁴ are for {carries}"


def _phases(grip: GripMotion) -> str:
    parts = []
    for loading, name in ((True, "loading"), (False, "unloading")):
        ratio = grip.ratio_of(loading)
        if ratio is not None:
            parts.append(f"{_share(ratio)} in {name}")
    return (
        f"Phase by phase it is {joined(parts)}; the images scatter about these lines by "
        f"{number(grip.scatter)} times the noise of the correlation."
    )


def _findings(grip: GripMotion) -> list[str]:
    findings = [
        f"Between images {phase.first} and {phase.last} the elongation is no straight line: it "
        f"bows by {_nm(phase.bow)} half-way."
        for phase in grip.bowed
        if phase.bow is not None
    ]
    for turn in grip.played:
        # The line of all images is itself bent by play; those of the phases are not.
        ratio = grip.ratio_of(True) or grip.ratio
        travel = number(abs(turn.lost.value / ratio.value), 2)
        what = "lags (play)" if turn.lost.value > 0 else "runs ahead (a grip slides back)"
        findings.append(
            f"After the turn at image {turn.image} it {what} by {_nm(turn.lost)}, "
            f"{travel} µm of stage travel."
        )
    findings += [
        f"At image {slip.image} it jumps by {_nm(slip.jump)} and stays there (slip)."
        for slip in grip.slips
    ]
    if grip.outliers:
        several = len(grip.outliers) > 1
        images = joined([str(image) for image in grip.outliers])
        findings.append(
            f"Image{'s' if several else ''} {images} {'lie' if several else 'lies'} off."
        )
    return findings


def _nothing(grip: GripMotion) -> str:
    if not any(phase.bow for phase in grip.phases):
        return "There are too few images in a phase to tell play, slip or bowing."
    return "Within the noise all phases are straight, without play, slip or images that lie off."


def _share(ratio: Estimate) -> str:
    return f"({with_sigma(1e4 * ratio.value, 1e4 * ratio.sigma)})·10⁻⁴"


def _nm(estimate: Estimate) -> str:
    return f"{with_sigma(1e3 * estimate.value, 1e3 * estimate.sigma)} nm"
