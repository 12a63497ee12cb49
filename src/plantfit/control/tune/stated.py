"""Plants within tolerances that are stated, or by draws that are given, in place of those that the data allow."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit import units
from plantfit.errors import SpecError

JUDGES = 1000  # plants that a share is promised on: its standard deviation is under 1 % from 90 %


def half_width(name: str, given: float | str, value: float, unit: str | None) -> float:
    """Half the width of a tolerance: a number or a text with a unit, or percent of the value; raises SpecError and
    UnitError."""
    text = str(given).strip().removeprefix("+-").strip()
    if text.endswith("%"):
        try:
            width = abs(value) * float(text[:-1]) / 100.0
        except ValueError:
            raise SpecError(
                f"tolerances.{name} = {given!r} is no number before the %; write for example '10 %'."
            ) from None
    else:
        width = units.in_unit(f"[control] tolerances.{name}", text, unit, difference=True)
    if not (np.isfinite(width) and width > 0):
        raise SpecError(
            f"tolerances.{name} = {given!r} leaves no room; give half "
            "the width of the tolerance, above 0, such as '10 %'."
        )
    return width


def toleranced(
    values: Mapping[str, Any], tolerances: Mapping[str, float | str], unit: Mapping[str, str | None], count: int,
    seed: int
) -> dict[str, np.ndarray]:  # fmt: skip
    """Parameters of `count` + 1 plants by name, the first as `values`: those with a tolerance evenly within it, all
    others held.

    Raises SpecError for a name that the model lacks, one that is not a single number, and a tolerance across 0.
    """
    rng = np.random.default_rng(seed)
    found = {n: np.repeat(np.asarray(v, dtype=float)[None], count + 1, axis=0) for n, v in values.items()}
    for name, given in tolerances.items():
        if name not in found:
            raise SpecError(f"[control] tolerances names {name!r}; the model has the parameters {', '.join(found)}.")
        if found[name].ndim > 1:
            raise SpecError(
                f"[control] tolerances.{name}: a table has no one tolerance; state those of single parameters."
            )
        value = float(found[name][0])
        width = half_width(name, given, value, unit.get(name))
        if width >= abs(value) > 0:
            raise SpecError(
                f"tolerances.{name} = {given!r} takes {name} = {value:.4g} to the other side of 0; give a smaller one."
            )
        found[name][1:] = value + width * rng.uniform(-1.0, 1.0, count)
    return found


def given_draws(values: Mapping[str, Any], draws: Mapping[str, Any], least: int) -> dict[str, np.ndarray]:
    """Parameters of all plants by name, the first as `values`, then the `draws`, arrays (n,) by name; others held.
    Raises SpecError."""
    arrays = {n: np.asarray(v, dtype=float) for n, v in draws.items()}
    unknown = [n for n in arrays if n not in values]
    if unknown:
        raise SpecError(f"draws names {unknown[0]!r}; the model has the parameters {', '.join(values)}.")
    sizes = {n: a.shape[:1] for n, a in arrays.items()}
    if len(set(sizes.values())) != 1 or not all(np.all(np.isfinite(a)) for a in arrays.values()):
        raise SpecError(f"draws have the sizes {sizes}; give finite arrays of one length, one row a plant.")
    count = next(iter(sizes.values()))[0]
    if count < least:
        raise SpecError(f"draws has {count} plants; give {least} or more: 80 for the search, the others to judge.")
    held = {n: np.repeat(np.asarray(v, dtype=float)[None], count + 1, axis=0) for n, v in values.items()}
    return held | {n: np.concatenate([np.asarray(values[n], dtype=float)[None], a]) for n, a in arrays.items()}
