"""pyhms in a Python of its own (numpy < 2), its costs asked for through pipes: `python -m benchmarks.steam.pyhms_worker
SEED REPAIRED BUDGET DIMENSION`.

Requests on stdout: the number of points (int64), the points; answers on stdin: the costs. At the end: -1, own processor
seconds.
"""

import os
import struct
import sys
import time
import warnings
from typing import Any, BinaryIO

import numpy as np

from benchmarks.bbob.pyhms_worker import start
from benchmarks.bbob.suite import Done, Problem, Run


class Piped(Run):
    """A run whose costs another process computes."""

    ask: BinaryIO
    answer: BinaryIO

    def costs(self, x: Any) -> np.ndarray:
        x = np.ascontiguousarray(x, dtype=float)
        if self.done:
            raise Done
        here = x[: self.remaining]
        self.ask.write(struct.pack("q", len(here)) + here.tobytes())
        self.ask.flush()
        f = np.frombuffer(self.answer.read(8 * len(here)))
        self._record(f)
        if len(here) < len(x):
            raise Done
        return f


def main() -> None:
    seed, repaired, budget, dimension = map(int, sys.argv[1:5])
    pipe = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what pyhms prints must not mix with the requests
    warnings.simplefilter("ignore")

    def elsewhere(x: Any) -> float:
        raise TypeError("The costs are computed in another process.")

    run = Piped(Problem(0, dimension, 0, 0.0, elsewhere), budget)
    run.ask, run.answer = pipe, sys.stdin.buffer
    began = time.process_time()
    for attempt in range(100):
        before = run.evaluations
        try:
            start(run, seed + attempt, bool(repaired))
        except Done:
            break
        if run.done or run.evaluations == before:
            break
    pipe.write(struct.pack("qd", -1, time.process_time() - began))
    pipe.flush()


if __name__ == "__main__":
    main()
