"""The tables of a study file, checked: which keys there are, of what kind, and what is said when one does not fit."""

import difflib
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictFloat,
    StrictInt,
    StrictStr,
    ValidationError,
    model_validator,
)

from plantfit.control.tune.forms.names import CONTROLLERS, REGULATOR
from plantfit.errors import SpecError
from plantfit.simulate.steps.registry import STEPPERS
from plantfit.spec.asked import asked


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


def _names(value: Any) -> Any:
    if not isinstance(value, list):
        return value
    if not all(isinstance(n, str) for n in value):
        raise ValueError('write names as text, as in ["u"], or a table of names and units')
    return {n: None for n in value}


def _numbers(value: Any) -> Any:
    """A number, or nested lists of numbers as tuples (the values of a table)."""
    if isinstance(value, list | tuple):
        return tuple(_numbers(v) for v in value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("write a number without quotation marks; its unit belongs in the key 'unit'")
    try:
        return float(value)
    except OverflowError:
        raise ValueError("a number is beyond the range of float64") from None


def _starts(value: Any) -> Any:
    """One guess, or a guess for each recording by its name."""
    return {n: _numbers(v) for n, v in value.items()} if isinstance(value, dict) else _numbers(value)


def _by_name(value: Any) -> Any:
    if isinstance(value, list):
        raise ValueError(
            "write [uncertainty.NAME], a table with a name of its own for each source, in place of [[uncertainty]]"
        )
    return value


Pair = tuple[float, float]
Numbers = Annotated[Any, BeforeValidator(_numbers)]  # one number for all nodes of a table, or one for each
Starts = Annotated[Any, BeforeValidator(_starts)]  # the same, or a table of recordings
Units = Annotated[dict[str, str | None], BeforeValidator(_names)]
if TYPE_CHECKING:
    StepperName = str
    ControllerName = str
else:
    StepperName = Literal[tuple(STEPPERS)]
    ControllerName = Literal[(*CONTROLLERS, REGULATOR)]


class RecordingTable(_Table):
    file: str
    time: str | int | None = None
    time_unit: str | None = None
    dates: Literal["day first", "month first", "year first"] | None = None
    period: float | None = Field(None, gt=0)
    signals: dict[str, str | int] | None = None
    units: dict[str, str] = {}
    sheet: str | int | None = None
    missing: list[StrictStr | StrictInt | StrictFloat] = []  # true would be the number 1
    fit: Pair | Literal[False] | None = None
    validate_: Pair | Literal[True] | None = Field(None, alias="validate")
    split: float | None = Field(None, gt=0, lt=1)
    skip: float = Field(0.0, ge=0)
    pieces: float | None = Field(None, gt=0)
    before: dict[str, float | str] = {}
    initial_time: float | None = None
    steady: bool = False
    shared_errors: dict[str, str] = {}
    counted: dict[str, Annotated[float, Field(ge=0)]] = {}
    rounded: dict[str, Annotated[float, Field(ge=0)]] = {}
    noisy: dict[str, Annotated[float, Field(ge=0)]] = {}
    unmeasured: list[str] = []
    clean: list[dict[str, Any]] = []
    sort: bool = False
    duplicates: Literal["mean", "first"] | None = None


class StateTable(_Table):
    unit: str | None = None
    initial: float | str = 0.0


class TableTable(_Table):
    over: str | list[str]
    nodes: Any = None
    unit: str | None = None
    file: str | None = None
    columns: list[str | int] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> "TableTable":
        if (self.nodes is None) == (self.file is None):
            raise ValueError(
                'give nodes = [[...]], or file = "NAME.csv" that holds nodes and values'
                + ("" if self.nodes is None else ", not both")
            )
        if self.columns is not None and self.file is None:
            raise ValueError("columns says which columns of a file are meant; give file, too")
        return self


class AlikeTable(_Table):
    cutoff: float
    order: int = 3
    every: int = 1
    drop: float = 0.1


def _states(value: Any) -> Any:
    """A list of names as states without units that begin at 0."""
    named = _names(value)
    return {n: {} for n in named} if isinstance(value, list) else named


class ModelTable(_Table):
    kind: str | None = None
    options: dict[str, Any] = {}
    equations: str | None = None
    inputs: Units = {}
    states: Annotated[dict[str, StateTable | str], BeforeValidator(_states)] = {}
    outputs: Units = {}
    constants: dict[str, float | str] = {}
    tables: dict[str, TableTable] = {}
    hold: dict[str, Literal["previous", "linear"]] = {}
    clock_shift: dict[str, Pair] = {}
    extensions: dict[str, dict[str, Any]] = {}  # bounds, of a curve in time with nodes: `with_extensions` reads them
    filter_alike: AlikeTable | None = None
    check_units: bool = True


class ParameterTable(_Table):
    bounds: tuple[Numbers, Numbers] | None = None
    unit: str | None = None
    scale: Literal["linear", "log"] = "linear"
    value: Numbers | None = None
    tied: str | None = None
    per_recording: bool = False
    start: Starts | None = None
    smooth: Literal["cross-validated", "reml"] | Numbers | None = None
    limits: Pair | None = None
    typical: Annotated[float, Field(gt=0)] | None = None
    sentence: str = ""

    @model_validator(mode="after")
    def _within(self) -> "ParameterTable":
        low, high = self.bounds or (None, None)
        numbers = [v for v in (low, self.value, high) if isinstance(v, int | float)]
        if len(numbers) == 3 and sorted(numbers)[1] != self.value:
            raise ValueError(
                f"its value {self.value:g} lies beyond its bounds {low:g} to {high:g}; correct one of them "
                "(a parameter with a value is not searched)"
            )
        return self


class SimulationTable(_Table):
    stepper: StepperName = "exponential"
    substeps: Annotated[int, Field(ge=1, le=1_000_000)] | None = None


class SearchTable(_Table):
    methods: list[str] = ["auto"]
    runs: int = 1
    budget: int | None = None
    seed: int = 1
    settings: dict[str, dict[str, Any]] = {}
    shooting: Annotated[int, Field(ge=1)] | None = None


class UncertaintyTable(_Table):
    of: str | Annotated[list[str], Field(min_length=1)]
    kind: Literal["offset", "gain", "zero", "full scale"] | None = None
    limit: float | None = None
    standard: float | None = None
    expanded: float | None = None
    k: float | None = Field(None, gt=0)
    repeats: Annotated[list[float], Field(min_length=2)] | None = None
    shape: Literal["rectangular", "triangular", "u-shaped", "normal"] | None = None
    degrees_of_freedom: float | None = Field(None, gt=0)
    unit: str | None = None
    span: float | None = Field(None, gt=0)
    recordings: Annotated[list[str], Field(min_length=1)] | None = None
    per_recording: bool = False


class PropagationTable(_Table):
    draws: Annotated[int, Field(ge=20, le=100_000)] | None = None


class RegressionTable(_Table):
    """How the columns of a regression are made of measured signals, and what is an instrument for them."""

    method: Literal["instrumental variables", "least squares"] = "instrumental variables"
    reference: dict[str, str] = {}
    derivatives: dict[str, Annotated[list[str], Field(min_length=2, max_length=2)]] = {}
    targets: dict[str, str] = {}
    constants: dict[str, float | str] = {}
    held: list[str] = []
    smoothing: float | None = Field(None, gt=0)
    band: float = Field(gt=0)


class ControlTable(_Table):
    """What `plantfit tune` asks for; all is proposed from the study where it is left out."""

    output: str | None = None
    input: str | None = None
    controller: ControllerName = "pid"
    set_point: float | str | None = None
    step: float | str | None = None
    load: float | str | None = None
    period: float | str | None = None
    lower: float | str | None = None
    upper: float | str | None = None
    rate: float | str | None = None
    output_lower: float | str | None = None
    output_upper: float | str | None = None
    prediction: float | str | None = None
    quantum: float | str | None = None
    noise: float | str | None = None
    overshoot: float | None = Field(None, gt=0)
    ms: float | None = Field(None, gt=1)
    share: float | None = Field(None, gt=0, lt=1)
    input_noise: float | None = Field(None, gt=0)
    plants: Annotated[int, Field(ge=20, le=10_000)] | None = None
    horizon: float | str | None = None
    anti_windup: Literal["clamping", "back-calculation", "none"] | None = None
    recording: str | None = None
    inputs: dict[str, float | str] = {}
    tolerances: dict[str, float | str] = {}
    levels: (
        Annotated[int, Field(ge=2, le=20)] | Annotated[list[float | str], Field(min_length=2, max_length=20)] | None
    ) = None
    inner: str | None = None
    inner_lower: float | str | None = None
    inner_upper: float | str | None = None
    settling: float | str | None = None
    gain_margin: float | None = Field(None, ge=1)
    phase_margin: float | None = Field(None, ge=0, lt=180)
    travel: float | str | None = None
    minimise: dict[str, Annotated[float, Field(ge=0)]] | None = None
    over: Literal["chance", "expected", "worst"] | None = None
    front: list[str] = []
    number: Literal["double", "float", "q15", "q31"] = "double"
    full_scale: dict[str, float | str] = {}
    hold: dict[str, float | str] = {}
    lean: float | str | None = None
    points: Annotated[int, Field(ge=3, le=100)] = 9
    pick: Annotated[int, Field(ge=1)] | None = None


Quantity = float | str
Level = Quantity | tuple[Quantity, Quantity]


class EstimateTable(_Table):
    """What `plantfit estimate` and `plantfit track` ask for; levels that are left out are proposed from the
    recordings."""

    methods: Annotated[
        list[Literal["maximum likelihood", "generalised least squares", "ekf", "ukf", "kalman"]], Field(min_length=1)
    ] = ["maximum likelihood", "ekf", "ukf"]
    process: dict[str, Level] = {}
    measurement: dict[str, Level] = {}
    initial: dict[str, Quantity] = {}
    prior: dict[str, Quantity] = {}
    drift: dict[str, Quantity] = {}
    begin: Literal["box", "answer"] = "box"
    kappa: float = Field(0.0, ge=0)
    budget: Annotated[int, Field(ge=10, le=1_000_000)] = 300
    seed: int = 0
    truth: dict[str, Quantity] = {}


class SpecTable(_Table):
    name: str
    recording: dict[str, RecordingTable] = Field(min_length=1)
    model: ModelTable
    parameters: dict[str, ParameterTable] = {}
    simulation: SimulationTable = SimulationTable()
    search: SearchTable = SearchTable()
    scales: dict[str, Annotated[float, Field(gt=0)]] = {}
    balance: Literal["samples", "recordings"] = "samples"
    standard_errors: Literal["robust", "classical"] | None = None
    estimator: Literal["least squares", "generalised least squares", "maximum likelihood", "ekf", "ukf"] | None = None
    diagnose: bool = True
    uncertainty: Annotated[dict[str, UncertaintyTable], BeforeValidator(_by_name)] = {}
    propagation: PropagationTable = PropagationTable()
    control: ControlTable = ControlTable.model_validate({})
    estimate: EstimateTable = EstimateTable.model_validate({})
    regression: RegressionTable | None = None


def validated(text: str, path: Path) -> SpecTable:
    """The text as checked tables; nothing is read or built yet."""
    if len(text) > LONGEST:
        raise SpecError(
            f"{path.name} has {len(text)} characters; a study file "
            f"can have at most {LONGEST}, so put data into recordings."
        )
    try:
        raw = tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError as error:
        raise SpecError(f"{path.name} is not valid TOML: {error}. {_other_kind(text, path)}") from None
    except RecursionError:
        raise SpecError(
            f"{path.name} has too many brackets or keys inside each other; write it with at most {DEEPEST} levels."
        ) from None
    except (ValueError, OverflowError) as error:  # a number or a date that Python cannot hold
        raise SpecError(
            f"{path.name} has a number or date that cannot be read ({_first(error)}); correct it there."
        ) from None
    if (place := _too_deep(raw)) is not None:
        raise SpecError(
            f"{path.name}: {place[:80]} is nested more than {DEEPEST} "
            "levels deep; write it with fewer brackets or dots."
        )
    try:
        return SpecTable.model_validate(raw)
    except ValidationError as error:
        raise SpecError(_sentence(error, raw, path)) from None
    except (RecursionError, OverflowError, TypeError, ValueError) as error:
        raise SpecError(
            f"{path.name} cannot be used ({_first(error)}); see docs/study-file.md for what each key takes."
        ) from None


def _other_kind(text: str, path: Path) -> str:
    """What to do about a text that is not TOML."""
    if text.lstrip("\ufeff \t\r\n").startswith("{"):
        return "It looks like JSON; write the study file in TOML (docs/study-file.md)."
    if path.suffix.lower() in (".csv", ".tsv", ".txt", ".dat"):
        return f"It looks like a recording; make a study file from it with `plantfit init {path.name}`."
    return "Check quotes and brackets there."


def json_schema() -> dict[str, Any]:
    """The JSON schema of study files (draft 2020-12), for editors that complete and check keys."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **SpecTable.model_json_schema()}


LONGEST, DEEPEST = 4_000_000, 40  # characters; levels of tables and lists


def _first(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]


def _too_deep(raw: Any) -> str | None:
    """Where a tree has more than `DEEPEST` levels, without recursion."""
    left = [(raw, "", 0)]
    while left:
        value, place, depth = left.pop()
        inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for key, below in inner:
            if isinstance(below, dict | list):
                if depth >= DEEPEST:
                    return place or str(key)
                left.append((below, place or str(key), depth + 1))
    return None


def shown_value(value: Any, longest: int = 120) -> str:
    """A value of the study file as a message repeats it."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of more digits than Python writes
        return "a number too long to write"
    return text if len(text) <= longest else f"{text[:longest]}..."


def _sentence(error: ValidationError, raw: Mapping[str, Any], path: Path) -> str:
    every = error.errors()
    first = every[0]
    if first["type"] == "missing":  # a misspelt key beside it says more
        first = next((e for e in every if e["type"] == "extra_forbidden" and e["loc"][:-1] == first["loc"][:-1]), first)
    short = first["type"] == "missing" and isinstance(first["loc"][-1], int)  # a list with too few entries
    places = key_places(first["loc"][:-1] if short else first["loc"])
    key = ".".join(p if len(p) <= 60 else f"{p[:60]}..." for p in places)
    if first["type"] == "extra_forbidden":
        owner = _owner(first["loc"][:-1])
        near = difflib.get_close_matches(str(first["loc"][-1]), owner, 1)
        homes = " or ".join(_homes(str(first["loc"][-1])))
        if near:
            hint = f"did you mean {near[0]!r}?" + (f" Or is it meant for {homes}?" if homes else "")
        else:
            hint = f"it stands under {homes}." if homes else f"known there: {', '.join(owner)}."
        return f"{path.name}: key {key!r} is not known; {hint}"
    if first["type"] == "missing" and not short:
        return f"{path.name}: key {key!r} is missing; add it."
    value = first.get("input")
    shown = "" if isinstance(value, dict) else f" = {shown_value(value)}"
    told = [e for e in every if key_places(e["loc"]) == places or (e is first)]
    return f"{path.name}: {key}{shown} cannot be used: {asked(told)}."


def key_places(loc: tuple[Any, ...]) -> list[str]:
    """The keys on the way to a value, without the names of types that pydantic puts between."""
    return [str(p) for p in loc if not str(p).endswith(("Table", "]")) and p not in ("str", "float", "int")]


def _owner(loc: tuple[Any, ...]) -> list[str]:
    """Keys allowed in the table at a place."""
    kind: Any = SpecTable
    for part in loc:
        kind = _below(kind, str(part))
    table = next((k for k in _kinds(kind) if isinstance(k, type) and issubclass(k, BaseModel)), SpecTable)
    return [f.alias or n for n, f in table.model_fields.items()]


def _homes(key: str) -> list[str]:
    """The tables of a study file that know a key."""
    found = []
    for name, field in SpecTable.model_fields.items():
        for kind in _kinds(field.annotation):
            several = get_origin(kind) is dict
            table = get_args(kind)[1] if several else kind
            if isinstance(table, type) and issubclass(table, BaseModel):
                fields = [f.alias or n for n, f in table.model_fields.items()]
                found += [f"[{name}.NAME]" if several else f"[{name}]"] if key in fields else []
    return found + (["no table, at the top of the file"] if key in SpecTable.model_fields else [])


def _below(kind: Any, part: str) -> Any:
    """The type of a key of a table; the type itself where the part names one of several types that a value may have."""
    for one in _kinds(kind):
        if get_origin(one) is dict:
            return get_args(one)[1]
        if isinstance(one, type) and issubclass(one, BaseModel):
            fields = {f.alias or n: f.annotation for n, f in one.model_fields.items()}
            return one if part == one.__name__ else fields.get(part, kind)
    return kind


def _kinds(kind: Any) -> Iterator[Any]:
    """The types that a value may have."""
    if get_origin(kind) in (Union, UnionType, Annotated):
        for one in get_args(kind)[: 1 if get_origin(kind) is Annotated else None]:
            yield from _kinds(one)
    else:
        yield kind
