"""The command line: every command is a thin layer over the same Python calls.

Exit codes: 0 done; 2 wrong arguments; 3 recording; 4 unit; 5 model or equation; 6 parameters;
7 study file; 8 search; 9 simulation; 10 store; 11 missing extra; 12 file system or memory; 13 board;
70 an error inside plantfit, with a log; 130 stopped by Ctrl-C.
"""

import io
import os
import sys
import warnings
from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from plantfit.cli.commands.at_bench import bench
from plantfit.cli.commands.comparing import intervals
from plantfit.cli.commands.design import export_plant, next_experiment, tune_controller
from plantfit.cli.commands.judging import sensitivity
from plantfit.cli.terminal.failures import INSIDE, inside, shortened
from plantfit.cli.terminal.interrupts import SENTENCE, ending, watched
from plantfit.cli.terminal.overview import sections
from plantfit.errors import Interrupted, PlantfitError, PlantfitWarning
from plantfit.study.store.addresses import STORE, VARIABLE


class _Commands(TyperGroup):
    """The commands; one that Ctrl-C stops says so, unless it has a sentence of its own."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise Interrupted(SENTENCE) from None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for title, rows in sections(self.list_commands(ctx)):
            with formatter.section(title):
                formatter.write_dl(rows)
        formatter.write("\n`plantfit COMMAND --help` says more of each. Your own recording: `plantfit init FILE`.\n")


app = typer.Typer(
    cls=_Commands,
    name="plantfit",
    help="From recordings of machines and processes to physical parameters that can be trusted.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON value for scripts, nothing else, on standard output.")]
StorePlace = Annotated[str, typer.Option("--store", envvar=VARIABLE, help="Study database: a file, or a SQLAlchemy URL.")]
StudyId = Annotated[int | None, typer.Argument(help="Number of the study in `plantfit list`; the newest if left out.")]
ReportPlace = Annotated[str | None, typer.Option("--out", "-o", help="Where the HTML report goes; NAME.html if left out.")]
Workers = Annotated[
    str | None,
    typer.Option(
        "--workers", help="Worker processes: a number, or auto for one for each core. 1 if left out, as short studies need no more."
    ),
]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", help="A dask scheduler as in tcp://host:8786 does the work, or local for one on this machine.")
]
NoDiagnose = Annotated[bool, typer.Option("--no-diagnose", help="Do not look for what is missing in the model.")]


@app.command()
def demo(
    name: Annotated[str, typer.Argument(help="Name of a demo; see `plantfit demo --list`.")] = "gearmotor",
    out: Annotated[str, typer.Option("--out", "-o", help="Folder for the reports.")] = "out",
    list_: Annotated[bool, typer.Option("--list", help="Name the demos and stop.")] = False,
    full: Annotated[bool, typer.Option("--full", help="The whole study instead of a short form of it, where a demo has both.")] = False,
    files: Annotated[bool, typer.Option("--files", help="Copy its recordings and study files only, to work with them yourself.")] = False,
    json: Json = False,
) -> None:
    """Work a demo that comes with plantfit, end to end, and write its reports."""
    from plantfit.cli.commands import demos

    if list_:
        demos.listed(json)
    elif files:
        demos.copied(name, out, json)
    else:
        demos.demo(name, out, full, json)


@app.command()
def init(
    file: Annotated[str, typer.Argument(help="A recording: CSV, CSV.gz, Parquet, XLSX, MAT, NPZ.")],
    out: Annotated[
        str | None, typer.Option("--out", "-o", help="The study file to write; NAME.toml beside the recording if left out.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing study file.")] = False,
    inputs: Annotated[list[str] | None, typer.Option("--input", help="Column that is an input; once for each.")] = None,
    outputs: Annotated[list[str] | None, typer.Option("--output", help="Column that is an output; once for each.")] = None,
    candidates: Annotated[bool, typer.Option("--candidates", help="Write three kinds of model, fit and compare them.")] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing; take what the columns seem to be.")] = False,
    model: Annotated[
        str | None, typer.Option("--model", help="dc_motor: its constants with a current, else what the speed determines of them.")
    ] = None,
    json: Json = False,
) -> None:
    """Say what the columns of a recording seem to be, and write a commented study file that runs."""
    from plantfit.cli.commands.before import init as command

    command.init(file, out, force, json, inputs or (), outputs or (), yes, candidates, model)


@app.command()
def new(
    name: Annotated[str | None, typer.Argument(help="A list of parts, NAME.net; or with --from the name of the study.")] = None,
    from_: Annotated[str | None, typer.Option("--from", help="A plant to begin with; --list names them.")] = None,
    recording: Annotated[
        str | None, typer.Option("--recording", help="Its file of measurements, whose columns are found by name and unit.")
    ] = None,
    columns: Annotated[
        list[str] | None, typer.Option("--column", help="SIGNAL=COLUMN, where they are not found so; once for each.")
    ] = None,
    out: Annotated[str | None, typer.Option("--out", "-o", help="The study file to write; NAME.toml if left out.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
    list_: Annotated[bool, typer.Option("--list", help="Name the plants to begin with and stop.")] = False,
    parts: Annotated[bool, typer.Option("--parts", help="Name the parts that a list may have and stop.")] = False,
    json: Json = False,
) -> None:
    """Write the study file of a plant from its parts (resistors, springs, tanks, motors, ...), or of one from the library."""
    from plantfit.cli.commands.before import new as command

    if parts or list_:
        return command.tell_parts(json) if parts else command.tell_plants(json)
    command.new(name, from_, recording, columns or [], out, force, json)


@app.command()
def look(
    file: Annotated[str, typer.Argument(help="A study file (TOML), or a file of measurements.")],
    input_: Annotated[
        list[str] | None, typer.Option("--input", help="An input (repeat); those of the study, else the first column, if left out.")
    ] = None,
    output: Annotated[
        list[str] | None, typer.Option("--output", help="An output (repeat); those of the study, else the last column, if left out.")
    ] = None,
    recording: Annotated[str | None, typer.Option("--recording", help="Which recording of a study file; the first if left out.")] = None,
    out: Annotated[str | None, typer.Option("--out", "-o", help="Where the HTML page goes; NAME-look.html if left out.")] = None,
    json: Json = False,
) -> None:
    """Look at a recording without equations: frequency and step response, delay, and how well any linear model does."""
    from plantfit.cli.commands.before import look as command

    command.look(file, input_ or [], output or [], recording, out, json)


@app.command()
def check(
    spec: Annotated[str, typer.Argument(help="The study file (TOML).")],
    verify: Annotated[bool, typer.Option("--verify", help="Also compare the simulation of every recording with a tight solver.")] = False,
    at: Annotated[
        list[str] | None, typer.Option(help="Parameter values, as name=value (repeat); the others stay in the middle of their bounds.")
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="With --verify: halve the steps until the largest error is below this (unit of the output).")
    ] = None,
    holds: Annotated[
        bool, typer.Option("--holds", help="Also fit shortly with every input held and interpolated between samples; say which fits.")
    ] = False,
    identify: Annotated[
        bool, typer.Option("--identify", help="What the records can determine also of models with events, dry friction or backlash.")
    ] = False,
    json: Json = False,
) -> None:
    """Read a study file and its recordings, say what was understood, and simulate once."""
    from plantfit.cli.commands.judging import check as command

    command.check(spec, verify, json, at or [], tolerance, holds, identify)


@app.command()
def run(
    specs: Annotated[list[str], typer.Argument(help="Study files (TOML); several are worked on together.")],
    store: StorePlace = STORE,
    out: ReportPlace = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    try_: Annotated[
        list[str] | None,
        typer.Option(
            "--try", help='Add this to the model, as in --try "dead time of u" (repeat), keep the study file with it, and run that one.'
        ),
    ] = None,
    no_diagnose: NoDiagnose = False,
    json: Json = False,
) -> None:
    """Run a study, keep every run in the store, look for what is missing in its model where the residual is more than noise, and write
    the report. Ctrl-C saves; `plantfit resume` goes on."""
    from plantfit.cli.commands import studies

    studies.run(specs, store, out, json, workers, scheduler, try_ or [], not no_diagnose)


@app.command()
def diagnose(
    spec: Annotated[str, typer.Argument(help="The study file (TOML).")],
    out: Annotated[str | None, typer.Option("--out", "-o", help="The study file to write; NAME-with-....toml if left out.")] = None,
    try_: Annotated[
        list[str] | None,
        typer.Option(
            "--try", help='Try only this and write it, as in --try "dead time of u" (repeat); any other word lists what there is.'
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file if it is there.")] = False,
    json: Json = False,
) -> None:
    """Fit a study, try what may be missing in its model, say what each explains, and write the study file with what is missing."""
    from plantfit.cli.commands.judging import diagnose as command

    command.diagnose(spec, out, try_ or [], force, json)


@app.command()
def resume(
    study: Annotated[
        list[int] | None, typer.Argument(help="Numbers of studies in `plantfit list`; the newest unfinished if left out.")
    ] = None,
    store: StorePlace = STORE,
    out: ReportPlace = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    no_diagnose: NoDiagnose = False,
    json: Json = False,
) -> None:
    """Go on with interrupted studies, bit for bit as if they had not stopped."""
    from plantfit.cli.commands import studies

    studies.resume(study or [], store, out, json, workers, scheduler, not no_diagnose)


@app.command()
def workers(
    study: Annotated[int | None, typer.Argument(help="Number of a study in `plantfit list`; all unfinished ones if left out.")] = None,
    store: StorePlace = STORE,
    watch: Annotated[bool, typer.Option("--watch", help="Show it again every second until Ctrl-C.")] = False,
    json: Json = False,
) -> None:
    """Show what every worker does now: machine, task, share of its budget, last sign of life."""
    from plantfit.cli.terminal import watching

    watching.workers(study, store, watch, json)


@app.command("list")
def list_(store: StorePlace = STORE, json: Json = False) -> None:
    """List the studies of a store."""
    from plantfit.cli.commands import studies

    studies.listed(store, json)


@app.command()
def report(
    study: StudyId = None, store: StorePlace = STORE, out: ReportPlace = None, no_diagnose: NoDiagnose = False, json: Json = False
) -> None:
    """Write the report of a study again, or print its figures with --json."""
    from plantfit.cli.commands import studies

    studies.report(study, store, out, json, not no_diagnose)


@app.command()
def combine(
    study: StudyId = None,
    out: Annotated[str | None, typer.Option("--out", "-o", help="The study file to write; NAME-combined.toml if left out.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file if it is there.")] = False,
    store: StorePlace = STORE,
    json: Json = False,
) -> None:
    """Write a study file whose parameters are the combinations that the data determine."""
    from plantfit.cli.commands import combine as command

    command.combine(study, out, force, store, json)


@app.command("export-study")
def export_study(
    study: StudyId = None,
    json: Annotated[bool, typer.Option("--json", help="As JSON, NAME.json unless --out says otherwise; the default.")] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="As Parquet, one row per run: NAME.parquet.")] = False,
    out: Annotated[str | None, typer.Option("--out", "-o", help="The file to write.")] = None,
    store: StorePlace = STORE,
) -> None:
    """Write a study, finished or not, to a file that `plantfit import` brings back bit for bit."""
    from plantfit.cli.commands import exchange

    exchange.export(study, json, parquet, out, store)


@app.command("import")
def import_(
    files: Annotated[list[str], typer.Argument(help="Files that `plantfit export-study` wrote.")],
    spec: Annotated[str | None, typer.Option("--spec", help="Where the study file lies here, to find the recordings beside it.")] = None,
    store: StorePlace = STORE,
    json: Json = False,
) -> None:
    """Bring exported studies into a store; an unfinished one goes on with `plantfit resume`."""
    from plantfit.cli.commands import exchange

    exchange.import_(files, spec, store, json)


@app.command()
def merge(
    sources: Annotated[list[str], typer.Argument(help="Stores or exported files of other machines.")],
    store: StorePlace = STORE,
    json: Json = False,
) -> None:
    """Bring the studies of other stores into this one; runs of the same study become one study."""
    from plantfit.cli.commands import exchange

    exchange.merge(sources, store, json)


@app.command()
def predict(
    spec: Annotated[str, typer.Argument(help="The study file (TOML); its recordings may be new ones.")],
    out: Annotated[str, typer.Option("--out", "-o", help="CSV file to write.")] = "predicted.csv",
    values: Annotated[list[str] | None, typer.Option("--set", help="A parameter, as NAME=VALUE in its unit; may be repeated.")] = None,
    study: Annotated[
        int | None, typer.Option("--study", help="Take the other parameters from this study; the newest of that name if left out.")
    ] = None,
    recording: Annotated[str | None, typer.Option("--recording", help="Which recording of the study file; the first if left out.")] = None,
    bands: Annotated[
        bool, typer.Option("--bands", help="Also where plant and readings lie for all parameters that the data allow.")
    ] = False,
    level: Annotated[str, typer.Option("--level", help="Of the bands, as in 95%.")] = "95%",
    store: StorePlace = STORE,
    json: Json = False,
) -> None:
    """Simulate a study's model over a recording at its best parameters and write a CSV."""
    from plantfit.cli.commands import predict as command

    command.predict(spec, out, values or [], study, recording, level if bands else None, store, json)


@app.command()
def compare(
    given: Annotated[
        list[str] | None,
        typer.Argument(
            help="Study files (TOML) of models of the same data; or numbers or names of stored studies, the newest if left out."
        ),
    ] = None,
    store: StorePlace = STORE,
    out: Annotated[str, typer.Option("--out", "-o", help="Where the HTML comparison goes.")] = "compare.html",
    models: Annotated[
        bool | None,
        typer.Option("--models/--methods", help="What stored studies are compared by; decided by what is given if left out."),
    ] = None,
    linear: Annotated[
        bool, typer.Option("--linear/--no-linear", help="Models: also fit the best linear model without physics, as a baseline.")
    ] = True,
    workers: Workers = None,
    latex: Annotated[str | None, typer.Option("--latex", help="Also write a table for papers (booktabs) to this file.")] = None,
    csv: Annotated[str | None, typer.Option("--csv", help="Also write the table to this CSV file.")] = None,
    target: Annotated[list[float] | None, typer.Option("--target", help="A cost worth reaching (repeat).")] = None,
    floor: Annotated[float | None, typer.Option("--floor", help="The cost that noise alone leaves, if known.")] = None,
    optimum: Annotated[float | None, typer.Option("--optimum", help="The lowest cost there can be, if known.")] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the bootstrap intervals.")] = 0,
    json: Json = False,
) -> None:
    """Compare models of the same data, or search methods.

    Study files, or stored studies of different models of the same data: fits what is not fitted yet and says which predicts unseen data
    better, by how much, and what AICc and BIC choose. Otherwise the methods of the studies over their runs: who wins, by how much, how
    sure; studies of one problem are put together, studies of different problems are the replicates of one comparison."""
    from plantfit.cli.commands.comparing import chosen

    chosen.compare(given or [], store, out, latex, csv, target or [], floor, optimum, seed, models, linear, workers, json)


@app.command("compare-records")
def compare_records(
    given: Annotated[str, typer.Argument(help="The study file (TOML), or the number or name of a stored study.")],
    store: StorePlace = STORE,
    out: Annotated[str | None, typer.Option("--out", "-o", help="Where the HTML page goes; NAME-records.html if left out.")] = None,
    workers: Workers = None,
    json: Json = False,
) -> None:
    """Fit each recording of a study alone; say whether they agree on the parameters, and which one no longer fits the others."""
    from plantfit.cli.commands.comparing import records

    records.compare_records(given, store, out, workers, json)


@app.command()
def estimate(
    given: Annotated[str, typer.Argument(help="The study file (TOML), or the number or name of a stored study.")],
    methods: Annotated[
        list[str] | None,
        typer.Option("--method", help="maximum likelihood, ekf, ukf or kalman (repeat); those of the [estimate] table if left out."),
    ] = None,
    store: StorePlace = STORE,
    out: Annotated[str | None, typer.Option("--out", "-o", help="Also write an HTML page with how each constant settles.")] = None,
    workers: Workers = None,
    json: Json = False,
) -> None:
    """Parameters by maximum likelihood and Kalman filters beside least squares; noise levels, and whether the methods agree."""
    from plantfit.cli.commands.comparing import estimators

    estimators.estimate(given, methods or [], store, out, workers, json)


@app.command("tune-search")
def tune_search(
    spec: Annotated[str, typer.Argument(help="The study file (TOML).")],
    method: Annotated[str, typer.Option("--method", "-m", help="The method whose settings are tuned; see `plantfit methods`.")],
    outer: Annotated[str, typer.Option("--outer", help="The method that searches the settings.")] = "pso",
    budget: Annotated[int | None, typer.Option("--budget", help="Evaluations of a run; that of the study file if left out.")] = None,
    runs: Annotated[int, typer.Option("--runs", help="Seeds on which settings race.")] = 20,
    trials: Annotated[int, typer.Option("--trials", help="Settings to try, the default among them.")] = 60,
    seed: Annotated[int, typer.Option("--seed", help="Same seed, same answer.")] = 1,
    only: Annotated[str | None, typer.Option("--only", help="Settings to tune, as in inertia,social; all if left out.")] = None,
    ranges: Annotated[
        list[str] | None, typer.Option("--range", help="Narrow a setting: inertia=0.4:0.9, or topology=global,ring (repeat).")
    ] = None,
    hold: Annotated[list[str] | None, typer.Option("--hold", help="A setting that is not tuned: population=50 (repeat).")] = None,
    out: Annotated[str | None, typer.Option("--out", "-o", help="Also write the settings block to this TOML file.")] = None,
    json: Json = False,
) -> None:
    """Tune the settings of a search method on your own problem, and say whether that paid. Ctrl-C keeps the best so far."""
    from plantfit.cli.commands import tune_search as tune

    tune.tune_search(spec, method, outer, budget, runs, trials, seed, only, ranges or [], hold or [], out, json)


app.command()(bench.excite)
app.command()(bench.record)
app.command()(bench.track)
app.command()(bench.rig)
app.command()(sensitivity.sensitivity)
app.command()(next_experiment.design)
app.command()(intervals.intervals)
app.command()(tune_controller.tune)
app.command()(export_plant.export)


@app.command()
def methods(name: Annotated[str | None, typer.Argument(help="Show one method in full.")] = None, json: Json = False) -> None:
    """List the search methods and what they need, or one with its paper and settings."""
    from plantfit.cli.commands import catalogue

    catalogue.methods(name, json)


@app.command()
def schema(
    findings: Annotated[bool, typer.Option("--findings", help="That of the findings, which `plantfit run --json` prints.")] = False,
    of: Annotated[str | None, typer.Option("--of", help="That of what another command prints with --json, as in compare-records.")] = None,
) -> None:
    """Print the JSON schema of study files, by which editors complete and check keys."""
    from plantfit.cli.terminal.out import print_json

    if of is not None:
        from plantfit.findings.results.all_results import result_schema

        return print_json(result_schema(of))
    if findings:
        from plantfit.findings.whole import findings_schema

        return print_json(findings_schema())
    from plantfit.spec.tables import json_schema

    print_json(json_schema())


@app.command()
def models(name: Annotated[str | None, typer.Argument(help="Show one model in full.")] = None, json: Json = False) -> None:
    """List the models that come with plantfit."""
    from plantfit.cli.commands import catalogue

    catalogue.models(name, json)


def run_cli() -> None:
    """Entry point: every error becomes one sentence and an exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a name that the terminal cannot show must not end the command
            stream.reconfigure(errors="backslashreplace")
    with watched(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those of numpy and jax are for programmers
        warnings.simplefilter("always", PlantfitWarning)
        warnings.showwarning = _told
        code = _ended(lambda: app(standalone_mode=True))
        ending()
    if code:
        sys.exit(code)


def _ended(command: Callable[[], Any]) -> int:
    """The exit code of a command, after the sentence about its error if there was one."""
    try:
        command()
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else 0 if stop.code is None else 1
    except PlantfitError as error:
        ending()
        return _failed(str(error), error.exit_code)
    except BrokenPipeError:  # as in `plantfit list | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as error:
        place = f" {error.filename!r}" if error.filename else ""
        return _failed(f"the file system refused{place}: {error.strerror or error}. Free space or choose another place and run again.", 12)
    except KeyboardInterrupt:
        ending()
        return _failed("stopped before anything was begun.", 130)
    except MemoryError:
        return _failed("the memory of this machine is not enough for this; use fewer samples, runs or workers, and run again.", 12)
    except Exception as error:
        return _failed(inside(error), INSIDE)
    return 0


def _failed(sentence: str, code: int) -> int:
    print(f"plantfit: {shortened(sentence)}", file=sys.stderr)
    return code


def _told(message: Any, category: Any, *place: Any, **more: Any) -> None:
    print(f"plantfit: {shortened(str(message))}", file=sys.stderr)
