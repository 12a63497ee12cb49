"""What is known of parameters beforehand, as normal distributions."""

import re
from collections.abc import Mapping

import numpy as np

from plantfit.errors import SpecError
from plantfit.space import Space
from plantfit.units import in_unit

_TEXT = re.compile(r"\s*(?P<mean>[^±]+?)\s*(?:±|\+-|\+/-)\s*(?P<error>.+?)\s*")

Prior = tuple[float | str, float | str] | str


def normal_priors(space: Space, given: Mapping[str, Prior]) -> dict[int, tuple[float, float]]:
    """(mean, standard deviation) in the parameters' units by number of the coordinate.

    `given` has pairs of numbers or texts, or texts such as "138 ± 5 s" or "2.1 min +- 5 s". Raises SpecError and
    UnitError.
    """
    found = {}
    for name, prior in given.items():
        if name not in space.names:
            raise SpecError(f"A prior names {name!r}; free are {', '.join(space.names)}.")
        place = space.names.index(name)
        unit = space.coordinates[place].unit
        mean, error = _pair(name, prior)
        where = f"The prior of {name}"
        at, deviation = in_unit(where, mean, unit), in_unit(where, error, unit, difference=True)
        if not (np.isfinite(at) and np.isfinite(deviation) and deviation > 0):
            raise SpecError(f"The prior of {name} is {mean} ± {error}; its standard deviation has to be above 0.")
        found[place] = (at, deviation)
    return found


def _pair(name: str, prior: Prior) -> tuple[float | str, float | str]:
    if not isinstance(prior, str):
        if len(prior) != 2:
            raise SpecError(f"The prior of {name} has {len(prior)} parts; give mean and standard deviation.")
        return prior
    match = _TEXT.fullmatch(prior)
    if match is None:
        raise SpecError(
            f"The prior of {name} is {prior!r}; write mean and standard deviation, as in '138 ± 5 s' or '138 +- 5 s'."
        )
    mean, error = match["mean"], match["error"]
    own = re.sub(r"^[+-]?[\d.]+(?:[eE][+-]?\d+)?\s*", "", error)
    return (f"{mean} {own}" if own and _bare(mean) else mean), error


def _bare(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
