"""A PID with gains interpolated between levels as C."""

import math
import os
from collections.abc import Mapping
from string import Template

import numpy as np

from plantfit.control.c_export.files import (
    CFiles,
    checked_finite,
    checked_name,
    checked_number,
    clipped,
    literal,
    table,
    write_c,
)
from plantfit.control.c_export.pids.pid_parts import SETTLE
from plantfit.control.pid import Gains, Settings, checked
from plantfit.control.scheduling.law import Schedule
from plantfit.errors import SimulationError

DECLARED = Template("""#define ${UPPER}_PERIOD_S ${period}

/* Not to be read or written elsewhere. */
struct ${name} {
    ${real} held, derivative; /* parts of the command; the first is proportional and integral part together */
    ${real} error, measurement, reference; /* of the last sample */
};

/* Once, with the first measurement and the command at which the plant rests there, the set point at the measurement. */
void ${name}_init(struct ${name} *state, ${real} measurement, ${real} command);

/* The command, once a period. */
${real} ${name}_update(struct ${name} *state, ${real} measurement, ${real} reference);
""")

DEFINED = Template("""enum { LEVELS = ${m} };

static const ${real} levels[LEVELS] = ${levels};
static const ${real} kp[LEVELS] = ${Kp};
static const ${real} ki_half_period[LEVELS] = ${Ki}; /* Ki period / 2 */
static const ${real} kd[LEVELS] = ${Kd};
static const ${real} b[LEVELS] = ${b}; /* weight of the set point in the proportional part */
static const ${real} c[LEVELS] = ${c}; /* and in the derivative part */
static const ${real} filter_time[LEVELS] = ${filter_time}; /* s, of the derivative */

#define PERIOD ${period}

/* the value of a table at part `share` of the way from level i to the next */
static ${real} between(const ${real} *values, int i, ${real} share)
{
    return i + 1 < LEVELS ? values[i] + share * (values[i + 1] - values[i]) : values[i];
}

void ${name}_init(struct ${name} *state, ${real} measurement, ${real} command)
{
    state->held = command;
    state->derivative = ${zero};
    state->error = ${zero};
    state->measurement = measurement;
    state->reference = measurement;
}

${real} ${name}_update(struct ${name} *state, ${real} measurement, ${real} reference)
{
    const ${real} error = reference - measurement;
    const ${real} moved = measurement - state->measurement, asked = reference - state->reference;
    ${real} share = ${zero}, added, before, wanted, command, filter;
    int i = 0;

    while (i + 1 < LEVELS && measurement >= levels[i + 1])
        i++;
    if (i + 1 < LEVELS && measurement > levels[i])
        share = (measurement - levels[i]) / (levels[i + 1] - levels[i]);
    added = between(ki_half_period, i, share) * (error + state->error);
    before = state->held + between(kp, i, share) * (between(b, i, share) * asked - moved);
    filter = between(filter_time, i, share);
    state->derivative = (filter * state->derivative + between(kd, i, share) * (between(c, i, share) * asked - moved)) / (filter + PERIOD);
    wanted = before + added + state->derivative;
    command = wanted;
${clip}    state->held = before;
${settle}    state->error = error;
    state->measurement = measurement;
    state->reference = reference;
    return command;
}
""")


def scheduled_to_c(
    parameters: Schedule,
    folder: str | os.PathLike[str],
    *,
    period: float,
    lower: float = -math.inf,
    upper: float = math.inf,
    anti_windup: str = "clamping",
    tracking_time: float | None = None,
    name: str = "scheduled",
    number: str = "double",
    units: Mapping[str, str] | None = None,
    note: str = "",
) -> CFiles:
    """Write the `scheduling.law` of these parameters and settings as C99, NAME.h and NAME.c: struct NAME, NAME_init and
    NAME_update.

    `number`: "double" or "float"; `units` of "measurement" and "command" and `note` go into the header's comment. No
    memory is allocated, no library called. Raises SimulationError for what the controller refuses, and for numbers that
    do not fit.
    """
    checked_name(name)
    checked_number(number, ("double", "float"))
    settings = checked(Settings(float(period), float(lower), float(upper), anti_windup, tracking_time))
    levels = np.asarray(parameters.levels, dtype=float)
    if levels.ndim != 1 or len(levels) < 2 or np.any(np.diff(levels) <= 0):
        raise SimulationError(f"The levels are {levels.tolist()}; give two or more, ascending.")
    gains = Gains(*(np.broadcast_to(np.asarray(v, dtype=float), levels.shape) for v in parameters.gains))
    checked_finite({"levels": levels, **gains._asdict()}, number)
    zero = literal(0.0, number)
    tables = gains._asdict() | {"Ki": 0.5 * settings.period * gains.Ki}
    settle = (
        SETTLE[anti_windup][1]
        .format(zero=zero, follow=literal(settings.follow, number))
        .replace("s->integral", "state->held")
    )
    defined = DEFINED.substitute(
        name=name, real=number, m=len(levels), levels=table(levels, number), period=literal(settings.period, number),
        zero=zero,
        clip=clipped("command", settings.lower, settings.upper, number), settle=settle,
        **{k: table(v, number) for k, v in tables.items()},
    )  # fmt: skip
    y, u = (units or {}).get("measurement", "its unit"), (units or {}).get("command", "its unit")
    told = [
        f"PID every {settings.period:g} s with gains interpolated between {len(levels)} levels of the measurement.",
        f"Measurement and reference in {y}, command in {u}, levels {', '.join(f'{v:g}' for v in levels)}.",
        f"Command limited to [{settings.lower:g}, {settings.upper:g}], anti-windup: {settings.anti_windup}.",
        *note.splitlines(),
    ]
    declared = DECLARED.substitute(
        name=name, UPPER=name.upper(), real=number, period=literal(settings.period, "double")
    )
    return write_c(folder, name, told, declared, defined)
