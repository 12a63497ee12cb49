"""A predictive LQ servo as C: its filter, and a plan made anew every sample by a fixed number of steps."""

import os
from collections.abc import Mapping
from string import Template

import numpy as np

from plantfit.control.c_export.files import (
    CFiles,
    checked_finite,
    checked_name,
    checked_number,
    literal,
    table,
    write_c,
)
from plantfit.control.c_export.servo_in_c import plant_in_c
from plantfit.control.linear.predictive.quadratic import RELAXATION
from plantfit.control.linear.predictive.servo_mpc import STEPS, Predictive, multiplications

DECLARED = Template("""#define ${UPPER}_PERIOD_S ${period}

enum { ${UPPER}_STATES = ${n}, ${UPPER}_PAST = ${p}, ${UPPER}_ROWS = ${rows}, ${UPPER}_STEPS = ${steps} };

/* Not to be read or written elsewhere. */
struct ${name} {
    ${real} x[${n}]; /* states as predicted for the next sample, the load at the input last */
    ${real} past[${room}]; /* the last inputs, the newest first */
    ${real} followed; /* the set point, as it is followed */
    ${real} last; /* the last command */
    ${real} moved[${rows}], multipliers[${rows}]; /* where the last plan ended */
};

/* Once, with the first measurement and the command at which the plant rests there, the set point at the measurement. */
void ${name}_init(struct ${name} *state, ${real} measurement, ${real} command);

/* The command, once a period. */
${real} ${name}_update(struct ${name} *state, ${real} measurement, ${real} reference);
""")

DEFINED = Template("""enum { STATES = ${UPPER}_STATES, PAST = ${UPPER}_PAST, ROWS = ${UPPER}_ROWS, STEPS = ${UPPER}_STEPS };
enum { AHEAD = ${ahead} };

#define U0 ${u0} /* the command and the measurement about which the plant was linearised */
#define Y0 ${y0}
#define SHARE ${share} /* of the way to the set point, in a period */

${matrices}static const ${real} rest[STATES] = ${rest}; /* states and input that rest where the measurement is 1 higher */

/* what the inputs on their way will make of the states, less what rests at the set point */
static const ${real} X[AHEAD][STATES] = ${X};
static const ${real} Q[AHEAD][${room}] = ${Q};
static const ${real} g[AHEAD] = ${g};
/* rows of the plan: ${inputs} inputs${told_rows} */
static const ${real} unlimited[ROWS][AHEAD] = ${free};
static const ${real} project[ROWS][ROWS] = ${project};
static const ${real} yielding[ROWS] = ${yielding};
${ends}
static ${real} clipped(${real} value, int row)
{
${clips}    return value;
}

void ${name}_init(struct ${name} *state, ${real} measurement, ${real} command)
{
${begun}    state->last = u;
    for (i = 0; i < ROWS; i++)
        state->moved[i] = state->multipliers[i] = ${zero};
}

/* moved and multipliers after STEPS steps; row i of the plan is planned[i] + moved[i] */
static void solved(struct ${name} *state, const ${real} *planned)
{
    ${real} inner[ROWS], eased;
    int step, i, k;
    for (step = 0; step < STEPS; step++) {
        for (i = 0; i < ROWS; i++)
            inner[i] = state->moved[i] - state->multipliers[i];
        for (i = 0; i < ROWS; i++) {
            eased = ${zero};
            for (k = 0; k < ROWS; k++)
                eased += project[i][k] * inner[k];
            eased = ${relaxed} * eased - ${overstepped} * state->moved[i] + state->multipliers[i];
            state->moved[i] = eased + yielding[i] * (clipped(eased + planned[i], i) - planned[i] - eased);
            state->multipliers[i] = eased - state->moved[i];
        }
    }
}

${real} ${name}_update(struct ${name} *state, ${real} measurement, ${real} reference)
{
    ${real} x[STATES], z[AHEAD], planned[ROWS], command, missed = measurement - Y0 - D * state->past[0];
    int i, k;

    for (i = 0; i < STATES; i++)
        missed -= C[i] * state->x[i];
    for (i = 0; i < STATES; i++)
        x[i] = state->x[i] + gain[i] * missed;
    state->followed += SHARE * (reference - Y0 - state->followed);
    for (i = 0; i < AHEAD; i++) {
        z[i] = g[i] * state->followed;
        for (k = 0; k < STATES; k++)
            z[i] += X[i][k] * x[k];
        for (k = 0; k < PAST; k++)
            z[i] += Q[i][k] * state->past[k];
    }
    for (i = 0; i < ROWS; i++) {
        planned[i] = ${zero};
        for (k = 0; k < AHEAD; k++)
            planned[i] += unlimited[i][k] * z[k];
    }
${first}    solved(state, planned);
    command = planned[0] + state->moved[0];
${slow}    command = clipped(command, 0);
${predicted}    state->last = command;
    return command + U0;
}
""")

SLOW = Template("""    if (command < state->last - ${rate})
        command = state->last - ${rate};
    if (command > state->last + ${rate})
        command = state->last + ${rate};
""")


def servo_mpc_to_c(
    parameters: Predictive,
    folder: str | os.PathLike[str],
    *,
    period: float,
    inputs: int,
    rated: bool,
    steps: int = STEPS,
    name: str = "mpc",
    number: str = "double",
    units: Mapping[str, str] | None = None,
    note: str = "",
) -> CFiles:
    """Write the `servo_mpc` of these parameters and settings as C99, NAME.h and NAME.c: struct NAME, NAME_init and
    NAME_update.

    `number`: "double" or "float"; `units` of "measurement" and "command" and `note` go into the header's comment. A
    sample takes the same operations whatever happens. No memory is allocated, no library called. Raises SimulationError
    for numbers that do not fit.
    """
    checked_name(name)
    checked_number(number, ("double", "float"))
    s, plan = parameters.servo, parameters.plan
    arrays = {n: np.asarray(v, dtype=float) for n, v in (*s._asdict().items(), *plan._asdict().items(),
                                                         *plan.task._asdict().items()) if
              n not in ("task", "K", "P", "f")}  # fmt: skip
    low, high, rate = arrays.pop("low"), arrays.pop("high"), arrays.pop("rate")
    checked_finite(arrays, number)
    n, p, (rows, ahead) = len(arrays["C"]), arrays["B"].shape[1] - 1, arrays["free"].shape
    if not p:
        arrays["Q"] = np.zeros((ahead, 1))
    zero = literal(0.0, number)
    common = {
        "name": name, "UPPER": name.upper(), "real": number, "n": n, "p": p, "room": max(p, 1), "rows": rows,
        "steps": steps,
        "ahead": ahead, "inputs": inputs, "zero": zero,
    }  # fmt: skip
    watched = rows - inputs * (2 if rated else 1)
    told_rows = (f", {inputs} changes of the input" if rated else "") + (f", {watched} outputs" if watched else "")
    ends, clips = _ends(low, high, number)
    defined = DEFINED.substitute(
        common | plant_in_c(arrays, float(s.D), number),
        told_rows=told_rows,
        ends=ends,
        clips=clips,
        relaxed=literal(RELAXATION, number),
        overstepped=literal(RELAXATION - 1.0, number),
        first=f"    planned[{inputs}] -= state->last;\n" if rated else "",
        slow=SLOW.substitute(rate=literal(float(rate), number)) if rated else "",
        **{key: literal(float(arrays[key]), number) for key in ("u0", "y0", "share")},
        **{key: table(arrays[key], number) for key in ("rest", "X", "Q", "g", "free", "project", "yielding")},
    )
    y, u = (units or {}).get("measurement", "its unit"), (units or {}).get("command", "its unit")
    slow = f", its change in a sample to {float(rate):g}" if rated else ""
    told = [
        f"Model-predictive control every {period:g} s: an LQ servo with a "
        "Kalman filter that estimates the load, and a plan within limits.",
        f"Measurement and reference in {y}, command in {u}.",
        f"{n - 1} states and the load, {p} past inputs for the dead time; linearised at {float(s.y0):g} {y} with "
        f"{float(s.u0):g} {u}.",
        f"Command limited to [{low[0] + float(s.u0):g}, {high[0] + float(s.u0):g}]{slow}; the filter knows it.",
        f"Every sample takes {steps} steps of a quadratic program of {rows} rows: "
        f"{multiplications(parameters, steps)} multiplications, always the same.",
        *note.splitlines(),
    ]
    return write_c(folder, name, told, DECLARED.substitute(common, period=literal(period, "double")), defined)


def _ends(low: np.ndarray, high: np.ndarray, number: str) -> tuple[str, str]:
    """Arrays of the limits, and statements that keep a value within those of its row; infinite ones as the largest
    number."""
    most = float(np.finfo(np.float32 if number == "float" else np.float64).max)
    pairs = (("low", low), ("high", high))
    text = "".join(f"static const {number} {n}[ROWS] = {table(np.clip(v, -most, most), number)};\n" for n, v in pairs)
    clips = (
        "    if (value < low[row])\n        value = low[row];\n    if (value > high[row])\n        value = high[row];\n"
    )
    return text, clips
