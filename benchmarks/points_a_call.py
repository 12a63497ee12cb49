"""`python -m benchmarks.points_a_call`: whole fits whose searches evaluate four points with derivatives in a call, and
eight, as before.

Fit and verdict of the motor on its bench (2963 residuals), the heaters (571 samples) and the gear motor (2047), with
warm caches, in turns, three seeds.
"""

import tempfile
import time
from pathlib import Path
from unittest import mock

import plantfit as pf
from plantfit.cases.motor.bench import bench
from plantfit.cases.shared.files import unpack
from plantfit.optimize.loop import counter
from plantfit.problem.evaluate import points
from plantfit.recording import to_csv

WIDTHS, SEEDS = (8, counter.TOGETHER), (2, 3, 4)
STUDIES = ("motor/current", "heater/first_order", "heater/two_heaters", "gearmotor/gearmotor")


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures: processor time with four points over that with eight, by study."""
    figures = {}
    print(f"{'s of processor time':28}" + "".join(f"{f'{w} points':>12}" for w in WIDTHS) + f"{'ratio':>8}")
    with tempfile.TemporaryDirectory() as place:
        for case in dict.fromkeys(s.split("/")[0] for s in STUDIES):
            unpack(case, Path(place) / case)
        to_csv(bench(1).recording, Path(place) / "motor" / "motor.csv")
        for study in STUDIES[:2] if quick else STUDIES:
            found: dict[int, list[float]] = {w: [] for w in WIDTHS}
            for seed in (1, *SEEDS):  # the first compiles
                for width, times in found.items():
                    times.append(_seconds(Path(place) / f"{study}.toml", width, seed))
            least = [min(found[w][1:]) for w in WIDTHS]
            print(f"{study:28}" + "".join(f"{s:12.2f}" for s in least) + f"{least[1] / least[0]:8.2f}")
            figures[f"points_a_call_{study.split('/')[1]}"] = least[1] / least[0]
    return figures


def _seconds(file: Path, width: int, seed: int) -> float:
    problem = pf.load(file).problem
    with mock.patch.object(counter, "TOGETHER", width), mock.patch.object(points, "WIDTH", width):
        began = time.process_time()
        _ = pf.fit(problem, seed=seed).findings
        return time.process_time() - began


if __name__ == "__main__":
    run(False)
