"""The discrete PID of `control.pid` in C, in floating point."""

import math
from string import Template

from plantfit.control.c_export.files import checked_finite, clipped, literal
from plantfit.control.pid import Gains, Settings

DECLARED = Template("""#define ${UPPER}_PERIOD_S ${period}

/* Not to be read or written elsewhere. */
struct ${name} {
    ${real} integral, derivative; /* parts of the command */
    ${real} error, weighted;      /* reference - measurement, c reference - measurement, of the last sample */
};

/* Once, with the first measurement and the command at which the plant rests there:
 * while measurement and reference stay at it, so does the command. Where it is not known, give the command of the moment. */
void ${name}_init(struct ${name} *state, ${real} measurement, ${real} command);

/* The command, once a period. */
${real} ${name}_update(struct ${name} *state, ${real} measurement, ${real} reference);
""")

DEFINED = Template("""#define KP ${Kp}
#define KI_HALF_PERIOD ${Ki} /* Ki period / 2 */
#define KD ${Kd}
#define B ${b} /* weight of the set point in the proportional part */
#define C ${c} /* and in the derivative part */
${more}
void ${name}_init(struct ${name} *state, ${real} measurement, ${real} command)
{
    state->integral = command - KP * (B - ${one}) * measurement;
    state->derivative = ${zero};
    state->error = ${zero};
    state->weighted = (C - ${one}) * measurement;
}

${real} ${name}_update(struct ${name} *state, ${real} measurement, ${real} reference)
{
    const ${real} error = reference - measurement, weighted = C * reference - measurement;
    const ${real} added = KI_HALF_PERIOD * (error + state->error);
    const ${real} derivative = (${past}KD * (weighted - state->weighted)) * PER_TIME;
    const ${real} integral = state->integral + added;
    const ${real} wanted = KP * (B * reference - measurement) + integral + derivative;
    ${real} command = wanted;

${clip}${windup}    state->derivative = derivative;
    state->error = error;
    state->weighted = weighted;
    return command;
}
""")


def floating_pid(name: str, gains: Gains, settings: Settings, real: str) -> tuple[str, str]:
    """Declarations and definitions in `real`, "double" or "float"."""
    period, past = settings.period, gains.filter_time > 0
    numbers = {
        "period": period,
        "Kp": gains.Kp,
        "Ki": 0.5 * period * gains.Ki,
        "Kd": gains.Kd,
        "b": gains.b,
        "c": gains.c,
        "per_time": 1.0 / (gains.filter_time + period),
        "filter_time": gains.filter_time,
    }
    checked_finite(numbers, real)
    texts = {key: literal(value, real) for key, value in numbers.items()}
    more = [f"#define PER_TIME {texts['per_time']} /* 1 / (filter time + period) */"]
    if past:
        more.append(f"#define FILTER_TIME {texts['filter_time']} /* s, of the derivative */")
    if settings.anti_windup == "back-calculation":
        more.append(f"#define FOLLOW {literal(settings.follow, real)} /* period / tracking time */")
    common = {"name": name, "UPPER": name.upper(), "real": real, "zero": literal(0.0, real), "one": literal(1.0, real)}
    declared = DECLARED.substitute(common, period=texts["period"])
    defined = DEFINED.substitute(
        common | texts,
        more="".join(f"{line}\n" for line in more),
        past="FILTER_TIME * state->derivative + " if past else "",
        clip=clipped("command", settings.lower, settings.upper, real),
        windup=_windup(settings, real),
    )
    return declared, defined


def _windup(settings: Settings, real: str) -> str:
    if settings.anti_windup == "back-calculation":
        return "    state->integral = integral + FOLLOW * (command - wanted);\n"
    zero, beyond = literal(0.0, real), []
    if settings.anti_windup == "clamping":
        if math.isfinite(settings.upper):
            beyond.append(f"(wanted > {literal(settings.upper, real)} && added > {zero})")
        if math.isfinite(settings.lower):
            beyond.append(f"(wanted < {literal(settings.lower, real)} && added < {zero})")
    if not beyond:
        return "    state->integral = integral;\n"
    why = "    /* the integral rests while it would drive the command further beyond a limit */\n"
    return f"{why}    if (!({' || '.join(beyond)}))\n        state->integral = integral;\n"
