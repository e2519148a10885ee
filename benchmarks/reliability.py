"""Mutated files of unknown origin: how many end in anything but a sentence.

    python -m benchmarks.reliability --quick      ends within 45 s
    python -m benchmarks.reliability --inputs 20000

Every input is read by a process of its own with a limit of memory, so that one that ends it, or
never comes back, is counted and the study goes on.
"""

from __future__ import annotations

import argparse
import json
import resource
import select
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from tools.mutated_files import KINDS, fault_of, mutated, seconds_of

_LONGEST = 10.0  # s of the processor, for one file
_LOADED = 10.0  # of the clock so many times it, on a loaded machine
_MEMORY = 2_000_000_000  # bytes beside what the process has when it begins
_START = 300.0  # s
_QUICK = 30.0  # s


@dataclass(frozen=True)
class Outcome:
    """What became of an input.

    Attributes:
        kind: of the file.
        seed: of its damage.
        fault: "" where it was read, or refused in a sentence.
        seconds: of the processor that it took.
    """

    kind: str
    seed: int
    fault: str
    seconds: float


def outcomes(inputs: int, seconds: float) -> Iterator[Outcome]:
    """Yield what becomes of inputs, of all kinds in turn.

    Args:
        inputs: how many.
        seconds: after which no further one is begun.
    """
    begin, number = perf_counter(), 0
    while number < inputs and perf_counter() - begin < seconds:
        with subprocess.Popen(
            [sys.executable, "-m", "benchmarks.reliability", "--from", str(number)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        ) as worker:  # fmt: skip
            _answer(worker, _START)
            while number < inputs and perf_counter() - begin < seconds:
                kind, seed = _input(number)
                number += 1
                start, before = perf_counter(), seconds_of(worker.pid)
                answer = _answer(worker, _LOADED * _LONGEST)
                if not answer:
                    late = perf_counter() - start >= _LOADED * _LONGEST
                    worker.kill()
                    code = worker.wait()
                    fault = "never came back" if late else f"ended by {code}"
                    yield Outcome(KINDS[kind].name, seed, fault, perf_counter() - start)
                    break
                spent = max(seconds_of(worker.pid) - before, 0.0)
                fault = json.loads(answer) or ("longer than 10 s" if spent > _LONGEST else "")
                yield Outcome(KINDS[kind].name, seed, fault, spent)
            worker.kill()


def _input(number: int) -> tuple[int, int]:
    return number % len(KINDS), number // len(KINDS)


def _answer(worker: subprocess.Popen[str], seconds: float) -> str:
    """Ask the worker for its next line; "" where it has ended or takes too long."""
    assert worker.stdin is not None and worker.stdout is not None
    try:
        worker.stdin.write("\n")
        worker.stdin.flush()
    except BrokenPipeError:
        return ""
    ready, _, _ = select.select([worker.stdout], [], [], seconds)
    return worker.stdout.readline() if ready else ""


def work(number: int) -> None:
    """Read an input for each line that is asked for, from a number on."""
    warnings.simplefilter("error")
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + _MEMORY
    sys.stdin.readline()
    print("ready", flush=True)
    for _ in sys.stdin:
        kind, seed = KINDS[_input(number)[0]], _input(number)[1]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / kind.file
            path.write_bytes(mutated(kind.content(), seed))
            resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
            print(json.dumps(fault_of(kind, path)), flush=True)
        number += 1


def main() -> None:
    """Run the study, or one process of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="end within 45 s")
    parser.add_argument("--inputs", type=int, default=20_000)
    parser.add_argument("--from", type=int, dest="first", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.first is not None:
        work(arguments.first)
        return
    found = list(outcomes(arguments.inputs, _QUICK if arguments.quick else float("inf")))
    faults = [each for each in found if each.fault]
    for each in faults[:20]:
        print(f"{each.kind}, seed {each.seed}: {each.fault}")
    for kind, count in Counter(each.kind for each in found).items():
        worst = max(each.seconds for each in found if each.kind == kind)
        print(f"{kind}: {count} inputs, the slowest in {worst:.2f} s")
    print(f"mutated inputs = {len(found)}")
    print(f"mutated inputs that ended in anything but a sentence = {len(faults)} (goal: <= 0)")
    slowest = max(each.seconds for each in found)
    print(f"slowest mutated input [s] = {slowest:.2f} (goal: <= {_LONGEST:g})")


if __name__ == "__main__":
    main()
