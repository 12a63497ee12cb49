"""The pendubot on a virtual rig: the paper's study, small or whole."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.cases.pendubot.better_study import better_study, next_experiment
from plantfit.cases.pendubot.paper_study import PaperStudy, paper_study
from plantfit.cases.pendubot.torque import torque_record, write_record
from plantfit.cases.shared.beside import Beside
from plantfit.cases.shared.files import unpack
from plantfit.cases.shared.fitting import fit_file
from plantfit.cases.shared.record import figure, record

TITLE = "Pendubot on a virtual rig"
# runs of PSO, CGA and SSA each; of what they are compared with; on the calm record
SMALL, WHOLE = ((60, 20, 20), (1000, 100, 1000))


def run(folder: str | Path, progress: Callable[[Any], None] | None = None, full: bool = False) -> dict[str, Any]:
    """See `plantfit.cases.shared.registry.demos`; `full` makes 1000 runs of each method instead of 60."""
    folder = unpack("pendubot", folder)
    file, made = folder / "torque.toml", torque_record()
    write_record(made, folder)
    with Beside(better_study, full) as beside:
        study = paper_study(file, made, *(WHOLE if full else SMALL), progress)
        answer = fit_file(file, progress, "least_squares")
        following = next_experiment(full)
        better = beside.result(progress)
    return record(
        "pendubot",
        TITLE,
        _figures(study),
        _sentences(study),
        [answer],
        [file],
        subtitle="The paper's three metaheuristics, each run many times, against the optimum that least squares finds "
        "at once.",
        sections=[*study.sections[:-1], *better.sections, following, study.sections[-1]],
        found=[*_found(study, made.run.truth["parameters"]), *better.found],
    )


def _found(study: PaperStudy, truth: dict[str, float]) -> list[str]:
    runs = list(study.tuned.values())
    gaps = ", ".join(f"{r.label} {np.median(r.gap):.1e}" for r in runs)
    best = {r.label: dict(zip(study.problem.space.names, r.answers[r.best], strict=True)) for r in runs}
    at_best = [r.rmse[r.best] for r in runs]
    apart = max(study.problem.space.names, key=lambda n: np.ptp([b[n] for b in best.values()]) / truth[n])
    seconds = np.mean([np.mean(r.seconds) for r in runs])
    return [
        "No parameters within the paper's bounds explain this torque better than "
        f"{study.floor.rmse:.5f} N m RMSE, which is proven. Relative to that, the "
        f"median run ends above it by: {gaps}; bounded least squares ends on it.",
        f"A run of 10 000 evaluations takes {1e3 * seconds:.0f} ms; the paper's took about 900 s.",
        f"The methods' best runs agree to {np.ptp(at_best) / min(at_best):.0e} in RMSE, and have {apart} from "
        f"{min(b[apart] for b in best.values()):.3g} to {max(b[apart] for b in best.values()):.3g} (truth "
        f"{truth[apart]:.3g}): the torque "
        "determines four combinations of the six parameters, however long one searches.",
    ]


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
        f"{count} runs of PSO, CGA and SSA with 10 000 evaluations "
        f"each took {total:.0f} s on the virtual rig's record.",
        *study.floor.sentences,
    ]
