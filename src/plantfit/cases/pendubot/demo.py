"""The pendubot on a virtual rig: the paper's study, small or whole."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.cases.pendubot.better_study import better_study
from plantfit.cases.pendubot.paper_study import PaperStudy, paper_study
from plantfit.cases.pendubot.torque import torque_record, write_record
from plantfit.cases.shared.files import unpack
from plantfit.cases.shared.fitting import fit_file
from plantfit.cases.shared.record import figure, record

TITLE = "Pendubot on a virtual rig"
SMALL, WHOLE = (60, 20, 20), (1000, 100, 1000)  # runs of PSO, CGA and SSA each; of what they are compared with; on the calm record


def run(folder: str | Path, progress: Callable[[Any], None] | None = None, full: bool = False) -> dict[str, Any]:
    """See `plantfit.cases.shared.registry.demos`; `full` makes 1000 runs of each method instead of 60."""
    folder = unpack("pendubot", folder)
    file, made = folder / "torque.toml", torque_record()
    write_record(made, folder)
    study = paper_study(file, made, *(WHOLE if full else SMALL), progress)
    answer = fit_file(file, progress, "least_squares")
    return record(
        "pendubot",
        TITLE,
        _figures(study),
        _sentences(study),
        [answer],
        [file],
        subtitle="The paper's three metaheuristics, each run many times, against the optimum that least squares finds at once.",
        sections=[*study.sections[:-1], *better_study(progress, full), study.sections[-1]],
    )


def _figures(study: PaperStudy) -> list[dict[str, Any]]:
    found = [figure("RMSE of the constrained optimum", study.floor.rmse, "N*m")]
    for r in study.tuned.values():
        found.append(figure(f"{r.label}: median relative gap to it", float(np.median(r.gap)), None))
        found.append(figure(f"{r.label}: runs within 0.1 % of it", 100 * r.share_close[0], "%", 99.0, "asked for"))
    share = study.least_squares.share_close[0]
    found.append(figure("bounded least squares: runs within 0.1 % of it", 100 * share, "%", 100.0, "asked for"))
    return found


def _sentences(study: PaperStudy) -> list[str]:
    total = sum(r.total_seconds for r in study.tuned.values())
    count = sum(len(r.gap) for r in study.tuned.values())
    return [
        f"{count} runs of PSO, CGA and SSA with 10 000 evaluations each took {total:.0f} s on the virtual rig's record.",
        *study.floor.sentences,
    ]
