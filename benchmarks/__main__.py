"""`python -m benchmarks`: all timings; QUICK=1 keeps them to about two minutes."""

import os
import sys
import time

from benchmarks import engine, motor, pid, reading, small_fit, startup, switching, torque
from benchmarks.steam import table


def main() -> int:
    quick = os.environ.get("QUICK", "") not in ("", "0")
    started = time.perf_counter()
    figures: dict[str, float] = {}
    for part in (engine, table, pid, torque, motor, switching, startup, small_fit, reading):
        figures |= part.run(quick)
        print()
    for name, value in figures.items():
        print(f"FIGURE {name} {value:.4g}")
    print(f"done in {time.perf_counter() - started:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
