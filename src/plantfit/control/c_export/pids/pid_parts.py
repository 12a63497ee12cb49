"""The PID law of `control.pid` as static C functions, for controllers that are made of several or that look ahead."""

from collections.abc import Sequence
from string import Template

from plantfit.control.c_export.files import checked_finite, literal
from plantfit.control.pid import Gains

STATE = Template("""/* Not to be read or written elsewhere. */
struct ${name}_pid {
    ${real} integral, derivative; /* parts of a command */
    ${real} error, weighted;      /* reference - measurement, c reference - measurement, of the last sample */
};
""")

LAW = Template("""struct gains {
    ${real} kp, ki_half_period, kd;
    ${real} b, c;        /* weights of the set point in the proportional and the derivative part */
    ${real} filter_time; /* s, of the derivative */
    ${real} per_time;    /* 1 / (filter time + period) */
};

static const struct gains gains[${count}] = ${rows};

/* at rest at a measurement that is the set point, with this command */
static void pid_begin(const struct gains *g, struct ${name}_pid *s, ${real} measurement, ${real} command)
{
    s->integral = command - g->kp * (g->b - ${one}) * measurement;
    s->derivative = ${zero};
    s->error = ${zero};
    s->weighted = (g->c - ${one}) * measurement;
}

/* the command before any limit, with the part of it that the integral is about to take */
static ${real} pid_wanted(const struct gains *g, struct ${name}_pid *s, ${real} measurement, ${real} reference, ${real} *added)
{
    const ${real} error = reference - measurement, weighted = g->c * reference - measurement;
    *added = g->ki_half_period * (error + s->error);
    s->derivative = (g->filter_time * s->derivative + g->kd * (weighted - s->weighted)) * g->per_time;
    s->error = error;
    s->weighted = weighted;
    return g->kp * (g->b * reference - measurement) + (s->integral + *added) + s->derivative;
}

/* the integral takes its part, ${windup} */
static void pid_settle(struct ${name}_pid *s, ${real} added, ${real} wanted, ${real} command)
{
${settle}}

""")

SETTLE = {
    "clamping": (
        "unless it would drive a limited command further",
        "    if (!((wanted > command && added > {zero}) || (wanted < "
        "command && added < {zero})))\n        s->integral += added;\n",
    ),
    "back-calculation": (
        "and gives back a share of what a limit takes off",
        "    s->integral = s->integral + added + {follow} * (command - wanted);\n",
    ),
    "none": ("whatever the limits", "    (void)wanted;\n    (void)command;\n    s->integral += added;\n"),
}  # fmt: skip


def pid_state(name: str, real: str) -> str:
    """The declaration of struct NAME_pid."""
    return STATE.substitute(name=name, real=real)


def pid_law_in_c(name: str, every: Sequence[Gains], period: float, anti_windup: str, follow: float, real: str) -> str:
    """Static tables `gains[i]` of PIDs and `pid_begin`, `pid_wanted`, `pid_settle` on struct NAME_pid, in `real`."""
    rows = []
    for g in every:
        numbers = [g.Kp, 0.5 * period * g.Ki, g.Kd, g.b, g.c, g.filter_time, 1.0 / (g.filter_time + period)]
        checked_finite(dict(zip(("Kp", "Ki", "Kd", "b", "c", "filter_time", "period"), numbers, strict=True)), real)
        rows.append("{" + ", ".join(literal(float(v), real).strip("()") for v in numbers) + "}")
    why, settle = SETTLE[anti_windup]
    zero = literal(0.0, real)
    return LAW.substitute(
        name=name, real=real, zero=zero, one=literal(1.0, real), count=len(rows), rows="{" + ", ".join(rows) + "}",
        windup=why,
        settle=settle.format(zero=zero, follow=literal(follow, real)),
    )  # fmt: skip
