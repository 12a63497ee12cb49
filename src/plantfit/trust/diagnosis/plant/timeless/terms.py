"""Which columns a regression may lack: friction of what moves, offsets, and coefficients that change with a signal."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from plantfit import units
from plantfit.models.extensions.changes import WITH
from plantfit.models.extensions.terms import OVER, TERMS, Place, term_name, unit_of_term
from plantfit.trust.diagnosis import ranges
from plantfit.trust.diagnosis.candidates import Changing, Inside, part_of_an_output
from plantfit.trust.diagnosis.catalogue import MOST_PAIRS, Extension
from plantfit.trust.diagnosis.plant.carrier import rounded_to_series
from plantfit.trust.diagnosis.plant.timeless.regression import Regression

SHARES = {  # of the rms of a speed, or of the range of a position: scales from which a column is tried
    "coulomb": (0.0002, 0.002, 0.02),
    "stribeck": (0.05, 0.2),
    "presliding": (1e-4, 1e-3, 1e-2),
}


CANDIDATES: dict[str, Inside] = {
    "viscous": part_of_an_output("", "viscous friction on {}", "viscous friction of {} on {}"),
    "presliding": part_of_an_output("", "presliding friction on {}", "presliding friction of {} on {}"),
    "coulomb": part_of_an_output("", "dry friction on {}", "dry friction of {} on {}"),
    "stribeck": part_of_an_output("", "falling friction on {}", "friction of {}, which falls with speed, on {}"),
    "quadratic": part_of_an_output("a", "drag by the square on {}", "a drag by the square of {} on {}"),
    "offset": part_of_an_output("an", "offset of {}", "an offset of {} on {}"),
    "change": Changing(
        name="change of {}", phrase="a change of {1} by {0}", low=-np.inf, bounds=ranges.both_signs,
        unit=lambda unit: unit,
        size=lambda s, rate: 1.0,
    ),
}  # fmt: skip
"""In the order in which columns that explain alike are named."""


@dataclass(frozen=True)
class TermExtension(Extension):
    """A column that a regression may lack; `signal` is the key of a study file, as in "tau1 with omega1 over 0.02"."""

    @property
    def candidate(self) -> Inside:
        return CANDIDATES[self.kind]

    @property
    def parameter(self) -> str:
        return term_name(self.kind, self.signal)


def terms_of(regression: Regression) -> dict[str, tuple[str, ...]]:
    """Every column that a regression may lack, kind -> keys of a study file."""
    found: dict[str, list[str]] = {kind: [] for kind in CANDIDATES}
    had = {p.name for p in regression.model.parameters}
    for kind, key in _keys(regression):
        if term_name(kind, key) not in had:
            found[kind].append(key)
    return {kind: tuple(keys) for kind, keys in found.items() if keys}


def extensions_of(regression: Regression) -> list[Extension]:
    """The columns as additions to try, changes last."""
    made: list[Extension] = []
    for kind, keys in terms_of(regression).items():
        row = CANDIDATES[kind]
        for key in keys:
            unit = unit_of_term(regression.model, kind, Place.of(key))
            made.append(TermExtension(kind, key, row.name.format(key), row.article, unit, row.low, np.inf))
    return made


def _keys(regression: Regression) -> Iterator[tuple[str, str]]:
    model = regression.model
    moving = [s for s in model.signals if _range(regression, s) > 0]
    of_kind = {
        "speed": [s for s in moving if _is(model.signals[s], ("rad/s", "m/s", "rpm"))],
        "position": [s for s in moving if _is(model.signals[s], ("rad", "m"))],
    }
    for kind in CANDIDATES:
        term = TERMS[kind]
        if term.of == "output":
            yield from ((kind, o) for o in model.outputs)
        elif term.of == "coefficient":
            yield from (
                (kind, f"{c}{WITH}{s}")
                for c, s in islice(((c, s) for c in model.coefficients for s in moving), MOST_PAIRS)
            )
        else:
            for o in model.outputs:
                for s in of_kind[term.of]:
                    yield from ((kind, f"{o}{WITH}{s}{scale}") for scale in _scales(regression, kind, s))


def _scales(regression: Regression, kind: str, signal: str) -> list[str]:
    if kind not in SHARES:
        return [""]
    size = _range(regression, signal) if TERMS[kind].of == "position" else _rms(regression, signal)
    return list(dict.fromkeys(f"{OVER}{rounded_to_series(share * size):g}" for share in SHARES[kind]))


def _range(regression: Regression, signal: str) -> float:
    return max(float(np.ptp(r[signal])) for r in regression.recordings.values())


def _rms(regression: Regression, signal: str) -> float:
    return max(float(np.sqrt(np.mean(r[signal] ** 2))) for r in regression.recordings.values())


def _is(unit: str | None, one_of: tuple[str, ...]) -> bool:
    return unit not in (None, "", "1") and any(units.compatible(unit, other) for other in one_of)
