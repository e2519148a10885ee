"""Variants of an experiment: the one of the case, and it with a change each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from driver.case.changes import changed_case, label, merged
from driver.case.messages import sentences
from driver.case.model import Case
from driver.common.errors import InputError, sentence
from driver.design.settings import Schedule, Settings
from driver.diagnosis.causes.user_causes import asked_causes
from driver.experiment.orientations import grain_orientations

_TURN = 30.0  # ° about the normal of the face, of the last grain
# Tables of the case that a simulation does not depend on; of the images, the noise alone.
_BESIDE_THE_SIMULATION = frozenset(
    {"loads", "sections", "dic", "identification", "diagnosis", "execution"}
)


@dataclass(frozen=True)
class Variant:
    """An experiment that could be made.

    Attributes:
        name: what it is called, in a few words.
        change: the keys that differ from the experiment of the case, in one line.
        case: its case.
        test: its test, against the history of the case.
    """

    name: str
    change: str
    case: Case
    test: Schedule

    def simulated_as(self, other: Variant) -> bool:
        """Whether the simulation of another one serves, for only noise and weights differ."""
        return (
            _simulated(self.case) == _simulated(other.case)
            and self.test.stops == other.test.stops
            and self.test.holds == other.test.holds
            and self.test.compression == other.test.compression
        )


def base_variant(case: Case, settings: Settings) -> Variant:
    """Return the experiment of the case."""
    return Variant("as the case", "", case, settings.test)


def usual_changes(case: Case, test: Schedule, n_repeats: int) -> dict[str, dict[str, Any]]:
    """Return what anyone would ask, by name; the ones that need no simulation first.

    Args:
        case: the case.
        test: its test.
        n_repeats: images averaged into its reference.

    Raises:
        OrientationError: an EBSD map cannot be used.
    """
    last = len(case.grains)
    phi1, *others = grain_orientations(case)[-1].euler_deg
    turned = [(phi1 + _TURN) % 360.0, *others]
    return {
        "two images a stop": {"test": {"images_per_stop": 2 * test.images_per_stop}},
        "half the load noise": {"loads": {"noise_uN": case.loads.noise_uN / 2}},
        "half the height noise": {"images": {"noise_nm": case.images.noise_nm / 2}},
        "twice the repeats": {"test": {"repeats": 2 * n_repeats}},
        "an exact simulation": {"test": {"exact_simulation": True}},
        "twice the stops": {"test": {"stops": 2 * test.stops}},
        "holds ten times longer": {"test": {"holds": 10.0 * test.holds}},
        "a leg of compression": {"test": {"compression": True}},
        f"grain {last} turned by {_TURN:g}°": {"grains": {str(last): {"euler_deg": turned}}},
    }


def variant(base: Variant, name: str, change: dict[str, Any], path: Path) -> Variant:
    """Return an experiment with a change.

    Args:
        base: the experiment of the case.
        name: what the change is called.
        change: nested keys of the case, and of the table `test`.
        path: where the change stands, to be told.

    Raises:
        InputError: a key is unknown or out of range, or not one of an experiment with images; or a
            file of causes cannot be used.
    """
    keys = {key: value for key, value in change.items() if key != "test"}
    case = changed_case(base.case, keys, path, name)
    tests = {"test": merged(base.test.model_dump(), change.get("test", {}))}
    try:
        test = Settings.model_validate(tests).test
    except ValidationError as error:
        raise InputError(sentences(path, Settings, tests, error)) from None
    if case.history != base.case.history:
        expected = ", ".join(f"test.{key}" for key in Schedule.model_fields)
        raise InputError(
            f"{path}: history: found a change of it, expected one of the test: {expected}"
        )
    refuse_without_images(case, path)
    asked_causes(case, path)
    return Variant(name, label(change), case, test)


def refuse_without_images(case: Case, path: Path | None = None) -> None:
    """Refuse a case of which nothing that images tell will be known.

    Raises:
        InputError: it has no images.
    """
    if not case.with_images:
        expected = '"images": a design counts on them'
        raise InputError(sentence(path or case.file, "boundary.motion", '"stage"', expected))


def variants(
    base: Variant,
    usual: dict[str, dict[str, Any]],
    named: dict[str, dict[str, Any]],
    given: Sequence[dict[str, Any]],
    path: Path,
) -> list[Variant]:
    """All variants, those that change nothing left out.

    Args:
        base: the experiment of the case.
        usual: what anyone would ask, by name.
        named: changes of the settings, by name.
        given: changes of the command line.
        path: the file of the settings.
    """
    changed = [variant(base, name, change, path) for name, change in (usual | named).items()]
    changed += [variant(base, label(change), change, Path("--change")) for change in given]
    return [
        candidate
        for candidate in changed
        if (candidate.case, candidate.test) != (base.case, base.test)
    ]


def _simulated(case: Case) -> dict[str, Any]:
    whole = case.model_dump(mode="json", exclude=set(_BESIDE_THE_SIMULATION))
    whole["images"]["noise_nm"] = 0.0
    return whole
