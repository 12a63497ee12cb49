"""`plantfit init --model dc_motor`: a motor's constants where its current was recorded, else the combinations that
speed determines."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from plantfit import units
from plantfit.cli.commands.begin.study_text import quoted
from plantfit.errors import RecordingError
from plantfit.models.library.speed_law import EDGE, EQUATIONS, LABELS, LAW, SENTENCES, UNITS

if TYPE_CHECKING:
    from plantfit.recording.description import ColumnSummary

REST = 0.02  # of the range of the speed: a first value below it is taken as rest
_KINDS = {  # what a channel is in, and what its column is called where it has no unit
    "V": ("V", ("v", "u", "ua", "voltage", "volt")),
    "w": ("rad/s", ("w", "omega", "speed", "velocity", "n")),
    "i": ("A", ("i", "ia", "current")),
}
_NAMED = {"V": "voltage", "w": "speed", "i": "current"}

ADDS = (
    "What else tells each constant (Kt = Kb in SI units):",
    "- the current, recorded beside the speed: all of Rm, Lm, Kb, Jm, Cm, Tf.",
    "- Rm (ohmmeter) and Kb (volts of the turned, open motor for its rad/s): then Cm = (c0 - Kb) Kb/Rm, Tf = f Kb/Rm, "
    "and Jm and Lm follow",
    "  from c1 and c2.",
    "- Rm alone: one number short; only Tf/Kb = f/Rm is added.",
    "- Rm and Lm: all, but Cm and Kb only roughly, as they hang on the small difference c1 - Rm c2/Lm.",
    "- Lm alone: one number short; only Jm/Kb = c2/Lm is added.",
)


@dataclass(frozen=True)
class Motor:
    """Columns of voltage, speed and, where there is one, current; `text` of the study file, and what is said about
    it."""

    columns: dict[str, "ColumnSummary"]
    text: str
    told: list[str]


def motor_study(
    source: str, path: str, spec: str, name: str, clock: str, columns: "Sequence[ColumnSummary]", wanted: Sequence[str],
    period: float,
    duration: float,
) -> Motor:  # fmt: skip
    """The study of a motor; `wanted` are headers that the user named, `clock` the line of the time, `period` and
    `duration` in s.

    Raises RecordingError where no column of voltage or of speed is found.
    """
    found = _found(source, columns, wanted)
    head = [
        f"# A study of a DC motor, made by `plantfit init {' '.join(source.split())} --model dc_motor`. Run it with:  "
        f"plantfit run {spec}",
        f"name = {quoted(name)}\n",
        "[recording.motor]",
        f"file = {quoted(path)}",
        clock,
        f"signals = {{ {', '.join(f'{s} = {quoted(c.header)}' for s, c in found.items())} }}",
    ]
    bare = {s: _KINDS[s][0] for s, c in found.items() if not c.unit}
    if bare:
        head.append(
            f"units = {{ {', '.join(f'{s} = {quoted(u)}' for s, u in bare.items())} "
            f"}}    # the file gives none: correct them"
        )
    head.append("split = 0.7            # the first 70 % are fitted, the rest shows whether the model holds\n")
    model, told = _with_current() if "i" in found else _of_speed(found, period, duration)
    tail = "\n[search]\nseed = 1\n"
    return Motor(found, "\n".join([*head, *model]) + tail, told)


def _found(source: str, columns: "Sequence[ColumnSummary]", wanted: Sequence[str]) -> dict[str, "ColumnSummary"]:
    """The column of each channel: those named by the user first, by unit, then by name."""
    moving = [c for c in columns if c.minimum is not None and c.minimum != c.maximum]
    named = [c for c in moving if c.header in wanted or c.header.split("[")[0].strip() in wanted]
    found = {}
    for channel, (unit, names) in _KINDS.items():
        for pool in (named, moving):
            own = [c for c in pool if c.unit and units.known(c.unit) and units.compatible(c.unit, unit)]
            bare = [c for c in pool if not c.unit and c.header.strip().lower() in names]
            exact = [c for c in own if c.header.split("[")[0].strip().lower() in names]
            if own or bare:
                found[channel] = (exact or own or bare)[0]
                break
    for channel in ("V", "w"):
        if channel not in found:
            have = ", ".join(repr(c.header) for c in moving) or "none that moves"
            hint = (
                " (a duty is turned into it by the step duty_to_voltage)"
                if channel == "V"
                else " (of counts by counts_to_speed)"
            )
            raise RecordingError(
                f"{source}: no column is a motor's {_NAMED[channel]} in {_KINDS[channel][0]}{hint}; its columns are "
                f"{have}. Give the "
                f"column its unit, as in '{channel} [{_KINDS[channel][0]}]'."
            )
    return found


def _with_current() -> tuple[list[str], list[str]]:
    told = [
        "The current is recorded, so that each constant is determined: the study frees Rm, Lm, Kb = Kt, Jm, Cm and Tf."
    ]
    return [
        "# The current is recorded: every constant is determined. Bounds are those of the library; see `plantfit "
        "models dc_motor`.",
        "[model]",
        'kind = "dc_motor"',
        "options = { tied = true, current_output = true }    # tied: Kt = Kb, which holds in SI units",
    ], told


def _of_speed(found: "dict[str, ColumnSummary]", period: float, duration: float) -> tuple[list[str], list[str]]:
    volts, speeds = (_range(found[s], _KINDS[s][0]) for s in ("V", "w"))
    most = max(map(abs, volts[:2]))
    ratio = most / max(map(abs, speeds[:2]))
    span = speeds[1] - speeds[0]
    # readings of an encoder's period begin with its second edge: what had no voltage when they were still missing was
    # at rest
    rests = abs(speeds[2]) <= REST * span or bool(found["w"].missing and abs(volts[2]) <= REST * most)
    bounds = {
        "c0": (ratio / 50, 5 * ratio),
        "c1": (ratio * period / 50, 5 * ratio * duration),
        "c2": (ratio * period**2 / 1000, ratio * duration**2 / 10),
        "f": (-most / 2, most / 2),
    }
    lines = [
        "# Without the current the speed determines four combinations of the constants, and no constant by itself:",
        *(
            f"#   {law} = {label}".ljust(30) + f"[{u}]".ljust(15) + s
            for law, label, u, s in zip(LAW, LABELS, UNITS, SENTENCES, strict=True)
        ),
        *(f"# {line}" for line in ADDS),
        '# With values that you measured, write in place of what follows: [model] kind = "dc_motor", options = { tied '
        "= true }, and",
        '#   [parameters.Rm]  value = 2.8  unit = "ohm"    (and [parameters.Kb] likewise)',
        "[model]",
        'equations = """',
        EQUATIONS,
        '"""',
        'inputs = { V = "V" }',
        "states = { "
        + f'w = {{ unit = "rad/s", initial = {0 if rests else _QUOTED_W} }}, '
        + f'a = {{ unit = "rad/s^2", initial = {0 if rests else _QUOTED_A} }} }}',
        'outputs = { w = "rad/s" }',
        f'constants = {{ edge = "{EDGE}" }}    # width over which Coulomb friction changes sign\n',
    ]
    for law, unit, sentence, label in zip(LAW, UNITS, SENTENCES, LABELS, strict=True):
        lines += _parameter(law, *bounds[law], unit, f"{label}: {sentence}", log=law != "f")
    if not rests:
        lines += _parameter(
            "w_start", speeds[2] - span / 2, speeds[2] + span / 2, "rad/s", "speed at the first sample", log=False
        )
        lines += _parameter(
            "a_start", -span / period / 10, span / period / 10, "rad/s^2", "acceleration at the first sample", log=False
        )
    told = [
        "There is no current, so the study is written in the four "
        "combinations of the constants that the speed determines:"
    ]
    told += [f"  {law} = {label}" for law, label in zip(LAW, LABELS, strict=True)]
    return lines, [*told, *ADDS]


_QUOTED_W, _QUOTED_A = '"w_start"', '"a_start"'


def _range(c: "ColumnSummary", unit: str) -> tuple[float, float, float]:
    """Lowest, highest and first value of a column in `unit`."""
    assert c.minimum is not None
    assert c.maximum is not None
    first = c.first_number if c.first_number is not None else c.minimum
    low, high, begin = (
        float(units.convert(float(v), c.unit, unit)) if c.unit else float(v) for v in (c.minimum, c.maximum, first)
    )
    return low, high, begin


def _parameter(name: str, low: float, high: float, unit: str, told: str, log: bool) -> list[str]:
    lines = [
        f"[parameters.{name}]",
        f"bounds = [{low:.4g}, {high:.4g}]",
        f'unit = "{unit}"',
        f"sentence = {quoted(told)}",
    ]
    return [*lines, *(['scale = "log"'] * log), ""]
