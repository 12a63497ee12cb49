"""A DC motor on a microcontroller's virtual bench: the paper's surrogate, objective and genetic algorithm, and what
they can know."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.cases.motor.bench import PUBLISHED, TRUTH, bench
from plantfit.cases.motor.constants_section import Targets, constants_section, inside_of, targets
from plantfit.cases.motor.identifiability_section import identifiability_section, known
from plantfit.cases.motor.methods import GA, SLOPED, Methods, guarded, labels, methods_of, searches, sloped
from plantfit.cases.motor.methods_section import methods_section, spread
from plantfit.cases.motor.record_sections import bench_section, surrogate_section
from plantfit.cases.motor.surrogate import Surrogate, surrogate, two_errors_record
from plantfit.cases.motor.tracking_section import tracking_section
from plantfit.cases.shared.beside import Beside
from plantfit.cases.shared.files import unpack
from plantfit.cases.shared.fitting import fit_file
from plantfit.cases.shared.record import figure, record
from plantfit.cases.shared.stages import stages, within
from plantfit.fitting import Answer
from plantfit.recording import to_csv
from plantfit.spec import load

RUNS, RECORDS = (10, 50), (6, 40)  # small, full: runs of each method; records of the surrogate's comparison
DERIVATIVES = "searches by derivatives"
TITLE = "DC motor on a microcontroller (virtual bench)"
SUBTITLE = (
    "A surrogate, two error signals and a genetic algorithm without "
    "a current sensor: what that determines, and what it does not."
)


def run(folder: str | Path, progress: Callable[[Any], None] | None = None, full: bool = False) -> dict[str, Any]:
    """See `plantfit.cases.shared.registry.demos`; `full` makes 50 runs of 11 searches and compares 40 records."""
    folder, made = unpack("motor", folder), bench()
    to_csv(made.recording, folder / "motor.csv")
    made.run.save(folder / "board")
    here = [n for n in labels(full) if n not in SLOPED]
    begins = stages(("surrogate", "speed", "current", *here, "records", DERIVATIVES), progress)
    begins("surrogate")
    denoised = surrogate(made)
    file = folder / "two_errors.toml"
    to_csv(two_errors_record(made.recording, denoised.speed), folder / "two_errors.csv")
    files, study = [folder / "speed.toml", folder / "current.toml"], load(file)
    with Beside(sloped, file, RUNS[full]) as beside:
        speed, current = (fit_file(f, within(f.stem, progress)) for f in files)
        results, guard = searches(study, here, RUNS[full], begins), guarded(study)
        begins("records")
        both = targets([made, *(bench(seed) for seed in range(2, RECORDS[full] + 1))], denoised.order)
        begins(DERIVATIVES)
        results |= dict(zip(SLOPED, beside.result(progress), strict=True))
    methods = methods_of(study, {n: results[n] for n in labels(full)})
    sections = [
        bench_section(made),
        surrogate_section(denoised, made),
        methods_section(methods, guard),
        identifiability_section(speed.problem, methods.problem, current.values, both.raw),
        constants_section(both, current, methods),
        (tracked := tracking_section(current.values, TRUTH)),
    ]
    figures = _figures(denoised, methods, both, current)
    return record("motor", TITLE, figures, _sentences(methods), [speed, current], files, sections, SUBTITLE,
                  found=_found(denoised, methods, both, current, tracked))  # fmt: skip


def _found(denoised: Surrogate, methods: Methods, both: Targets, current: Answer, tracked: dict[str, Any]) -> list[str]:
    label = next(iter(GA))
    ends = {n: np.array([r.cost for r in methods.results[n]]) for n in ("auto", label)}
    low, high = spread(methods, label, "Rm")
    lowest, (inside, total) = float(np.min(ends["auto"])), inside_of(current)
    raw, other = (100 * float(both.inside(which)[:3].mean()) for which in (both.raw, both.surrogate))
    strays = {row[0]: float(row[1]) for row in tracked["tables"][0]["rows"]}
    rm = next(p for p in current.findings["parameters"] if p["name"] == "Rm")
    return [
        f"The surrogate fits the record to {denoised.fit_raw:.1f} % (the paper: up to 98 "
        "%). Fitted to the record, 95 % intervals of the combinations hold the truth in "
        f"{raw:.0f} % of cases, fitted to the surrogate in {other:.0f} %. Fit the record.",
        f"The paper's J does not lead to the motor: at its lowest Kb is {methods.best('auto')['Kb']:.3g} V s/rad "
        f"and the truth is {TRUTH['Kb']}; at the true constants J is {methods.truth / lowest:.0f} times as large.",
        f"The binary genetic algorithm's runs end with Rm from {low:.2g} to {high:.2g} ohm (truth {TRUTH['Rm']:.4g}) "
        f"at a median J of {np.median(ends[label]):.1e}; `auto` reaches {lowest:.1e} with the same budget in "
        f"{int(np.sum(ends['auto'] <= 1.01 * lowest))} of {len(ends['auto'])} runs, and no constants either.",
        f"Speed and voltage determine four combinations of the six constants; this record tells "
        f"{known(both.raw)} of them from zero. With a current sensor {inside} of the {total} constants that are "
        f"determined lie inside their 95 % intervals: Rm = {rm['value']:.4g} ohm ({rm['low']:.4g} to "
        f"{rm['high']:.4g}).",
        "A pendubot driven by the identified motor follows its path to "
        f"{strays['identified']:.2f} degrees rms, with the true constants to {strays['true']:.2f}.",
    ]


def _figures(denoised: Surrogate, methods: Methods, both: Targets, current: Answer) -> list[dict[str, Any]]:
    ends = {label: np.array([r.cost for r in rs]) for label, rs in methods.results.items()}
    label = next(iter(GA))
    inside, total = inside_of(current)
    raw, other = both.inside(both.raw), both.inside(both.surrogate)
    return [
        figure("surrogate, order chosen by blocks left out", denoised.order, None),
        figure("surrogate, fit to the raw record", denoised.fit_raw, "%", 98.0, "the paper, at most"),
        figure(
            "surrogate, fit to the true speed", denoised.fit_exact, "%", denoised.fit_sensor, "the raw record itself"
        ),
        figure(
            "J, auto, median of the runs",
            float(np.median(ends["auto"])),
            None,
            float(np.median(ends[label])),
            f"binary {label}",
        ),
        figure("J at the true constants", methods.truth, None, float(np.min(ends["auto"])), "lowest found"),
        figure(
            "Kb at the lowest J",
            methods.best("auto")["Kb"],
            "V*s/rad",
            TRUTH["Kb"],
            "truth of the bench; the paper 0.0061",
        ),
        figure(
            "raw record: truth inside 95 %, three coefficients", 100 * float(raw[:3].mean()), "%", 95.0, "asked for"
        ),
        figure(
            "surrogate: truth inside 95 %, three coefficients", 100 * float(other[:3].mean()), "%", 95.0, "asked for"
        ),
        figure("with a current channel: constants inside their intervals", inside, None, total, "determined"),
    ]


def _sentences(methods: Methods) -> list[str]:
    label = next(iter(GA))
    low, high = spread(methods, label, "Rm")
    return [
        "Of six constants (Kt = Kb) two directions stay flat, of seven three.",
        f"Runs of the genetic algorithm end with Rm anywhere from {low:.2g} to {high:.2g} ohm (truth "
        f"{TRUTH['Rm']:.4g}); what J prefers "
        "along the flat directions is the bias of its second error, towards a small Kb. The paper prints "
        f"{PUBLISHED['Kb']} beside Kt = {PUBLISHED['Kt']}.",
    ]
