"""The discrete PID of `control.pid` in C, in fixed point."""

from collections.abc import Mapping
from string import Template

from plantfit.control.c_export.files import literal
from plantfit.control.c_export.pids.scaling import FRACTION, UNIT, Scaling, scaled
from plantfit.control.pid import Gains, Settings

BITS = {"q15": 16, "q31": 32}

DECLARED = Template("""#define ${UPPER}_PERIOD_S ${period}
#define ${UPPER}_MEASUREMENT_STEP ${measurement} /* value of 1 in measurement and reference */
#define ${UPPER}_COMMAND_STEP ${command} /* value of 1 in the command */
#define ${UPPER}_ERROR_BOUND ${bound} /* steps of the command, see above */

/* Not to be read or written elsewhere. */
struct ${name} {
    int64_t integral, derivative; /* parts of the command, with ${fraction} binary places */
    int64_t remainder;            /* of the integral, below these places */
    ${word} reference, measurement; /* of the last sample */
};

/* Once, with the first measurement and the command at which the plant rests there, within its limits:
 * while measurement and reference stay at it, so does the command. Where it is not known, give the command of the moment. */
void ${name}_init(struct ${name} *state, ${word} measurement, ${word} command);

/* The command, once a period. */
${word} ${name}_update(struct ${name} *state, ${word} measurement, ${word} reference);
""")

DEFINED = Template("""/* Coefficients are 2^-(SHIFT + ${fraction}) steps of the command per step of the measurement. */
#define KP_REFERENCE ${p_r}
#define KP_MEASUREMENT ${p_y}
#define KP_SHIFT ${p_shift}
#define KI ${i} /* for the sum of two errors */
#define KI_SHIFT ${i_shift}
#define KD_REFERENCE ${d_r}
#define KD_MEASUREMENT ${d_y}
#define KD_SHIFT ${d_shift}
${more}#define LOWER INT64_C(${fine_low}) /* with ${fraction} binary places */
#define UPPER INT64_C(${fine_high})
#define LOWER_STEPS INT64_C(${low})
#define UPPER_STEPS INT64_C(${high})
#define LARGEST (INT64_C(1) << 61)

/* value / 2^places rounded down; C leaves >> of negative numbers to the compiler */
static int64_t shifted(int64_t value, int places)
{
    return value >= 0 ? value >> places : ~(~value >> places);
}

static int64_t within(int64_t value, int64_t low, int64_t high)
{
    return value < low ? low : value > high ? high : value;
}
${fraction_of}
void ${name}_init(struct ${name} *state, ${word} measurement, ${word} command)
{
    const int64_t y = measurement, proportional = shifted(KP_REFERENCE * y - KP_MEASUREMENT * y, KP_SHIFT);

    state->integral = within(command, LOWER_STEPS, UPPER_STEPS) * (INT64_C(1) << ${fraction}) - proportional;
    state->derivative = 0;
    state->remainder = 0;
    state->reference = measurement;
    state->measurement = measurement;
}

${word} ${name}_update(struct ${name} *state, ${word} measurement, ${word} reference)
{
    const int64_t r = reference, y = measurement, last_r = state->reference, last_y = state->measurement;
    const int64_t proportional = shifted(KP_REFERENCE * r - KP_MEASUREMENT * y, KP_SHIFT);
    const int64_t change = shifted(KD_REFERENCE * (r - last_r) - KD_MEASUREMENT * (y - last_y), KD_SHIFT);
    const int64_t derivative = ${past}change;
    const int64_t added = KI * (r - y + last_r - last_y); /* nothing of it is lost: the rest waits in the remainder */
    const int64_t whole = shifted(added + state->remainder, KI_SHIFT);
    const int64_t integral = within(state->integral + whole, -LARGEST, LARGEST);
    const int64_t wanted = proportional + integral + derivative;
    const int64_t limited = within(wanted, LOWER, UPPER);

${windup}    state->derivative = derivative;
    state->reference = reference;
    state->measurement = measurement;
    return (${word})within(shifted(limited + ${half}, ${fraction}), LOWER_STEPS, UPPER_STEPS);
}
""")

FRACTION_OF = Template("""
/* value * part / 2^${unit} rounded down, for 0 <= part <= 2^${unit} and |value| <= 2^62 */
static int64_t fraction_of(int64_t value, int64_t part)
{
    const int64_t high = shifted(value, ${unit}), low = value - high * (INT64_C(1) << ${unit});
    return high * part + shifted(low * part, ${unit});
}
""")

ADDED = "{0}state->integral = integral;\n{0}state->remainder += added - whole * (INT64_C(1) << KI_SHIFT);\n"


def fixed_pid(
    name: str, gains: Gains, settings: Settings, number: str, full_scale: Mapping[str, float] | None
) -> tuple[str, str, Scaling]:
    """Declarations and definitions in "q15" or "q31", and the scaling."""
    scaling = scaled(gains, settings, BITS[number], full_scale)
    more = ""
    if scaling.kept:
        more += f"#define KEPT INT64_C({scaling.kept}) /* of the derivative, in 2^-{UNIT} */\n"
    if scaling.follow:
        more += f"#define FOLLOW INT64_C({scaling.follow}) /* period / tracking time, in 2^-{UNIT} */\n"
    common = {"name": name, "UPPER": name.upper(), "word": f"int{scaling.bits}_t", "fraction": FRACTION}
    declared = DECLARED.substitute(
        common,
        period=literal(settings.period, "double"),
        measurement=literal(scaling.steps[0], "double"),
        command=literal(scaling.steps[1], "double"),
        bound=literal(scaling.bound, "double"),
    )
    p, i, d = scaling.proportional, scaling.integral, scaling.derivative
    whole = {
        "p_r": p.mantissas[0],
        "p_y": p.mantissas[1],
        "i": i.mantissas[0],
        "d_r": d.mantissas[0],
        "d_y": d.mantissas[1],
    }
    defined = DEFINED.substitute(
        common,
        **{key: f"INT64_C({value})" if value >= 0 else f"(-INT64_C({-value}))" for key, value in whole.items()},
        p_shift=p.shift,
        i_shift=i.shift,
        d_shift=d.shift,
        more=more,
        fine_low=scaling.fine_limits[0],
        fine_high=scaling.fine_limits[1],
        low=scaling.raw_limits[0],
        high=scaling.raw_limits[1],
        fraction_of=FRACTION_OF.substitute(unit=UNIT) if scaling.kept or scaling.follow else "",
        past="fraction_of(state->derivative, KEPT) + " if scaling.kept else "",
        half=2 ** (FRACTION - 1),
        windup=_windup(settings.anti_windup),
    )
    return declared, defined, scaling


def _windup(kind: str) -> str:
    if kind == "none":
        return ADDED.format(" " * 4)
    if kind == "clamping":
        why = "    /* the integral rests while it would drive the command further beyond a limit */\n"
        return (
            f"{why}    if (!((wanted > UPPER && added > 0) || (wanted < LOWER && added < 0))) "
            f"{{\n{ADDED.format(' ' * 8)}    }}\n"
        )
    return (
        ADDED.format(" " * 4)
        + "    state->integral = within(integral + fraction_of(limited - wanted, FOLLOW), -LARGEST, LARGEST);\n"
    )
