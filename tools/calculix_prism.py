"""The two-grain prism that CalculiX 2.20 solved: reference, deck, and the same for prismid.

CalculiX loads along its z axis; its frame turns into the specimen frame by x → X, z → Y, −y → Z.

    python -m tools.calculix_prism    recompute the limit of small steps (3 CPU-minutes)
"""

from __future__ import annotations

import os
import re
import resource
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshes.arrays import FloatArray, IntArray
from meshes.prism_mesh import PrismMesh
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.crystal import bunge_matrix
from solver_adapters.interface import Integration, Simulation
from solver_adapters.material import Material

REFERENCE = Path(__file__).parents[1] / "tests" / "data" / "solver" / "calculix_prism.npz"
TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Rotation from CalculiX's frame to the specimen frame."""
CORNERS = (0.0, 10.0, 14.0, 28.0)
PULLED = (0.0, 0.12, 0.072, 0.24)
"""Instants [s] at which the loading turns, and the displacement of the upper end there [µm]."""
# Bunge matrices are said in CalculiX's frame, whose third axis is the axis of loading.
ORIENTATIONS = TURN @ np.stack([bunge_matrix(281, 8, 47), bunge_matrix(211, 45, 150)])
# CalculiX has no {112} systems (and switches its cube systems off by the same number).
MATERIAL = Material(tau0_112=1e9, strain_measure="small")


@dataclass(frozen=True, eq=False)
class Reference:
    """What CalculiX answered, in the specimen frame.

    Attributes:
        mesh: the prism of 484 cells [µm].
        times: its instants [s], shape (n_times,).
        force: reaction along Y [µN], shape (n_times,).
        front: nodes of the free face Z = 0, shape (n_front,).
        instants: instants of the stored displacements [s], shape (n_instants,).
        displacement: displacement of the nodes `front` [µm], shape (n_instants, n_front, 3).
        fine_times: instants of the converged force [s], shape (n_fine,).
        fine_force: prismid's own force along Y in the limit of small steps [µN], shape (n_fine,).
    """

    mesh: PrismMesh
    times: FloatArray
    force: FloatArray
    front: IntArray
    instants: FloatArray
    displacement: FloatArray
    fine_times: FloatArray
    fine_force: FloatArray


def read_reference() -> Reference:
    """Read the stored run and turn it into the specimen frame."""
    with np.load(REFERENCE) as data:
        bottom, top, front = (data[name].astype(np.int64) for name in ("BOT", "TOP", "FRONT"))
        mesh = PrismMesh(
            points=data["points"] @ TURN.T,
            cells=data["cells"].astype(np.int64),
            grain=data["grain"].astype(np.int64),
            faces={},
            nodes={"S_MINUS": np.sort(bottom), "S_PLUS": np.sort(top)},
        )
        return Reference(
            mesh=mesh,
            times=data["times"],
            force=data["force"],
            front=front,
            instants=data["instants"],
            displacement=data["displacement"].astype(np.float64) @ TURN.T,
            fine_times=data["fine_times"],
            fine_force=data["fine_force"],
        )


def simulation(
    mesh: PrismMesh, times: FloatArray, integration: Integration, steps: int = 1
) -> Simulation:
    """Return the same loading for prismid: lower end clamped, upper end moved along Y alone.

    Args:
        mesh: the prism.
        times: instants of the answer [s], the first one 0, with the corners among them.
        integration: how the law is integrated; CalculiX uses backward Euler.
        steps: time steps between two of them.
    """
    low, high = mesh.nodes["S_MINUS"], mesh.nodes["S_PLUS"]
    motion = np.zeros((len(times), len(low) + len(high), 3))
    motion[:, len(low) :, 1] = np.interp(times, CORNERS, PULLED)[:, None]
    return Simulation(
        mesh=mesh,
        material=MATERIAL,
        orientations=ORIENTATIONS,
        times=times,
        motion_nodes=np.concatenate([low, high]),
        motion_mask=np.ones((motion.shape[1], 3), dtype=np.bool_),
        motion=motion,
        output=np.arange(len(times)),
        output_nodes=np.arange(len(mesh.points)),
        steps_per_interval=steps,
        integration=integration,
    )


def limit_of_small_steps(mesh: PrismMesh) -> tuple[FloatArray, FloatArray]:
    """Force along Y [µN] by Richardson's extrapolation of backward Euler, and its instants [s].

    Steps of 25 and 12.5 ms; the extrapolated force is off by some 0.1 µN.
    """
    times = np.linspace(0.0, CORNERS[-1], 281)
    coarse, fine = (
        BundledAdapter().solve(simulation(mesh, times, "backward_euler", steps)).force
        for steps in (4, 8)
    )
    return times, 2 * fine - coarse


def graded_times(steps: int) -> FloatArray:
    """Instants of a run in about `steps` steps, dense where flow sets in, shape (n_times,).

    A segment begins with one elastic step; the steps after it grow linearly. The segments get as
    many steps each.
    """
    elastic = (0.4, 0.9, 0.9)  # s; flow begins after it
    share = np.linspace(0.0, 1.0, round(steps / 3)) ** 2
    starts = np.array(CORNERS[:-1]) + elastic
    segments = [
        start + (end - start) * share for start, end in zip(starts, CORNERS[1:], strict=True)
    ]
    return np.concatenate([[0.0], *segments])


def write_deck(mesh: PrismMesh, path: Path, end: float) -> None:
    """Write the CalculiX deck of the reference (less its displacement output) up to an instant.

    Each monotonic segment is a *STEP of its own, or CalculiX starts a reversal from a stale state.

    Args:
        mesh: the prism [µm], in the specimen frame.
        path: the .inp file.
        end: instant at which the deck ends [s].
    """
    lines = ["*NODE,NSET=NALL"]
    lines += [_row(n, *point) for n, point in enumerate(mesh.points @ TURN, start=1)]
    for grain in range(mesh.n_grains):
        lines.append(f"*ELEMENT,TYPE=C3D10,ELSET=GRAIN{grain + 1}")
        cells = np.flatnonzero(mesh.grain == grain)
        lines += [_row(int(cell) + 1, *(mesh.cells[cell] + 1)) for cell in cells]
    for name, group in (("BOT", "S_MINUS"), ("TOP", "S_PLUS")):
        lines += [f"*NSET,NSET={name}", *(f"{node + 1}," for node in mesh.nodes[group])]
    for grain, rotation in enumerate(ORIENTATIONS, start=1):
        axes = (TURN.T @ rotation).T
        lines += [f"*ORIENTATION,NAME=OR{grain},SYSTEM=RECTANGULAR", _row(*axes[0], *axes[1])]
    lines.append(_MATERIAL)
    lines += ["*AMPLITUDE,NAME=A1,TIME=TOTAL TIME"]
    lines += [_row(*corner) for corner in zip(CORNERS, PULLED, strict=True)]
    for index, (first, largest) in enumerate(((0.5, 0.7), (0.1, 0.4), (0.1, 0.7))):
        length = min(CORNERS[index + 1], end) - CORNERS[index]
        if length > 0:
            lines.append(_STEP.format(first=first, length=length, largest=largest))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def run_calculix(deck: Path) -> tuple[FloatArray, FloatArray, float]:
    """Run `ccx` on one thread.

    Returns:
        its instants [s] and the force along the axis [µN], both with the start, and its CPU time
        [s].

    Raises:
        RuntimeError: the run did not reach its end.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = os.environ | {"OMP_NUM_THREADS": "1", "CCX_NPROC_STIFFNESS": "1"}
    done = subprocess.run(
        ["ccx", "-i", deck.stem], cwd=deck.parent, env=environment, capture_output=True, text=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if "Job finished" not in done.stdout:
        raise RuntimeError(f"ccx did not finish; it ends with: {done.stdout[-300:]}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    printed = deck.with_suffix(".dat").read_text(encoding="utf-8")
    rows = re.findall(r"and time\s+(\S+)\s+(\S+)\s+(\S+)\s+(\S+)", printed)
    times, _, _, force = np.array(rows, dtype=np.float64).T
    return np.append(0.0, times), np.append(0.0, force), cpu


def _row(*values: float) -> str:
    return ",".join(f"{value:.12g}" for value in values)


# C11, C12, C44; K, n, c, d, φ, δ, r0, Q, b of the octahedral systems, then of the cube systems.
_MATERIAL = """\
*MATERIAL,NAME=SINGLE_CRYSTAL
*USER MATERIAL,CONSTANTS=21
233500,135500,118000,12,10,40000,1500,1.
0.,40,1.E-6,1.,100.,10.,1.,1.
1.,0.,1.E9,1.E-6,1.
*DEPVAR
60
*SOLID SECTION,ELSET=GRAIN1,MATERIAL=SINGLE_CRYSTAL,ORIENTATION=OR1
*SOLID SECTION,ELSET=GRAIN2,MATERIAL=SINGLE_CRYSTAL,ORIENTATION=OR2
*BOUNDARY
BOT,1,3
TOP,1,2"""
_STEP = """\
*STEP,INC=100000
*STATIC
{first},{length:.12g},1.E-5,{largest}
*BOUNDARY,AMPLITUDE=A1
TOP,3,3,1.
*NODE PRINT,NSET=TOP,TOTALS=ONLY,FREQUENCY=1
RF
*END STEP"""


def main() -> None:
    """Replace prismid's own limit of small steps beside the stored run of CalculiX."""
    with np.load(REFERENCE) as data:
        stored = dict(data)
    stored["fine_times"], stored["fine_force"] = limit_of_small_steps(read_reference().mesh)
    np.savez_compressed(REFERENCE, **stored)


if __name__ == "__main__":
    main()
