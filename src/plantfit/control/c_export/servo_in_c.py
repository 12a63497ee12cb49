"""An LQ servo as C: its filter, its gains, the inputs on their way and the limited integral."""

import os
from collections.abc import Mapping
from string import Template

import numpy as np

from plantfit.control.c_export.files import CFiles, checked_finite, checked_name, checked_number, clipped, literal, table, write_c
from plantfit.control.c_export.floating_pid import windup
from plantfit.control.linear.servo import Servo, resting
from plantfit.control.pid import Settings, checked

DECLARED = Template("""#define ${UPPER}_PERIOD_S ${period}

enum { ${UPPER}_STATES = ${n}, ${UPPER}_PAST = ${p} };

/* Not to be read or written elsewhere. */
struct ${name} {
    ${real} x[${n}];    /* states as predicted for the next sample */
    ${real} past[${room}]; /* the last inputs, the newest first */
    ${real} integral; /* part of the command */
};

/* Once, with the first measurement and the command at which the plant rests there, the set point at the measurement. */
void ${name}_init(struct ${name} *state, ${real} measurement, ${real} command);

/* The command, once a period. */
${real} ${name}_update(struct ${name} *state, ${real} measurement, ${real} reference);
""")

DEFINED = Template("""enum { STATES = ${UPPER}_STATES, PAST = ${UPPER}_PAST };

#define U0 ${u0} /* the command and the measurement about which the plant was linearised */
#define Y0 ${y0}
#define F ${f} /* of the set point */
#define KI_PERIOD ${ki} /* Ki period */
${more}
static const ${real} A[STATES][STATES] = ${A};
static const ${real} B[STATES][PAST + 1] = ${B}; /* of the inputs, the newest first */
static const ${real} C[STATES] = ${C};
static const ${real} D = ${D}; /* of the last input */
static const ${real} gain[STATES] = ${gain}; /* of what the prediction misses */
static const ${real} K[STATES] = ${K};
static const ${real} P[${room}] = ${P};
static const ${real} begin[STATES][2] = ${begin}; /* states at rest, of measurement and command */

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
    const ${real} y = measurement - Y0, u = command - U0;
    ${real} x[STATES];
    int i;
    for (i = 0; i < STATES; i++)
        state->x[i] = begin[i][0] * y + begin[i][1] * u;
    state->past[0] = u;
    for (i = 1; i < PAST; i++)
        state->past[i] = u;
    corrected(state, y, x);
    state->integral = u - F * y;
    for (i = 0; i < STATES; i++)
        state->integral += K[i] * x[i];
    for (i = 0; i < PAST; i++)
        state->integral += P[i] * u;
}

${real} ${name}_update(struct ${name} *state, ${real} measurement, ${real} reference)
{
    const ${real} added = KI_PERIOD * (reference - measurement), integral = state->integral + added;
    ${real} x[STATES], wanted = F * (reference - Y0) + state->integral, command;
    int i, k;

    corrected(state, measurement - Y0, x);
    for (i = 0; i < STATES; i++)
        wanted -= K[i] * x[i];
    for (i = 0; i < PAST; i++)
        wanted -= P[i] * state->past[i];
    command = wanted;
${clip}${windup}    for (i = 0; i < STATES; i++) {
        state->x[i] = B[i][0] * command;
        for (k = 0; k < STATES; k++)
            state->x[i] += A[i][k] * x[k];
        for (k = 0; k < PAST; k++)
            state->x[i] += B[i][k + 1] * state->past[k];
    }
    for (i = PAST - 1; i > 0; i--)
        state->past[i] = state->past[i - 1];
    state->past[0] = command;
    return command + U0;
}
""")


def servo_to_c(
    parameters: Servo,
    folder: str | os.PathLike[str],
    *,
    period: float,
    lower: float,
    upper: float,
    anti_windup: str = "clamping",
    tracking_time: float | None = None,
    name: str = "lqi",
    number: str = "double",
    units: Mapping[str, str] | None = None,
    note: str = "",
) -> CFiles:
    """Write the `linear.servo` of these parameters and settings as C99, NAME.h and NAME.c: struct NAME, NAME_init and NAME_update.

    `number`: "double" or "float"; `units` of "measurement" and "command" and `note` go into the header's comment. No memory is allocated,
    no library called. Raises SimulationError for what `servo` refuses, and for numbers that do not fit.
    """
    checked_name(name)
    checked_number(number, ("double", "float"))
    settings = checked(Settings(float(period), float(lower), float(upper), anti_windup, tracking_time))
    s = Servo(*(np.asarray(v, dtype=float) for v in parameters))
    checked_finite(s._asdict(), number)
    n, p = len(s.A), len(s.P)
    begin = np.stack([np.linalg.solve(*resting(s, dy, du)) for dy, du in ((1.0, 0.0), (0.0, 1.0))], axis=1)
    common = {"name": name, "UPPER": name.upper(), "real": number, "n": n, "p": p, "room": max(p, 1)}
    numbers = {"u0": s.u0, "y0": s.y0, "f": s.f, "ki": settings.period * s.Ki, "D": s.D}
    past = s.P if p else np.zeros(1)
    arrays = {"A": s.A, "B": s.B, "C": s.C, "gain": s.gain, "K": s.K, "P": past, "begin": begin}
    follow = anti_windup == "back-calculation"
    defined = DEFINED.substitute(
        common,
        **{key: literal(float(value), number) for key, value in numbers.items()},
        **{key: table(value, number) for key, value in arrays.items()},
        more=f"#define FOLLOW {literal(settings.follow, number)} /* period / tracking time */\n" if follow else "",
        clip=clipped("command", float(settings.lower - s.u0), float(settings.upper - s.u0), number),
        windup=windup(settings, number, float(s.u0)),
    )
    y, u = (units or {}).get("measurement", "its unit"), (units or {}).get("command", "its unit")
    told = [
        f"LQ servo with integral action and a Kalman filter, every {settings.period:g} s.",
        f"Measurement and reference in {y}, command in {u}.",
        f"{n} states, {p} past inputs for the dead time; linearised at {float(s.y0):g} {y} with {float(s.u0):g} {u}.",
        f"Command limited to [{settings.lower:g}, {settings.upper:g}], anti-windup: {anti_windup}.",
        *note.splitlines(),
    ]
    return write_c(folder, name, told, DECLARED.substitute(common, period=literal(settings.period, "double")), defined)
