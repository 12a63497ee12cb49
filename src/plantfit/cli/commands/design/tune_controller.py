"""`plantfit tune`: a controller from a finished study."""

from pathlib import Path
from typing import Annotated, Any

import typer

from plantfit.study.store.addresses import STORE, VARIABLE


def tune(
    spec: Annotated[str, typer.Argument(help="The study file (TOML) of a finished study; its [control] table says what is wanted.")],
    set_point: Annotated[
        list[str] | None, typer.Option("--set-point", help='Where the output goes, as in "T1=60 degC", or "60 degC" of the only output.')
    ] = None,
    step: Annotated[str | None, typer.Option("--step", help="The change that ends at the set point, in the output's unit.")] = None,
    load: Annotated[str | None, typer.Option("--load", help="A step of load at the plant's input, in its unit.")] = None,
    output: Annotated[str | None, typer.Option("--output", help="The output that is controlled.")] = None,
    input_: Annotated[str | None, typer.Option("--input", help="The input that is driven.")] = None,
    controller: Annotated[str | None, typer.Option("--controller", help="pid, pi, lqi (LQ servo with a filter) or mpc.")] = None,
    period: Annotated[str | None, typer.Option("--period", help="Sample time of the controller, as in 0.5s.")] = None,
    lower: Annotated[str | None, typer.Option("--lower", help="Lowest input of the actuator.")] = None,
    upper: Annotated[str | None, typer.Option("--upper", help="Highest input of the actuator.")] = None,
    rate: Annotated[str | None, typer.Option("--rate", help="Fastest change of the input, as in 10%/s.")] = None,
    output_lower: Annotated[str | None, typer.Option("--output-lower", help="Least output that is allowed.")] = None,
    output_upper: Annotated[str | None, typer.Option("--output-upper", help="Largest output that is allowed.")] = None,
    prediction: Annotated[str | None, typer.Option("--prediction", help="mpc: how far its plan looks ahead, as in 40s.")] = None,
    overshoot: Annotated[float | None, typer.Option("--overshoot", help="Percent that the output may go beyond the set point.")] = None,
    ms: Annotated[float | None, typer.Option("--ms", help="Largest sensitivity Ms.")] = None,
    share: Annotated[float | None, typer.Option("--share", help="Share of the plants that has to keep both, 0 to 1.")] = None,
    horizon: Annotated[str | None, typer.Option("--horizon", help="Seconds of step and load together.")] = None,
    tolerance: Annotated[
        list[str] | None,
        typer.Option("--tolerance", help='Plants within "tau=10 %" or "L=2 s" of the best fit, in place of those that the data allow.'),
    ] = None,
    plants: Annotated[int | None, typer.Option("--plants", help="Plants that judge the controller.")] = None,
    budget: Annotated[int, typer.Option("--budget", help="Controllers to try.")] = 400,
    seed: Annotated[int, typer.Option("--seed", help="Same seed, same answer.")] = 1,
    study: Annotated[int | None, typer.Option("--study", help="Number of the study; the newest of that name if left out.")] = None,
    out: Annotated[str | None, typer.Option("--out", "-o", help="Where the page goes; NAME-tune.html if left out.")] = None,
    c: Annotated[str | None, typer.Option("--c", help="Folder for the C files; that of the page if left out.")] = None,
    store: Annotated[str, typer.Option("--store", envvar=VARIABLE, help="Study database.")] = STORE,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON value, nothing else, on standard output.")] = False,
) -> None:
    """A PID, LQI or MPC from a finished study, tuned on every plant that the data allow: a table, a page, NAME-tune.json and a C file."""
    from plantfit.cli.commands.design.tuned_study import asked_of, tolerances_of

    wishes: dict[str, Any] = {
        "step": step, "load": load, "output": output, "input": input_, "controller": controller, "period": period, "lower": lower,
        "upper": upper, "overshoot": overshoot, "ms": ms, "share": share, "horizon": horizon, "plants": plants,
        "tolerances": tolerances_of(tolerance or []), "rate": rate, "output_lower": output_lower, "output_upper": output_upper,
        "prediction": prediction,
    }  # fmt: skip
    loaded, wishes = asked_of(spec, set_point or [], wishes)
    from plantfit.cli.arguments.file_names import file_name
    from plantfit.cli.commands.design.tuned_study import answer_for
    from plantfit.cli.terminal.out import progress_line
    from plantfit.report.html import check_place

    page = Path(out or file_name(f"{loaded.name}-tune", "html"))
    check_place(page)
    answer = answer_for(loaded, Path(spec), study, store)
    from plantfit.controllers import tune as tuned

    with progress_line(quiet=json) as tell:
        found = tuned(
            answer, budget=budget, seed=seed, progress=tell, control=loaded.control.model_dump(exclude_unset=True), **wishes
        )  # fmt: skip
    from plantfit.cli.commands.design.tuned_study import show, written
    from plantfit.cli.terminal.out import print_json

    record = found.record
    files = written(found, record, page, Path(c) if c is not None else page.parent)
    if json:
        return print_json(record | {"files": [str(f) for f in files]})
    show(record)
    from plantfit.cli.terminal.out import out as screen

    screen.print(f"Written: {', '.join(str(f) for f in files)}", markup=False)
