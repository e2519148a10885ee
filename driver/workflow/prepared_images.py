"""Images and loads of a case, read and corrected once a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from driver.common.errors import InputError, sentence
from driver.dic.surface_images import SurfaceImages
from driver.experiment.images.files import matches
from driver.experiment.reading import Experiment, read_experiment
from driver.forward.build import surface_images
from driver.workflow.engine import StageContext, measured_files

_NAME = "images"


@dataclass(frozen=True, eq=False)
class PreparedImages:
    """What was measured.

    Attributes:
        experiment: history, loads and height maps as they were read.
        images: the corrected images over the region of interest.
        files: state of the files that they come from: path, time of change [ns] and size [bytes].
    """

    experiment: Experiment
    images: SurfaceImages
    files: tuple[tuple[Path, int, int], ...]


def prepared_images(context: StageContext) -> PreparedImages:
    """Return what an earlier stage of the run has read, or read it.

    Raises:
        InputError: a file cannot be used, or has changed since an earlier stage read it.
    """
    files = _state(context)
    known = context.memory.get(_NAME)
    if isinstance(known, PreparedImages):
        if changed := sorted({file for file, _, _ in set(files) ^ set(known.files)}):
            found, expected = "another content than this run has read", "the same: run again"
            raise InputError(sentence(changed[0], "file", found, expected))
        return known
    experiment = read_experiment(context.case)
    read = PreparedImages(experiment, surface_images(context.case, experiment), files)
    context.memory[_NAME] = read
    return read


def _state(context: StageContext) -> tuple[tuple[Path, int, int], ...]:
    """Return the state of the measured files; of a folder or pattern that of each file."""
    states = []
    for path in measured_files(context.case):
        each = [path]
        if not path.is_file():
            each = sorted(matches(path))
        states += [(file, file.stat().st_mtime_ns, file.stat().st_size) for file in each]
    return tuple(states)
