"""Units of recordings where the model has none: one for all recordings of a problem."""

from collections.abc import Mapping

from plantfit import units
from plantfit.errors import UnitError
from plantfit.problem.measure.experiment import Experiment


def recorded_units(experiments: Mapping[str, Experiment], needs: Mapping[str, str | None]) -> dict[str, str]:
    """The recorded units of signals that the model declares without a unit, whose numbers are taken as they are.

    Raises UnitError where two recordings have a signal in different units.
    """
    found: dict[str, tuple[str, str]] = {}
    for name, e in experiments.items():
        for signal in (s for s, unit in needs.items() if unit is None and s in e.recording.signals):
            unit = e.recording.signals[signal].unit
            if unit is None:
                continue
            first, other = found.setdefault(signal, (name, unit))
            if unit != other and not units.equal(unit, other):
                raise UnitError(
                    f"{signal!r} is in {other!r} in recording {first!r} and in {unit!r} in {name!r}, and the model has "
                    f"no unit for it; "
                    f'declare one under [model], as in {signal} = "{other}", to which recordings are converted.'
                )
    return {signal: unit for signal, (_, unit) in found.items()}
