"""What every record of the findings is: frozen, checked when it is made, and JSON types when it is asked for."""

import ast
import inspect
from collections.abc import Mapping
from itertools import pairwise
from math import isfinite
from textwrap import dedent
from typing import Annotated, Any, ClassVar, Literal, Self, cast

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    GetJsonSchemaHandler,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value


Number = Annotated[float | None, BeforeValidator(_finite)]
"""A number, or None for what is not known and not finite."""


def _real(value: Any) -> Any:
    return float("nan") if value is None else value


Real = Annotated[float, BeforeValidator(_real), WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "null"}]})]
"""A number that may be infinite or not a number, which both say something, as the cost of a run that failed; None in
`--json`."""
Exclude = dict[str, Any]
"""Keys that are left out, True or what is left out below them; `__all__` for all entries of a list."""
Values = list[float | None]
"""Samples or entries, None where there is none."""


def _entries(values: Any) -> Any:
    given = values.tolist() if isinstance(values, np.ndarray) else values
    return [_finite(v) for v in given] if isinstance(given, list | tuple) else given


Samples = Annotated[Values, BeforeValidator(_entries)]
"""Values that are made from an array (n,) or a list, None for what is not finite."""
Level = Literal["good", "warning", "bad", "info"]
READ = "read"
"""The context of a validation that leaves keys aside which a record does not know, as those of another version."""


class Record(BaseModel):
    """A maker that gives a key which the record does not know is told so; a key that it does not give stays out of
    the JSON."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """With what is written under each field. Pydantic's own option reads it whenever a class is made, a tenth of
        a second a start."""
        schema = handler(core_schema)
        keys = handler.resolve_ref_schema(schema).get("properties", {})
        for name, words in _attribute_docstrings(cls).items():
            if (field := cls.model_fields.get(name)) and (key := keys.get(field.alias or name)) is not None:
                key.setdefault("description", words)
        return schema

    @model_validator(mode="before")
    @classmethod
    def _known(cls, given: Any, info: ValidationInfo) -> Any:
        if info.context != READ or not isinstance(given, Mapping):
            return given
        known = {name for key, field in cls.model_fields.items() for name in (key, field.alias)}
        return {key: value for key, value in given.items() if key in known}

    def plain(self) -> dict[str, Any]:
        """As JSON types, keys in the order of the fields."""
        return self.model_dump(by_alias=True, exclude_unset=True)


class Printed(Record):
    """The whole record of a command, which `--json` prints."""

    samples_in: ClassVar[Exclude] = {}
    """Fields that `--json` leaves out, because they hold samples."""

    def having(self, **more: Any) -> Self:
        """The same with other values of some fields, which are checked."""
        return type(self)(**{key: getattr(self, key) for key in self.model_fields_set} | more)

    def printed(self, **more: Any) -> dict[str, Any]:
        """As JSON types without samples, with what only the command knows."""
        return self.having(**more).model_dump(by_alias=True, exclude_unset=True, exclude=self.samples_in)


def _attribute_docstrings(cls: type) -> dict[str, str]:
    """The text under each attribute of a class and of those that it is made of, by name."""
    found: dict[str, str] = {}
    for own in reversed([c for c in cls.__mro__ if issubclass(c, Record)]):
        body = cast(ast.ClassDef, ast.parse(dedent(inspect.getsource(own))).body[0]).body
        for field, text in pairwise(body):
            match field, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(words))):
                    found[name] = inspect.cleandoc(words)
    return found


def array(values: Values | list[float]) -> np.ndarray:
    """Values (n,) as float64 with NaN for what is not known."""
    return np.array(values, dtype=float)
