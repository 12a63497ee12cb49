"""What a schedule of gains is worth, as sentences."""

import numpy as np

from plantfit.control.scheduling.design import ScheduleReport
from plantfit.control.tune.loop_design import LoopDesign
from plantfit.control.tune.told import percent
from plantfit.findings.verdict import Sentence

GAINS_NOTHING = 0.01  # of the plants: a single PID that keeps the wishes on as many makes a schedule needless


def schedule_told(report: ScheduleReport, design: LoopDesign, output: str) -> list[Sentence]:
    """Sentences with a level: what one PID would do at all levels, and what a step across all of them does."""
    single, unit = float(report.single[report.best_single]), design.family.model.outputs[output]
    at = f"{output} = {report.levels[report.best_single].level:.5g}{f' {unit}' if unit not in (None, '1') else ''}"
    told = [f"These are the plants that keep the wishes at each of {len(report.levels)} levels; with one PID, that of "
            f"{at}, "
            f"{percent(single)} do"]  # fmt: skip
    if single >= report.every - GAINS_NOTHING:
        found = [Sentence(level="info", sentence=f"{told[0]}: the schedule gains nothing here.")]
    else:
        found = [Sentence(level="info", sentence=f"{told[0]}.")]
    over = report.across.overshoot
    gone = float(np.mean(~np.isfinite(over)))
    if gone:
        found.append(
            Sentence(
                level="bad", sentence=f"A step across all levels does not stay finite on {percent(gone)} of the plants."
            )
        )
    else:
        high = float(np.quantile(over, 0.95, method="higher"))
        level = "info" if high <= design.wishes.overshoot else "warning"
        found.append(
            Sentence(
                level=level,
                sentence=f"In one step across all levels 95 % of the plants overshoot by at most {high:.2g} %.",
            )
        )
    return found
