"""What every record of the findings is: frozen, checked when it is made, and JSON types when it is asked for."""

from collections.abc import Mapping
from math import isfinite
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationInfo, model_validator


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value


Number = Annotated[float | None, BeforeValidator(_finite)]
"""A number, or None for what is not known and not finite."""
Values = list[float | None]
"""Samples or entries, None where there is none."""
Level = Literal["good", "warning", "bad", "info"]
READ = "read"
"""The context of a validation that leaves keys aside which a record does not know, as those of another version."""


class Record(BaseModel):
    """A maker that gives a key which the record does not know is told so; a key that it does not give stays out of the JSON."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

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


def array(values: Values | list[float]) -> np.ndarray:
    """Values (n,) as float64 with NaN for what is not known."""
    return np.array(values, dtype=float)
