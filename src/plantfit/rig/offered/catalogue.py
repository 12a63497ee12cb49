"""The rigs by name, and one function that records any of them."""

import math
from collections.abc import Iterable, Mapping
from importlib import import_module
from pathlib import Path

import numpy as np

from plantfit import units
from plantfit.errors import SimulationError, UnitError
from plantfit.models.text.suggest import suggest
from plantfit.recording.record import Recording
from plantfit.rig.offered.contract import Asked, Number, OfferedRig, RigRecord

_PLACES = {
    "dc_motor": "plantfit.rig.offered.dc_motor",
    "pendubot": "plantfit.rig.offered.pendubot",
    "robot_drive": "plantfit.rig.offered.robot_drive",
    "robot_motor": "plantfit.rig.offered.robot_motor",
    "steam_chamber": "plantfit.rig.offered.steam_chamber",
}
MOST_SAMPLES = 2_000_000


def names() -> tuple[str, ...]:
    """Names of the rigs, without importing them."""
    return tuple(_PLACES)


def offered(name: str) -> OfferedRig:
    """The rig of this name. Raises SimulationError for an unknown one."""
    if name not in _PLACES:
        raise SimulationError(f"There is no rig {name!r}.{suggest(name, names())} Known are {', '.join(names())}.")
    return import_module(_PLACES[name]).RIG


def record_rig(
    name: str,
    constants: Mapping[str, float | str] | None = None,
    *,
    seed: int = 1,
    duration: float | None = None,
    period: float | None = None,
    excitation: str | Recording | None = None,
    without: Iterable[str] = (),
    controller: str | Path | None = None,
) -> RigRecord:
    """A record of the rig `name` with its truth, as `plantfit rig` writes it.

    `constants` sets any of the rig's numbers, in their units or as text with a unit ("25 cm"). Noise, phases and errors
    of instruments come from `seed`: the same call gives the same bits. `duration` and `period` in s. `excitation` is
    what the rig's `offered(name).excitation` says; `without` names optional channels that the record is to lack.
    `controller` is a file NAME-tune.json of `plantfit tune`: its PID drives the rig, and `excitation` are its set
    points, by default the step that it was tuned for.

    Raises SimulationError for an unknown name, an impossible value and a rig that cannot be driven so, UnitError for a
    wrong unit.
    """
    rig, given = offered(name), dict(constants or {})
    known = {n.name: n for n in rig.numbers}
    for wanted in given:
        if wanted not in known:
            raise SimulationError(
                f"Rig {name!r} has no {wanted!r}.{suggest(wanted, list(known))} It has {', '.join(known)}."
            )
    read = {n: _number(name, known[n], value) for n, value in given.items()}
    numbers = {n: d.value for n, d in known.items() if d.value is not None} | read
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or not 0 <= seed < 2**63:
        raise SimulationError(f"seed = {seed!r}; give a whole number from 0 on.")
    for what, value in (("duration", duration), ("period", period)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise SimulationError(f"Rig {name!r}: {what} = {value:g} s; give seconds above 0.")
    if excitation is not None and not rig.excitation:
        raise SimulationError(f"Rig {name!r} takes no excitation, because its controller moves it; leave it out.")
    tuned = None
    if controller is not None:
        if not rig.loop:
            can = [n for n in names() if offered(n).loop]
            raise SimulationError(f"Rig {name!r} cannot be driven by a tuned controller yet; {', '.join(can)} can.")
        from plantfit.rig.offered.tuned import read_tuned  # not before: it imports jax

        tuned = read_tuned(controller)
        own = tuned.settings.period
        if period is not None and not math.isclose(period, own):
            raise SimulationError(
                f"The controller {tuned.name} samples every {own:g} s; leave --period {period:g} s out."
            )
        period = own
    length, step = duration or rig.duration, period or rig.period
    if length < 10 * step:
        raise SimulationError(
            f"Rig {name!r}: {length:g} s with a sample every {step:g} s are under 10 samples; record longer."
        )
    if length / step > MOST_SAMPLES:
        raise SimulationError(
            f"Rig {name!r}: {length:g} s with a sample every {step:g} s are over {MOST_SAMPLES} samples; record less."
        )
    lacking = tuple(dict.fromkeys(without))
    for channel in lacking:
        if channel not in rig.optional:
            can = f"may lack {', '.join(rig.optional)}" if rig.optional else "lacks none of its channels"
            raise SimulationError(f"Rig {name!r} cannot leave out {channel!r}; its record {can}.")
    return rig.record(Asked(numbers, frozenset(read), int(seed), duration, period, excitation, lacking, tuned))


def _number(rig: str, number: Number, value: float | str) -> float:
    """A value in the unit of its number."""
    if isinstance(value, str):
        try:
            found, unit = units.quantity(value)
        except UnitError as error:
            raise UnitError(f"Rig {rig!r}, {number.name}: {error}") from None
        if unit and not units.compatible(unit, number.unit):
            raise UnitError(
                f"Rig {rig!r}: {number.name} = {value!r} is in {unit!r}, but {number.name} ({number.sentence}) is in "
                f"{number.unit or '1'!r}; give it in a unit of that kind."
            )
        value = float(units.convert(found, unit, number.unit)) if unit else found
    try:
        value = float(value)
    except (TypeError, ValueError, OverflowError):
        raise SimulationError(
            f"Rig {rig!r}: {number.name} = {value!r} is not a number; give one in {number.unit or '1'}."
        ) from None
    if refused := number.refused(value):
        raise SimulationError(f"Rig {rig!r}: {refused}.")
    return value
