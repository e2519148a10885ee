"""Hidden effects of six kinds in a bar of three grains of copper: what a diagnosis says of each.

    python -m benchmarks.three_grains FOLDER [EFFECT ...]    # all of them if none is named

Each is an experiment of its own from `prismid virtual`, whose truth has hexahedra of half a
micrometre and of two thirds, extrapolated, in three time steps an interval, and a run of the stages
on a case that knows nothing of it. A folder that is there is not made again.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

from driver.case.model import CASE_FILE, write_case
from driver.common.progress import progress_to
from driver.results.files import DIAGNOSIS
from driver.virtual.command import virtual
from driver.workflow.pipeline import run
from tools.three_grains import three_grains

EFFECTS: dict[str, dict[str, float]] = {
    "grain3_contrast": {"tau0_grain3": 1.4},
    "nothing": {},
    "misorientation_grain2": {"rotation_grain2_x": 0.087},
    "boundary2_position": {"boundary2_shift": 1.0},
    "load_offset": {"load_offset": 120.0},
    "band_grain3": {
        "tau0_grain3_band": -0.5,
        "tau0_grain3_band_middle": 0.1,
        "tau0_grain3_band_half_width": 0.3,
    },
    "heterogeneity_grain3": {"tau0_grain3_slope_Y": 0.4},
}
"""Parameters and truths of a cause, in internal units; the first one is told."""
SETTINGS = """
[microscope]
bits = 16
noise_nm = 4.5
[program]
cycles = [[12, 3], [12, 3]]
largest_strain = 0.015
[discretisation]
mesh_size_um = 0.5
[truth]
tau0 = 25.0
c = 44e3
d = 1140.0
lambda_plus_Y = 0.85
"""


def answer(folder: Path, effect: str) -> dict[str, Any]:
    """Return what `diagnosis.json` says of an experiment with an effect, made where it is not."""
    data = folder / "experiment"
    if not data.exists():
        folder.mkdir(parents=True, exist_ok=True)
        case = three_grains(
            specimen={"mesh_size_um": 1.34, "fine_mesh_size_um": 0.667},
            material={"strain_measure": "small"},
            diagnosis={"held_out_cycle": "none"},
            execution={"processes": 1},
        )
        write_case(case, folder / CASE_FILE)
        told = "".join(f"{name} = {value}\n" for name, value in EFFECTS[effect].items())
        settings = folder / "settings.toml"
        settings.write_text(SETTINGS.lstrip() + told, encoding="utf-8")
        virtual(folder / CASE_FILE, settings, data, 1 + list(EFFECTS).index(effect))
    run(data / CASE_FILE, "diagnose")
    found: dict[str, Any] = json.loads((data / "results" / DIAGNOSIS).read_text("utf-8"))
    return found


def told(effect: str, found: dict[str, Any]) -> str:
    """Return a line on what was hidden, what was answered, and how large it is said to be."""
    hidden, first = EFFECTS[effect], found["steps"][0]
    causes = ", ".join(found["causes"]) or "none"
    line = f"{effect}: {found['verdict']} ({causes})"
    if not hidden:
        return line
    name, truth = next(iter(hidden.items()))
    (scored,) = (cause for cause in first["causes"] if cause["cause"] == effect)
    visible = scored["smallest_visible"][0]
    line += f"; truth {name} = {truth:g}, smallest that would have been seen {visible:.2g}"
    size = found["extended"]["values"].get(name)
    return line if size is None else f"{line}; found {size['value']:.4g} ± {size['sigma']:.2g}"


def main() -> None:
    """Print a line for each effect."""
    folder, *asked = sys.argv[1:]
    with progress_to(lambda line: print(line, file=sys.stderr, flush=True)):
        for effect in asked or EFFECTS:
            started = time.process_time()
            found = answer(Path(folder) / effect, effect)
            print(f"{told(effect, found)}; {time.process_time() - started:.0f} CPU-s", flush=True)


if __name__ == "__main__":
    main()
