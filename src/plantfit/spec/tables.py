"""The tables of a study file, checked: which keys there are, of what kind, and what is said when one does not fit."""

import difflib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from plantfit.errors import SpecError


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


def _by_name(value: Any) -> Any:
    if isinstance(value, list):
        raise ValueError("write [uncertainty.NAME], a table with a name of its own for each source, in place of [[uncertainty]]")
    return value


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
    shared_errors: dict[str, str] = {}
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
    smooth: Literal["cross-validated", "reml"] | Numbers | None = None
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
    draws: Annotated[int, Field(ge=20)] | None = None


class SpecTable(_Table):
    name: str
    recording: dict[str, RecordingTable] = Field(min_length=1)
    model: ModelTable
    parameters: dict[str, ParameterTable] = {}
    simulation: SimulationTable = SimulationTable()
    search: SearchTable = SearchTable()
    scales: dict[str, Annotated[float, Field(gt=0)]] = {}
    balance: Literal["samples", "recordings"] = "samples"
    uncertainty: Annotated[dict[str, UncertaintyTable], BeforeValidator(_by_name)] = {}
    propagation: PropagationTable = PropagationTable()


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
        "search": SearchTable, "uncertainty": UncertaintyTable, "propagation": PropagationTable,
    }  # fmt: skip
    table = tables.get(str(loc[0]), SpecTable) if loc else SpecTable
    if "states" in loc:
        table = StateTable
    if loc[:2] == ("model", "tables"):
        table = TableTable
    return [f.alias or n for n, f in table.model_fields.items()]
