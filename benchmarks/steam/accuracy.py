"""`python -m benchmarks.steam.accuracy`: largest error in bar of both schemes against Radau, with 1, 2 and 4 steps a
sample."""

import numpy as np

from benchmarks.data import Steam, steam
from benchmarks.steam.reference import reference, worst_error
from benchmarks.steam.twin import Scheme, twin

TARGET = 1e-3  # bar
VECTORS, SEED = 20, 1
SCHEMES: tuple[Scheme, ...] = ("exponential", "ros2")


def candidates(data: Steam) -> np.ndarray:
    """The truth and 20 vectors even over the box, (21, 310)."""
    return np.vstack([data.truth.ravel(), data.draw(VECTORS, SEED)])


def errors(data: Steam, scheme: Scheme, substeps: int) -> tuple[float, float, float] | None:
    """At the truth; the largest over the random vectors; their median. None without a C compiler."""
    engine = twin(data, scheme, substeps)
    if engine is None:
        return None
    each = [worst_error(data, [theta], [engine.responses(theta)]) for theta in candidates(data)]
    return each[0], max(each[1:]), float(np.median(each[1:]))


def run() -> None:
    """Print the table."""
    data = steam()
    swing = max(float(np.nanmax(np.abs(reference(data, theta)))) for theta in candidates(data))
    print(f"largest |error| in bar against Radau at rtol 1e-9; responses reach {swing:.0f} bar")
    print(f"{'scheme':14}{'steps a sample':>16}{'truth':>12}{'20 random':>12}{'median':>12}")
    for scheme in SCHEMES:
        enough = None
        for substeps in (1, 2, 4, 8):
            found = errors(data, scheme, substeps)
            if found is None:
                print("skipped: no C compiler, and apt could not bring one")
                return
            print(f"{scheme:14}{substeps:16d}" + "".join(f"{e:12.1e}" for e in found))
            if enough is None and max(found) < TARGET:
                enough = substeps
        print(
            f"{scheme}: {'more than 8' if enough is None else enough} "
            f"steps a sample keep every error under {TARGET:g} bar"
        )


if __name__ == "__main__":
    run()
