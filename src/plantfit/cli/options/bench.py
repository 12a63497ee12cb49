"""The commands at the bench: what they take, and their lines in `plantfit --help`."""

from typing import Annotated

import typer

from plantfit.cli.options.shared import FitWorkers, Given, Json, StorePlace
from plantfit.study.store.addresses import STORE


def excite(
    kind: Annotated[str, typer.Argument(help="prbs, multisine, chirp, staircase or sine-square.")],
    amplitude: Annotated[
        str, typer.Option("--amplitude", help="Largest value, as in 6V; its unit is the unit of the signal.")
    ],
    rate: Annotated[str, typer.Option("--rate", help="Values a second, as in 100Hz.")] = "100Hz",
    duration: Annotated[str | None, typer.Option("--duration", help="Length of the signal, as in 30s or 2min.")] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            "--seed",
            help="prbs: selects where the sequence starts; multisine: selects the random phases. 0 if left out.",
        ),
    ] = None,
    order: Annotated[int | None, typer.Option("--order", help="prbs: the period is 2^order - 1 bits.")] = None,
    hold: Annotated[int | None, typer.Option("--hold", help="prbs: how many values each bit lasts.")] = None,
    period: Annotated[str | None, typer.Option("--period", help="multisine: its period, as in 10s.")] = None,
    periods: Annotated[int | None, typer.Option("--periods", help="multisine: how many periods.")] = None,
    phases: Annotated[
        str | None, typer.Option("--phases", help="multisine: crest (lowest peak), schroeder or random.")
    ] = None,
    odd: Annotated[bool | None, typer.Option("--odd", help="multisine: use odd lines only.")] = None,
    low: Annotated[str | None, typer.Option("--low", help="multisine, chirp: lowest frequency.")] = None,
    high: Annotated[str | None, typer.Option("--high", help="multisine, chirp: highest frequency.")] = None,
    sweep: Annotated[str | None, typer.Option("--sweep", help="chirp: logarithmic or linear.")] = None,
    steps: Annotated[int | None, typer.Option("--steps", help="staircase: levels on one side of zero.")] = None,
    block: Annotated[str | None, typer.Option("--block", help="sine-square: length of a block of three parts.")] = None,
    frequency: Annotated[
        str | None, typer.Option("--frequency", help="sine-square: frequency of the sine and the square wave.")
    ] = None,
    dead_zone: Annotated[
        str | None, typer.Option("--dead-zone", help="staircase, sine-square: voltage below which the motor stands.")
    ] = None,
    offset: Annotated[str | None, typer.Option("--offset", help="prbs, multisine, chirp: mean level.")] = None,
    limit: Annotated[str | None, typer.Option("--voltage", help="Largest voltage of either sign.")] = None,
    duty: Annotated[float | None, typer.Option("--duty", help="Largest duty, 0 to 1, with --supply.")] = None,
    supply: Annotated[str | None, typer.Option("--supply", help="Voltage at a duty of 1.")] = None,
    slew: Annotated[str | None, typer.Option("--slew", help="Fastest change, as in 200V/s.")] = None,
    clip: Annotated[
        bool, typer.Option("--clip", help="Clip values beyond a limit; without it the whole signal is scaled.")
    ] = False,
    signal: Annotated[str, typer.Option("--signal", help="Name of the column.")] = "V",
    out: Annotated[str | None, typer.Option("--out", "-o", help="CSV file to write; KIND.csv if left out.")] = None,
    header: Annotated[str | None, typer.Option("--header", help="Also write a C header to this file.")] = None,
    step: Annotated[
        str | None, typer.Option("--step", help="With --header: value of one count; the finest of 16 bits if left out.")
    ] = None,
    preview: Annotated[
        str | None, typer.Option("--preview", help="Also draw it and its spectrum on this HTML page.")
    ] = None,
    json: Json = False,
) -> None:
    """Make a signal that excites a plant, within limits, as CSV, as a C header, with a preview."""
    from plantfit.cli.commands.bench import excite as command

    settings = {
        "rate": rate, "duration": duration, "seed": seed, "order": order, "hold": hold, "period": period,
        "periods": periods,
        "phases": phases, "odd": odd, "low": low, "high": high, "sweep": sweep, "steps": steps, "block": block,
        "frequency": frequency,
        "dead_zone": dead_zone, "offset": offset,
    }  # fmt: skip
    limits = {
        "limit": limit,
        "duty": duty,
        "supply": supply,
        "slew": slew,
        "clip": clip,
        "signal": signal,
        "step": step,
    }
    command.excite(kind, amplitude, settings, limits, {"out": out, "header": header, "preview": preview}, json)


def record(
    port: Annotated[str, typer.Option("--port", "-p", help="The board's serial port, as in /dev/ttyACM0 or COM3.")],
    excitation: Annotated[
        str | None, typer.Option("--excitation", "-e", help="A CSV of `plantfit excite` to play.")
    ] = None,
    controller: Annotated[
        str | None,
        typer.Option(
            "--controller",
            help="NAME-tune.json of `plantfit tune`: its controller drives the board, and --excitation holds the set "
            "points.",
        ),
    ] = None,
    out: Annotated[str, typer.Option("--out", "-o", help="CSV file to write.")] = "run.csv",
    duration: Annotated[
        str | None, typer.Option("--duration", help="Stop after this, as in 30s; else after the excitation or Ctrl-C.")
    ] = None,
    rate: Annotated[
        str | None, typer.Option("--rate", help="Samples a second; the board's fastest if left out.")
    ] = None,
    baud: Annotated[
        int, typer.Option("--baud", help="Rate of the serial line; it must be that of the firmware.")
    ] = 1_000_000,
    reconnect: Annotated[
        str, typer.Option("--reconnect", help="How long to try to open the port again after it was lost.")
    ] = "30s",
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing recording.")] = False,
    json: Json = False,
) -> None:
    """Play an excitation on a board, or close a loop there, and record what it measures. Ctrl-C stops the motor
    first."""
    from plantfit.cli.commands.bench import record as command

    command.record(port, excitation, controller, out, duration, rate, baud, reconnect, force, json)


def track(
    given: Given,
    recording: Annotated[
        str, typer.Option("--recording", "-r", help="The measurements, with the study's columns; - for standard input.")
    ],
    follow: Annotated[
        bool,
        typer.Option(
            "--follow", help="The file still grows: wait for more rows until Ctrl-C, or until --idle ends it."
        ),
    ] = False,
    idle: Annotated[
        str | None, typer.Option("--idle", help="End when no row has come for this long, as in 30s.")
    ] = None,
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="CSV file for states and parameters; standard output if left out.")
    ] = None,
    every: Annotated[
        str | None,
        typer.Option(
            "--every", help="Time between rows and looks, as in 5s; a fiftieth of the study's record if left out."
        ),
    ] = None,
    false_alarm: Annotated[
        float,
        typer.Option("--false-alarm", help="Chance that a healthy plant ever raises an alarm, however long it runs."),
    ] = 0.01,
    like: Annotated[
        str | None,
        typer.Option("--like", help="The recording of the study that has the same columns; the first if left out."),
    ] = None,
    store: StorePlace = STORE,
    workers: FitWorkers = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file of --out if it exists.")] = False,
    json: Json = False,
) -> None:
    """Track states and parameters over new measurements, and raise an alarm when the plant leaves what the study
    knows of it."""
    from plantfit.cli.commands.bench import track as command

    command.track(given, recording, follow, idle, out, every, false_alarm, like, store, workers, force, json)


def rig(
    name: Annotated[str | None, typer.Argument(help="Which rig; all are listed if left out.")] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="A constant, noise or setting, as in l1=0.25 or l1=25cm (repeat); see --list."),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(
            "--seed", help="Seed of noise, phases and errors of instruments; the same seed gives the same bits."
        ),
    ] = 1,
    duration: Annotated[
        str | None,
        typer.Option("--duration", help="Length of the record, as in 30s or 2min; the rig's own if left out."),
    ] = None,
    period: Annotated[
        str | None, typer.Option("--period", help="Time between samples, as in 2ms; the rig's own if left out.")
    ] = None,
    excitation: Annotated[
        str | None,
        typer.Option(
            "--excitation", "-e", help="Values one after another (3V,-3V or 20%,60%), or a CSV file with the input."
        ),
    ] = None,
    controller: Annotated[
        str | None,
        typer.Option(
            "--controller",
            help="NAME-tune.json of `plantfit tune`: its controller drives the rig, and --excitation holds the set "
            "points.",
        ),
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option("--without", help="A channel to leave out of the record, as in i (repeat).")
    ] = None,
    out: Annotated[str | None, typer.Option("--out", "-o", help="CSV file to write; NAME.csv if left out.")] = None,
    study: Annotated[
        bool, typer.Option("--study", help="Also write a study file for the record, RECORD.toml.")
    ] = False,
    exact: Annotated[
        bool, typer.Option("--exact", help="Also write the signals without the sensors' faults, RECORD.exact.csv.")
    ] = False,
    list_: Annotated[bool, typer.Option("--list", help="Show what the rig takes, and stop.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
    json: Json = False,
) -> None:
    """Record a virtual plant with constants of your own; the truth is written beside the record, RECORD.truth.json."""
    from plantfit.cli.commands.bench import virtual_rig as command

    if name is None or list_:
        return command.listed(name, json)
    asked = {"seed": seed, "duration": duration, "period": period, "excitation": excitation, "without": without or []}
    asked["controller"] = controller
    command.record(name, settings or [], asked, out, {"study": study, "exact": exact, "force": force}, json)


COMMANDS = {
    "excite": (excite, "Make a signal that excites a plant, within limits"),
    "record": (record, "Play such a signal on a board and record its answer"),
    "track": (track, "Follow states and parameters on line, with an alarm"),
    "rig": (rig, "Record a virtual plant whose constants are known"),
}
