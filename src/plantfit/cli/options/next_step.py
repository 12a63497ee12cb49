"""The commands that use a fitted plant: what they take, and their lines in `plantfit --help`."""

from typing import Annotated

import typer

from plantfit.cli.options.shared import FinishedSpec, Json, StorePlace, StudyNumber
from plantfit.control.tune.forms.names import CONTROLLERS, REGULATOR
from plantfit.study.store.addresses import STORE


def design(
    spec: FinishedSpec,
    input_: Annotated[
        list[str] | None,
        typer.Option("--input", help="Range that an input may use: u=0..100; as recorded if left out (repeat)."),
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option("--limit", help="Range that an output or a state must keep: 'T=20..80 degC', T=..80 (repeat)."),
    ] = None,
    slew: Annotated[
        list[str] | None, typer.Option("--slew", help="Fastest change of an input per second: u=5 (repeat).")
    ] = None,
    duration: Annotated[
        str | None, typer.Option("--duration", help="Length of the new recording, as in 10min.")
    ] = None,
    rate: Annotated[str | None, typer.Option("--rate", help="Samples a second, as in 100Hz.")] = None,
    hold: Annotated[
        str | None, typer.Option("--hold", help="Shortest time for which a level is held, as in 5s.")
    ] = None,
    for_: Annotated[
        str | None,
        typer.Option("--for", help="Parameters to determine as well as possible, as in tau,K; all if left out."),
    ] = None,
    criterion: Annotated[
        str,
        typer.Option("--criterion", help="What is made small. D: the ellipsoid of all errors; A: their mean square."),
    ] = "D",
    against: Annotated[
        str | None,
        typer.Option("--against", help="Study file of another model: the input then tells which one is right."),
    ] = None,
    alone: Annotated[
        bool, typer.Option("--alone", help="Count only the new recording, without those of the study.")
    ] = False,
    noise: Annotated[
        list[str] | None, typer.Option("--noise", help="Standard deviation of an output's noise: y=0.1 (repeat).")
    ] = None,
    draws: Annotated[
        int, typer.Option("--draws", help="How many other plants, of those that the data allow, judge the input.")
    ] = 8,
    budget: Annotated[int, typer.Option("--budget", help="Inputs to try.")] = 3000,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the search; the same seed gives the same input.")] = 1,
    study: StudyNumber = None,
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="Where the input goes; NAME-next.csv if left out.")
    ] = None,
    page: Annotated[
        str | None, typer.Option("--page", help="Where the page goes; beside the input if left out.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the CSV file if it exists.")] = False,
    store: StorePlace = STORE,
    json: Json = False,
) -> None:
    """The input that tells most about a study's parameters, or tells two models apart, within limits: a CSV for
    `record`, and a page."""
    from plantfit.cli.commands.next_step import next_experiment as command

    limits = {"inputs": input_ or [], "limits": limit or [], "slew": slew or [], "noise": noise or []}
    asked = {
        "duration": duration, "rate": rate, "hold": hold, "criterion": criterion, "alone": alone, "draws": draws,
        "budget": budget,
        "seed": seed,
    }  # fmt: skip
    command.design(spec, limits, for_, asked, against, study, out, page, force, store, json)


def tune(
    spec: Annotated[
        str, typer.Argument(help="The study file (TOML) of a finished study; its [control] table says what is wanted.")
    ],
    set_point: Annotated[
        list[str] | None,
        typer.Option(
            "--set-point", help='Set point of the output, as in "T1=60 degC", or "60 degC" where there is one output.'
        ),
    ] = None,
    step: Annotated[
        str | None, typer.Option("--step", help="Size of the step that ends at the set point, in the output's unit.")
    ] = None,
    load: Annotated[
        str | None, typer.Option("--load", help="Size of a step of load at the plant's input, in its unit.")
    ] = None,
    output: Annotated[str | None, typer.Option("--output", help="The output that is controlled.")] = None,
    input_: Annotated[str | None, typer.Option("--input", help="The input that is driven.")] = None,
    controller: Annotated[
        str | None,
        typer.Option("--controller", help=f"{', '.join(CONTROLLERS)}, or {REGULATOR} with --hold; lqi is an LQ servo."),
    ] = None,
    period: Annotated[str | None, typer.Option("--period", help="Sample time of the controller, as in 0.5s.")] = None,
    lower: Annotated[str | None, typer.Option("--lower", help="Lowest input of the actuator.")] = None,
    upper: Annotated[str | None, typer.Option("--upper", help="Highest input of the actuator.")] = None,
    rate: Annotated[str | None, typer.Option("--rate", help="Fastest change of the input, as in 10%/s.")] = None,
    output_lower: Annotated[str | None, typer.Option("--output-lower", help="Smallest output that is allowed.")] = None,
    output_upper: Annotated[str | None, typer.Option("--output-upper", help="Largest output that is allowed.")] = None,
    prediction: Annotated[
        str | None, typer.Option("--prediction", help="mpc: how far its plan looks ahead, as in 40s.")
    ] = None,
    overshoot: Annotated[
        float | None, typer.Option("--overshoot", help="How far the output may go beyond the set point, in percent.")
    ] = None,
    ms: Annotated[float | None, typer.Option("--ms", help="Largest sensitivity Ms.")] = None,
    share: Annotated[
        float | None, typer.Option("--share", help="Share of the plants that must keep all limits, 0 to 1.")
    ] = None,
    horizon: Annotated[
        str | None, typer.Option("--horizon", help="Length of the simulation of step and load, in seconds.")
    ] = None,
    levels: Annotated[
        str | None,
        typer.Option("--levels", help='scheduled: levels of the output, as in "20 degC,40 degC", or how many levels.'),
    ] = None,
    inner: Annotated[
        str | None, typer.Option("--inner", help="cascade: the output that its inner loop measures.")
    ] = None,
    inner_lower: Annotated[
        str | None, typer.Option("--inner-lower", help="cascade: lowest set point of the inner loop.")
    ] = None,
    inner_upper: Annotated[
        str | None, typer.Option("--inner-upper", help="cascade: highest set point of the inner loop.")
    ] = None,
    hold: Annotated[
        list[str] | None,
        typer.Option("--hold", help='lqr: a state and where it is held, as in "theta1=90 deg" (repeat).'),
    ] = None,
    lean: Annotated[
        str | None, typer.Option("--lean", help="lqr: how far from its place the first state may begin, as in 8deg.")
    ] = None,
    settling: Annotated[
        str | None, typer.Option("--settling", help="Longest time to within 2 % of the step, as in 30s.")
    ] = None,
    gain_margin: Annotated[
        float | None, typer.Option("--gain-margin", help="Smallest gain margin, as a factor.")
    ] = None,
    phase_margin: Annotated[
        float | None, typer.Option("--phase-margin", help="Smallest phase margin, in degrees.")
    ] = None,
    travel: Annotated[
        str | None, typer.Option("--travel", help="Most that the input may move in step and load together.")
    ] = None,
    minimise: Annotated[
        str | None,
        typer.Option(
            "--minimise",
            help="Weights of the figures that are minimised, as in iae=1,travel=0.2; iae=1,load_iae=1 if left out.",
        ),
    ] = None,
    over: Annotated[
        str | None,
        typer.Option("--over", help="Plants: chance (the share counts; if left out), expected (their mean) or worst."),
    ] = None,
    front: Annotated[
        str | None,
        typer.Option("--front", help="Two or three figures, as in load_iae,input_noise: controllers that trade them."),
    ] = None,
    points: Annotated[int | None, typer.Option("--points", help="About how many points the front has.")] = None,
    pick: Annotated[int | None, typer.Option("--pick", help="Point of the front that becomes the controller.")] = None,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            "--tolerance",
            help='Plants within "tau=10 %" or "L=2 s" of the best fit, in place of those that the data allow.',
        ),
    ] = None,
    number: Annotated[
        str | None,
        typer.Option("--number", help="Number type of the C file: double, float, or fixed point q15 or q31."),
    ] = None,
    full_scale: Annotated[
        list[str] | None,
        typer.Option("--full-scale", help='Fixed point: the value of the largest number, as in "T=100 degC" (repeat).'),
    ] = None,
    plants: Annotated[int | None, typer.Option("--plants", help="How many plants the controller is judged on.")] = None,
    budget: Annotated[int, typer.Option("--budget", help="Pairs of controllers to try on all plants.")] = 400,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the draws; the same seed gives the same answer.")] = 1,
    study: StudyNumber = None,
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="Where the page goes; NAME-tune.html if left out.")
    ] = None,
    c: Annotated[str | None, typer.Option("--c", help="Folder for the C files; that of the page if left out.")] = None,
    store: StorePlace = STORE,
    json: Json = False,
) -> None:
    """A controller (PID to MPC) from a finished study, tuned on every plant that the data allow: table, page,
    NAME-tune.json, C file."""
    from plantfit.cli.commands.next_step import tune_controller as command

    wishes = {
        "step": step, "load": load, "output": output, "input": input_, "controller": controller, "period": period,
        "lower": lower,
        "upper": upper, "overshoot": overshoot, "ms": ms, "share": share, "horizon": horizon, "plants": plants,
        "rate": rate,
        "output_lower": output_lower, "output_upper": output_upper, "prediction": prediction,
        "settling": settling, "gain_margin": gain_margin, "phase_margin": phase_margin, "travel": travel,
        "points": points, "pick": pick,
        "inner": inner, "inner_lower": inner_lower, "inner_upper": inner_upper,
    }  # fmt: skip
    wishes |= {
        "minimise": minimise,
        "front": front,
        "levels": levels,
        "hold": hold,
        "lean": lean,
        "number": number,
        "over": over,
    }
    wishes["full_scale"] = full_scale
    command.tune(spec, set_point or [], wishes, tolerance or [], budget, seed, study, out, c, store, json)


def export(
    study: Annotated[
        str | None,
        typer.Argument(help="The study file (TOML) whose plant is exported; a number of `plantfit list` without --to."),
    ] = None,
    to: Annotated[
        str | None, typer.Option("--to", help="python, c, casadi, control, matlab, csv, fmu or arviz.")
    ] = None,
    recording: Annotated[
        str | None,
        typer.Option(
            "--recording", help="The recording at whose first values the plant begins; the first if left out."
        ),
    ] = None,
    number: Annotated[
        int | None, typer.Option("--study", help="With --to: number of the study; the newest of that name if left out.")
    ] = None,
    json: Annotated[
        bool,
        typer.Option(
            "--json", help="Without --to: the study as JSON; with --to: print the names of the files as JSON."
        ),
    ] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="Without --to: the study as Parquet.")] = False,
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="With --to the folder, without it the file to write.")
    ] = None,
    store: StorePlace = STORE,
) -> None:
    """Write the plant of a finished study for another program (--to); without --to the study itself, as
    `export-study` does."""
    from plantfit.cli.commands.next_step import export_plant as command

    if to is None:
        return command.export_study(study, json, parquet, out, store)
    command.export(study, to, recording, number, json, out, store)


COMMANDS = {
    "design": (design, "The input to record next, within limits"),
    "tune": (tune, "A controller for every plant that the data allow"),
    "export": (export, "The plant for Python, C, CasADi, MATLAB and others"),
}
