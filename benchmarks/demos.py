"""`python -m benchmarks.demos OTHER [NAME ...]`: how long small demos take over an earlier checkout, `OTHER`, of the
project.

    git worktree add /tmp/earlier 01ab40f8
    python -m benchmarks.demos /tmp/earlier pendubot motor steam

Both versions make the same demo one after the other, in this Python, each in a home of its own, which is empty, so that
the time of compiling counts; time is that of the command, processor time that of all its processes.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

HERE = Path(__file__).resolve().parent.parent
NAMES = ("pendubot", "motor", "steam")


class Took(NamedTuple):
    """Seconds of a command, and of the processors."""

    time: float
    processor: float


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", type=Path, help="folder of the other version")
    parser.add_argument("names", nargs="*", default=NAMES)
    parser.add_argument("--pairs", type=int, default=1)
    options = parser.parse_args()
    for name in options.names:
        pairs = np.array([[demo(options.other, name), demo(HERE, name)] for _ in range(options.pairs)])
        before, now = np.median(pairs, axis=0)
        ratio = np.median(pairs[:, 1] / pairs[:, 0], axis=0)
        print(
            f"{name}: {before[0]:.1f} s before, {now[0]:.1f} s now, ratio {ratio[0]:.2f}; processor time "
            f"{before[1]:.1f} s before, {now[1]:.1f} s now, ratio {ratio[1]:.2f}",
            flush=True,
        )
    return 0


def demo(version: Path, name: str) -> Took:
    """One run of a demo by the code in a folder."""
    with tempfile.TemporaryDirectory() as home:
        kept = {k: v for k, v in os.environ.items() if k not in ("XDG_CACHE_HOME", "XLA_FLAGS")}
        surroundings = kept | {"HOME": home, "PYTHONPATH": str(version / "src")}
        command = [sys.executable, "-m", "plantfit", "demo", name]
        began, before = time.perf_counter(), _processors()
        subprocess.run(command, env=surroundings, cwd=home, check=True, capture_output=True)
        return Took(time.perf_counter() - began, _processors() - before)


def _processors() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    sys.exit(main())
