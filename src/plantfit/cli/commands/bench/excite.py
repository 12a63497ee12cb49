"""`plantfit excite`: make a waveform within limits, look at it, and write it as CSV and as C."""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from plantfit.cli.arguments.quantities import number_and_unit, quantity
from plantfit.cli.terminal.out import out, print_json
from plantfit.errors import SpecError, UnitError

VOLTAGE = "V"  # the signal that an excitation is by default
KINDS = ("prbs", "multisine", "chirp", "staircase", "sine-square")


def excite(
    kind: str,
    amplitude: str,
    settings: Mapping[str, Any],
    limits: Mapping[str, Any],
    places: Mapping[str, str | None],
    json: bool,
) -> None:
    """Write `kind` to places["out"], and where named to "header" and "preview".

    `settings` and `limits` by option, as typed, None where left out.
    """
    from plantfit.recording import to_csv
    from plantfit.recording.excitation import crest_factor, limited

    make = _maker(kind)
    peak, unit = number_and_unit("--amplitude", amplitude, "V")
    _refuse_other_units(amplitude, unit, limits["signal"])
    made = make(peak, **_settings(kind, make, settings, unit), signal=limits["signal"], unit=unit)
    name = limits["signal"]
    voltage, supply = quantity("--limit", limits["limit"], unit), quantity("--supply", limits["supply"], unit)
    slew = quantity("--slew", limits["slew"], f"{unit}/s")
    if not (voltage is limits["duty"] is slew is None):
        made = limited(
            made,
            name,
            voltage=voltage,
            duty=limits["duty"],
            supply=supply,
            slew=slew,
            how="clip" if limits["clip"] else "scale",
        )
    written = {"csv": str(to_csv(made, places["out"] or f"{made.name}.csv"))}
    if places["header"]:
        from plantfit.recording.excitation import to_c_header

        written["header"] = str(
            to_c_header(made, places["header"], name, quantity("--step", limits["step"], unit, difference=True))
        )
    if places["preview"]:
        written["preview"] = str(_preview(made, name, places["preview"]))
    crest = crest_factor(made[name])
    if json:
        return print_json(
            {"kind": kind, "samples": len(made), "crest_factor": crest, "log": list(made.log), "files": written}
        )
    for line in made.log:
        out.print(line, markup=False)
    out.print(f"Crest factor {crest:.3f}.")
    for place in written.values():
        out.print(f"Written: {place}", markup=False)


def _refuse_other_units(amplitude: str, unit: str, signal: str) -> None:
    """The signal V is a voltage; another one may be in any unit that there is."""
    from plantfit import units

    units.parse(unit)
    if signal == VOLTAGE and not units.compatible(unit, "V"):
        raise UnitError(
            f"--amplitude {amplitude!r} is in {unit!r}, but the signal {VOLTAGE!r} is a "
            "voltage; give volts, such as --amplitude 6V, or name another signal with --signal."
        )


def _maker(kind: str) -> Callable[..., Any]:
    from plantfit.recording import excitation

    if kind not in KINDS:
        raise SpecError(f"There is no excitation {kind!r}; there are {', '.join(KINDS)}.")
    return getattr(excitation, kind.replace("-", "_"))


_UNITS = {"rate": "Hz", "duration": "s", "period": "s", "block": "s", "low": "Hz", "high": "Hz", "frequency": "Hz"}
_LEVELS = ("offset", "dead_zone")  # in the unit of the amplitude


def _settings(kind: str, make: Callable[..., Any], given: Mapping[str, Any], unit: str) -> dict[str, Any]:
    """The options that were given, as arguments; SpecError for one that the waveform has not, or lacks."""
    parameters = inspect.signature(make).parameters
    chosen = {key: value for key, value in given.items() if value is not None}
    for key, value in chosen.items():
        option = f"--{key.replace('_', '-')}"
        if key not in parameters:
            known = [f"--{p.replace('_', '-')}" for p in parameters if p in given]
            raise SpecError(f"{option} cannot be used with {kind}; it takes {', '.join(known)}.")
        if key in _UNITS or key in _LEVELS:
            chosen[key] = quantity(option, value, _UNITS.get(key, unit), difference=key == "dead_zone")
    for key, p in parameters.items():
        if p.default is p.empty and key != "amplitude" and key not in chosen:
            raise SpecError(f"A {kind} needs --{key.replace('_', '-')}.")
    return chosen


def _preview(made: Any, name: str, place: str) -> Path:
    from plantfit.recording.clean.sampling import period_of
    from plantfit.recording.excitation import amplitude_spectrum
    from plantfit.report.case_page import write_case_page
    from plantfit.report.figures.pages.excitation import spectrum_figure, waveform_figure

    unit = made.signals[name].unit
    f, a = amplitude_spectrum(made[name], 1 / period_of(made))
    figures = [
        {"figure": waveform_figure(made.t, made[name], name, unit), "label": f"{name} over time"},
        {"figure": spectrum_figure(f, a, name, unit), "label": f"amplitude spectrum of {name}"},
    ]
    page = {
        "title": f"Excitation: {made.name.replace('_', ' ')}",
        "sections": [{"title": "What will be played", "sentences": list(made.log), "figures": figures}],
    }
    return write_case_page(page, place)
