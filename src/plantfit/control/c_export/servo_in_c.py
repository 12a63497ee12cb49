"""An LQ servo as C: its filter, its gains, the inputs on their way and the set point."""

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
from plantfit.control.linear.servo import Servo
from plantfit.control.pid import Settings, checked

DECLARED = Template("""#define ${UPPER}_PERIOD_S ${period}

enum { ${UPPER}_STATES = ${n}, ${UPPER}_PAST = ${p} };

/* Not to be read or written elsewhere. */
struct ${name} {
    ${real} x[${n}]; /* states as predicted for the next sample, the load at the input last */
    ${real} past[${room}]; /* the last inputs, the newest first */
    ${real} followed; /* the set point, as it is followed */
};

/* Once, with the first measurement and the command at which the plant rests there, the set point at the measurement. */
void ${name}_init(struct ${name} *state, ${real} measurement, ${real} command);

/* The command, once a period. */
${real} ${name}_update(struct ${name} *state, ${real} measurement, ${real} reference);
""")

MATRICES = Template("""static const ${real} A[STATES][STATES] = ${A};
static const ${real} B[STATES][PAST + 1] = ${B}; /* of the inputs, the newest first */
static const ${real} C[STATES] = ${C};
static const ${real} D = ${D}; /* of the last input */
static const ${real} gain[STATES] = ${gain}; /* of what the prediction misses */
""")

# the state at rest, and after a command
BEGUN = """    const {real} y = measurement - Y0, u = command - U0;
    int i;
    for (i = 0; i < STATES; i++)
        state->x[i] = rest[i] * y;
    state->x[STATES - 1] -= u;
    state->past[0] = u;
    for (i = 1; i < PAST; i++)
        state->past[i] = u;
    state->followed = y;
"""

PREDICTED = """    for (i = 0; i < STATES; i++) {
        state->x[i] = B[i][0] * command;
        for (k = 0; k < STATES; k++)
            state->x[i] += A[i][k] * x[k];
        for (k = 0; k < PAST; k++)
            state->x[i] += B[i][k + 1] * state->past[k];
    }
    for (i = PAST - 1; i > 0; i--)
        state->past[i] = state->past[i - 1];
    state->past[0] = command;
"""

DEFINED = Template("""enum { STATES = ${UPPER}_STATES, PAST = ${UPPER}_PAST };

#define U0 ${u0} /* the command and the measurement about which the plant was linearised */
#define Y0 ${y0}
#define F ${f} /* of the set point */
#define SHARE ${share} /* of the way to it, in a period */

${matrices}static const ${real} K[STATES] = ${K};
static const ${real} P[${room}] = ${P};
static const ${real} rest[STATES] = ${rest}; /* states and input that rest where the measurement is 1 higher */

/* x becomes the state after the measurement, of the state that was predicted */
static void corrected(const struct ${name} *state, ${real} y, ${real} *x)
{
    ${real} missed = y - D * state->past[0];
    int i;
    for (i = 0; i < STATES; i++)
        missed -= C[i] * state->x[i];
    for (i = 0; i < STATES; i++)
        x[i] = state->x[i] + gain[i] * missed;
}

void ${name}_init(struct ${name} *state, ${real} measurement, ${real} command)
{
${begun}}

${real} ${name}_update(struct ${name} *state, ${real} measurement, ${real} reference)
{
    ${real} x[STATES], command;
    int i, k;

    state->followed += SHARE * (reference - Y0 - state->followed);
    command = F * state->followed;
    corrected(state, measurement - Y0, x);
    for (i = 0; i < STATES; i++)
        command -= K[i] * x[i];
    for (i = 0; i < PAST; i++)
        command -= P[i] * state->past[i];
${clip}${predicted}    return command + U0;
}
""")


def plant_in_c(arrays: Mapping[str, np.ndarray], d: float, number: str) -> dict[str, str]:
    """What LQ servos share: the matrices of the plant and its filter, their state at rest and after a command."""
    rows = {name: table(arrays[name], number) for name in ("A", "B", "C", "gain")}
    matrices = MATRICES.substitute(rows, D=literal(d, number), real=number)
    return {"matrices": matrices, "begun": BEGUN.format(real=number), "predicted": PREDICTED}


def servo_to_c(
    parameters: Servo,
    folder: str | os.PathLike[str],
    *,
    period: float,
    lower: float,
    upper: float,
    name: str = "lqi",
    number: str = "double",
    units: Mapping[str, str] | None = None,
    note: str = "",
) -> CFiles:
    """Write the `linear.servo` of these parameters and settings as C99, NAME.h and NAME.c: struct NAME, NAME_init and
    NAME_update.

    `number`: "double" or "float"; `units` of "measurement" and "command" and `note` go into the header's comment. No
    memory is allocated, no library called. Raises SimulationError for what `servo` refuses, and for numbers that do not
    fit.
    """
    checked_name(name)
    checked_number(number, ("double", "float"))
    settings = checked(Settings(float(period), float(lower), float(upper), "none", None))
    s = Servo(*(np.asarray(v, dtype=float) for v in parameters))
    checked_finite(s._asdict(), number)
    n, p = len(s.A), len(s.P)
    common = {"name": name, "UPPER": name.upper(), "real": number, "n": n, "p": p, "room": max(p, 1)}
    numbers = {"u0": s.u0, "y0": s.y0, "f": s.f, "share": s.share}
    past = s.P if p else np.zeros(1)
    arrays = {"A": s.A, "B": s.B, "C": s.C, "gain": s.gain, "K": s.K, "P": past, "rest": s.rest}
    defined = DEFINED.substitute(
        common | plant_in_c(arrays, float(s.D), number),
        **{key: literal(float(value), number) for key, value in numbers.items()},
        **{key: table(value, number) for key, value in arrays.items()},
        clip=clipped("command", float(settings.lower - s.u0), float(settings.upper - s.u0), number),
    )
    y, u = (units or {}).get("measurement", "its unit"), (units or {}).get("command", "its unit")
    told = [
        f"LQ servo with a Kalman filter that estimates the load, every {settings.period:g} s.",
        f"Measurement and reference in {y}, command in {u}.",
        f"{n - 1} states and the load, {p} past inputs for the dead time; linearised at {float(s.y0):g} {y} with "
        f"{float(s.u0):g} {u}.",
        f"Command limited to [{settings.lower:g}, {settings.upper:g}]; the filter knows it.",
        *note.splitlines(),
    ]
    return write_c(folder, name, told, DECLARED.substitute(common, period=literal(settings.period, "double")), defined)
