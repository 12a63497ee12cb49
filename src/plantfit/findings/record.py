"""What every record of the findings is: frozen, checked when it is made, and JSON types when it is asked for."""

from math import isfinite
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value


Number = Annotated[float | None, BeforeValidator(_finite)]
"""A number, or None for what is not known and not finite."""
Figure = Annotated[int | float | None, BeforeValidator(_finite)]
"""As `Number`; a count stays a whole number."""
Values = list[float | None]
"""Samples or entries, None where there is none."""
Level = Literal["good", "warning", "bad", "info"]


class Record(BaseModel):
    """Keys that a record does not know are left aside when it is read, and keys that its maker did not give stay out of its JSON."""

    model_config = ConfigDict(frozen=True, extra="ignore", use_attribute_docstrings=True)

    def plain(self) -> dict[str, Any]:
        """As JSON types, keys in the order of the fields."""
        return self.model_dump(by_alias=True, exclude_unset=True)


def array(values: Values | list[float]) -> np.ndarray:
    """Values (n,) as float64 with NaN for what is not known."""
    return np.array(values, dtype=float)
