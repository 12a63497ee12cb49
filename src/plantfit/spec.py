"""The study file: TOML to recordings, model, space, problem and plan."""

import difflib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

import plantfit.runtime  # noqa: F401
from plantfit import recording as rec
from plantfit.errors import PlantfitError, SearchError, SpecError
from plantfit.models import equations, library
from plantfit.models.regression import LinearModel
from plantfit.optimize.registry import make
from plantfit.problem import Experiment, Problem, split
from plantfit.problem.filter_alike import filter_alike
from plantfit.recording.unmeasured import unmeasured
from plantfit.space import Parameter
from plantfit.study.plan import Plan, default_budget

CLEANING = (
    "drop_outliers", "fill_gaps", "detrend", "subtract", "scale", "convert_units", "resample", "lowpass", "differentiate",
    "smooth_motion", "presliding", "decimate", "cut", "shift_time", "duty_to_voltage", "counts_to_angle", "counts_to_speed",
    "period_to_speed", "moving_rms", "odometry",
)  # fmt: skip


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


def _names(value: Any) -> Any:
    return {n: None for n in value} if isinstance(value, list) else value


def _numbers(value: Any) -> Any:
    """A number, or nested lists of numbers as tuples (the values of a table)."""
    if isinstance(value, list | tuple):
        return tuple(_numbers(v) for v in value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{value!r} is not a number")
    return float(value)


Pair = tuple[float, float]
Numbers = Annotated[Any, BeforeValidator(_numbers)]  # one number for all nodes of a table, or one for each
Units = Annotated[dict[str, str | None], BeforeValidator(_names)]


class RecordingTable(_Table):
    file: str
    time: str | int | None = None
    time_unit: str | None = None
    period: float | None = Field(None, gt=0)
    signals: dict[str, str | int] | None = None
    units: dict[str, str] = {}
    sheet: str | int | None = None
    fit: Pair | Literal[False] | None = None
    validate_: Pair | Literal[True] | None = Field(None, alias="validate")
    split: float | None = Field(None, gt=0, lt=1)
    skip: float = Field(0.0, ge=0)
    before: dict[str, float] = {}
    steady: bool = False
    unmeasured: list[str] = []
    clean: list[dict[str, Any]] = []
    sort: bool = False


class StateTable(_Table):
    unit: str | None = None
    initial: float | str = 0.0


class TableTable(_Table):
    over: str | list[str]
    nodes: Any
    unit: str | None = None


class AlikeTable(_Table):
    cutoff: float
    order: int = 3
    every: int = 1
    drop: float = 0.1


class ModelTable(_Table):
    kind: str | None = None
    options: dict[str, Any] = {}
    equations: str | None = None
    inputs: Units = {}
    states: dict[str, StateTable | str] = {}
    outputs: Units = {}
    constants: dict[str, float | str] = {}
    tables: dict[str, TableTable] = {}
    hold: dict[str, Literal["previous", "linear"]] = {}
    filter_alike: AlikeTable | None = None
    check_units: bool = True


class ParameterTable(_Table):
    bounds: tuple[Numbers, Numbers] | None = None
    unit: str | None = None
    scale: Literal["linear", "log"] = "linear"
    value: Numbers | None = None
    tied: str | None = None
    per_recording: bool = False
    start: Numbers | None = None
    sentence: str = ""


class SimulationTable(_Table):
    stepper: Literal["exponential", "rosenbrock", "rk4", "exact"] = "exponential"
    substeps: Annotated[int, Field(ge=1)] | None = None


class SearchTable(_Table):
    methods: list[str] = ["auto"]
    runs: int = 1
    budget: int | None = None
    seed: int = 1
    settings: dict[str, dict[str, Any]] = {}
    shooting: Annotated[int, Field(ge=1)] | None = None


class SpecTable(_Table):
    name: str
    recording: dict[str, RecordingTable] = Field(min_length=1)
    model: ModelTable
    parameters: dict[str, ParameterTable] = {}
    simulation: SimulationTable = SimulationTable()
    search: SearchTable = SearchTable()
    scales: dict[str, Annotated[float, Field(gt=0)]] = {}


@dataclass(frozen=True)
class Study:
    """A study file, ready to run; `text` is its wording, `folder` where its recordings are looked for."""

    name: str
    text: str
    path: Path
    problem: Problem
    plan: Plan
    table: SpecTable


def load(path: str | Path) -> Study:
    """Read a study file.

    Raises SpecError with file, key, value and what to do, and the errors of the rooms that use the values.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        near = difflib.get_close_matches(path.name, [p.name for p in path.parent.glob("*.toml")], 1) if path.parent.is_dir() else []
        raise SpecError(
            f"There is no study file {str(path)!r}.{f' Did you mean {near[0]!r}?' if near else ''} Make one with "
            "`plantfit init RECORDING.csv`."
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise SpecError(f"The study file {str(path)!r} cannot be read: {error}.") from None
    return parse(text, path)


def parse(text: str, path: str | Path = "study.toml", files: Mapping[str, Path] | None = None) -> Study:
    """The same from a text; recordings are looked for beside `path`, or where `files` says."""
    path = Path(path)
    table = validated(text, path)
    model, experiments = _model(table, path), {n: _experiment(n, r, path, files or {}) for n, r in table.recording.items()}
    if table.model.filter_alike is not None:
        model, experiments = _filtered_alike(model, experiments, table.model.filter_alike, path)
    problem = Problem(
        model,
        experiments,
        {n: _parameter(p) for n, p in table.parameters.items()},
        scales=table.scales,
        hold=table.model.hold,
        stepper=table.simulation.stepper,
        substeps=table.simulation.substeps,
        name=table.name,
    )
    return Study(table.name, text, path, problem, _plan(table, problem, path), table)


def _plan(table: SpecTable, problem: Problem, path: Path) -> Plan:
    search = table.search
    try:
        for method in search.methods:
            make(method, **search.settings.get(method, {}))
        return Plan(
            name=table.name,
            methods=tuple(search.methods),
            runs=search.runs,
            budget=search.budget if search.budget is not None else default_budget(problem.space.dimension),
            seed=search.seed,
            settings=search.settings,
        )
    except SearchError as error:
        raise SpecError(f"{path.name}, [search]: {error}") from None


def validated(text: str, path: Path) -> SpecTable:
    """The text as checked tables; nothing is read or built yet."""
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SpecError(f"{path.name} is not valid TOML: {error}. Check quotes and brackets there.") from None
    try:
        return SpecTable.model_validate(raw)
    except ValidationError as error:
        raise SpecError(_sentence(error, raw, path)) from None


def _sentence(error: ValidationError, raw: Mapping[str, Any], path: Path) -> str:
    first = error.errors()[0]
    places = [
        str(p) for p in first["loc"] if not str(p).endswith(("Table", "]")) and p not in ("str", "float", "int", "tuple[float, float]")
    ]
    key = ".".join(places)
    if first["type"] == "extra_forbidden":
        owner = _owner(first["loc"][:-1])
        near = difflib.get_close_matches(str(first["loc"][-1]), owner, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"known there: {', '.join(owner)}."
        return f"{path.name}: key {key!r} is not known; {hint}"
    if first["type"] == "missing":
        return f"{path.name}: key {key!r} is missing; add it."
    value = first.get("input")
    shown = "" if isinstance(value, dict) else f" = {value!r}"
    return f"{path.name}: {key}{shown} cannot be used: {first['msg'].lower()}. Correct it there."


def _owner(loc: tuple[Any, ...]) -> list[str]:
    """Keys allowed in the table at a place."""
    tables: dict[str, type[BaseModel]] = {
        "recording": RecordingTable, "model": ModelTable, "parameters": ParameterTable, "simulation": SimulationTable,
        "search": SearchTable,
    }  # fmt: skip
    table = tables.get(str(loc[0]), SpecTable) if loc else SpecTable
    if "states" in loc:
        table = StateTable
    if loc[:2] == ("model", "tables"):
        table = TableTable
    return [f.alias or n for n, f in table.model_fields.items()]


def _model(table: SpecTable, path: Path):
    m = table.model
    if (m.kind is None) == (m.equations is None):
        raise SpecError(f'{path.name}: [model] needs either kind = "..." (see `plantfit models`) or equations = """...""", and not both.')
    if m.kind is not None:
        return library.make(m.kind, **m.options)
    states = {n: ({"unit": s} if isinstance(s, str) else {"unit": s.unit, "initial": s.initial}) for n, s in m.states.items()}
    parameters = {
        n: {"unit": p.unit, "bounds": p.bounds, "scale": p.scale, "value": p.value, "sentence": p.sentence}
        for n, p in table.parameters.items()
    }
    try:
        return equations(
            m.equations or "",
            inputs=m.inputs,
            states=states,
            outputs=m.outputs,
            parameters=parameters,
            constants=m.constants,
            tables={n: {"over": t.over, "nodes": t.nodes, "unit": t.unit} for n, t in m.tables.items()},
            name=table.name,
            check=m.check_units,
        )
    except PlantfitError as error:
        error.args = (f"{path.name}, [model]: {error}",)
        raise


def _filtered_alike(model, experiments: Mapping[str, Experiment], options: AlikeTable, path: Path):
    if not isinstance(model, LinearModel):
        raise SpecError(f"{path.name}, [model]: filter_alike is for regressions, and {model.name!r} is simulated; leave it out.")
    try:
        columns, filtered = filter_alike(model, {n: e.recording for n, e in experiments.items()}, **options.model_dump())
    except PlantfitError as error:
        error.args = (f"{path.name}, [model] filter_alike: {error}",)
        raise
    return columns, {n: replace(e, recording=filtered[n]) for n, e in experiments.items()}


def _parameter(p: ParameterTable) -> Parameter:
    return Parameter(p.bounds, p.unit, p.scale, p.value, p.tied, p.per_recording, p.start, p.sentence)


def recording_file(r: RecordingTable, path: Path) -> Path:
    """Where the file of a recording lies."""
    return Path(r.file) if Path(r.file).is_absolute() else path.parent / r.file


def read_recording(name: str, r: RecordingTable, path: Path, files: Mapping[str, Path] | None = None) -> rec.Recording:
    """The recording of one table, cleaned as it says."""
    file = (files or {}).get(r.file) or recording_file(r, path)
    given = {
        "time": r.time, "time_unit": r.time_unit, "period": r.period, "signals": r.signals, "units": r.units or None,
        "sheet": r.sheet, "sort": r.sort or None,
    }  # fmt: skip
    record = rec.read(file, name=name, **{k: v for k, v in given.items() if v is not None})
    for i, step in enumerate(r.clean):
        arguments = dict(step)
        kind = arguments.pop("step", None)
        if kind not in CLEANING:
            near = difflib.get_close_matches(str(kind), CLEANING, 1)
            raise SpecError(
                f"{path.name}: recording.{name}.clean[{i}] has step = {kind!r}; "
                f"{f'did you mean {near[0]!r}? ' if near else ''}Known steps: {', '.join(CLEANING)}."
            )
        try:
            record = getattr(rec, kind)(record, **arguments)
        except TypeError as error:
            raise SpecError(
                f"{path.name}: recording.{name}.clean[{i}] ({kind}): {str(error).removeprefix(f'{kind}() ')}; see docs/recordings.md."
            ) from None
    return unmeasured(record, r.unmeasured) if r.unmeasured else record


def _experiment(name: str, r: RecordingTable, path: Path, files: Mapping[str, Path]) -> Experiment:
    record = read_recording(name, r, path, files)
    if r.split is not None:
        if r.fit is not None or r.validate_ is not None:
            raise SpecError(f"{path.name}: recording.{name} has split and also fit or validate; keep one way to say it.")
        cut = split(record, r.split, r.skip)
        return Experiment(record, cut.fit, cut.validate, r.skip, r.before, r.steady)
    every = (-np.inf, np.inf)
    unseen = every if r.validate_ is True else r.validate_
    fit = None if r.fit is False or (r.fit is None and r.validate_ is True) else (r.fit or every)
    if fit is not None and unseen is not None and fit == every:
        raise SpecError(
            f"{path.name}: recording.{name} gives validate but no fit; add fit = [start, stop] in seconds so that they do not overlap."
        )
    for what, interval in (("fit", fit), ("validate", unseen)):
        if interval is not None and interval[0] >= interval[1]:
            raise SpecError(
                f"{path.name}: recording.{name}.{what} = {list(interval)} is empty; give [start, stop] in seconds with start before stop."
            )
    if fit is not None and unseen is not None and max(fit[0], unseen[0]) < min(fit[1], unseen[1]):
        raise SpecError(
            f"{path.name}: recording.{name}: fit {list(fit)} and validate {list(unseen)} overlap; unseen data must not be fitted."
        )
    return Experiment(record, fit, unseen, r.skip, r.before, r.steady)
