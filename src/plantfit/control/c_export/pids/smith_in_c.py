"""A Smith predictor as C: its PID, the plant without dead time, the outputs on their way and the filter of what is
missed."""

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
from plantfit.control.c_export.pids.pid_parts import pid_law_in_c, pid_state
from plantfit.control.linear.smith import Smith
from plantfit.control.pid import Gains, Settings, checked

DECLARED = Template("""#define ${UPPER}_PERIOD_S ${period}

enum { ${UPPER}_STATES = ${m}, ${UPPER}_AHEAD = ${ahead} };

${pid}
/* Not to be read or written elsewhere. */
struct ${name} {
    struct ${name}_pid pid;
    ${real} x[${m}]; /* states of the plant without its dead time */
    ${real} line[${ahead}]; /* its last outputs, the newest first */
    ${real} miss; /* what the model misses, filtered */
};

/* Once, with the first measurement and the command at which the plant rests there, the set point at the measurement. */
void ${name}_init(struct ${name} *state, ${real} measurement, ${real} command);

/* The command, once a period. */
${real} ${name}_update(struct ${name} *state, ${real} measurement, ${real} reference);
""")

DEFINED = Template("""enum { STATES = ${UPPER}_STATES, AHEAD = ${UPPER}_AHEAD };

#define U0 ${u0} /* the command and the measurement about which the plant was linearised */
#define Y0 ${y0}
#define TAKEN ${taken} /* of what is missed, in a period */

static const ${real} A[STATES][STATES] = ${A};
static const ${real} B[STATES] = ${B};
static const ${real} C[STATES] = ${C};
static const ${real} steady[STATES] = ${steady}; /* states at rest per unit of the command */

${law}static ${real} output_of(const ${real} *x)
{
    ${real} y = ${zero};
    int i;
    for (i = 0; i < STATES; i++)
        y += C[i] * x[i];
    return y;
}

void ${name}_init(struct ${name} *state, ${real} measurement, ${real} command)
{
    ${real} fast;
    int i;
    for (i = 0; i < STATES; i++)
        state->x[i] = steady[i] * (command - U0);
    fast = output_of(state->x);
    for (i = 0; i < AHEAD; i++)
        state->line[i] = fast;
    state->miss = measurement - Y0 - fast;
    pid_begin(&gains[0], &state->pid, measurement, command);
}

${real} ${name}_update(struct ${name} *state, ${real} measurement, ${real} reference)
{
    const ${real} fast = output_of(state->x);
    ${real} x[STATES], added, wanted, command;
    int i, k;

    state->miss += TAKEN * (measurement - Y0 - state->line[AHEAD - 1] - state->miss);
    wanted = pid_wanted(&gains[0], &state->pid, Y0 + fast + state->miss, reference, &added);
    command = wanted;
${clip}    pid_settle(&state->pid, added, wanted, command);
    for (i = AHEAD - 1; i > 0; i--)
        state->line[i] = state->line[i - 1];
    state->line[0] = fast;
    for (i = 0; i < STATES; i++) {
        x[i] = B[i] * (command - U0);
        for (k = 0; k < STATES; k++)
            x[i] += A[i][k] * state->x[k];
    }
    for (i = 0; i < STATES; i++)
        state->x[i] = x[i];
    return command;
}
""")


def smith_to_c(
    parameters: Smith,
    folder: str | os.PathLike[str],
    *,
    ahead: int,
    period: float,
    lower: float,
    upper: float,
    anti_windup: str = "clamping",
    tracking_time: float | None = None,
    name: str = "smith",
    number: str = "double",
    units: Mapping[str, str] | None = None,
    note: str = "",
) -> CFiles:
    """Write the `linear.smith` of these parameters and settings as C99, NAME.h and NAME.c: struct NAME, NAME_init and
    NAME_update.

    `ahead` samples of dead time; `number`: "double" or "float"; `units` of "measurement" and "command" and `note` go
    into the header's comment. No memory is allocated, no library called. Raises SimulationError for what the controller
    refuses, and for numbers that do not fit.
    """
    checked_name(name)
    checked_number(number, ("double", "float"))
    settings = checked(Settings(float(period), float(lower), float(upper), anti_windup, tracking_time))
    gains = Gains(*(float(v) for v in parameters.gains))
    s = Smith(gains, *(np.asarray(v, dtype=float) for v in parameters[1:]))
    checked_finite({k: v for k, v in s._asdict().items() if k != "gains"}, number)
    common = {
        "name": name,
        "UPPER": name.upper(),
        "real": number,
        "m": len(s.A),
        "ahead": ahead,
        "zero": literal(0.0, number),
    }
    defined = DEFINED.substitute(
        common,
        **{k: literal(float(getattr(s, k)), number) for k in ("u0", "y0", "taken")},
        **{k: table(getattr(s, k), number) for k in ("A", "B", "C", "steady")},
        law=pid_law_in_c(name, [gains], settings.period, anti_windup, settings.follow, number),
        clip=clipped("command", settings.lower, settings.upper, number),
    )
    y, u = (units or {}).get("measurement", "its unit"), (units or {}).get("command", "its unit")
    told = [
        f"Smith predictor every {settings.period:g} s: a PID on what the measurement will be "
        f"{ahead * settings.period:g} s later.",
        f"Measurement and reference in {y}, command in {u}; "
        f"linearised at {float(s.y0):g} {y} with {float(s.u0):g} {u}.",
        f"Command limited to [{settings.lower:g}, {settings.upper:g}], which the model knows; anti-windup: "
        f"{settings.anti_windup}.",
        *note.splitlines(),
    ]
    declared = DECLARED.substitute(common, period=literal(settings.period, "double"), pid=pid_state(name, number))
    return write_c(folder, name, told, declared, defined)
