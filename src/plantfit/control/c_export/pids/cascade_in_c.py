"""A cascade of a PID around a PI as C."""

import math
import os
from collections.abc import Mapping
from string import Template

from plantfit.control.c_export.files import (
    CFiles,
    checked_finite,
    checked_name,
    checked_number,
    clipped,
    literal,
    write_c,
)
from plantfit.control.c_export.pids.pid_parts import pid_law_in_c, pid_state
from plantfit.control.linear.cascade import Cascade
from plantfit.control.pid import Gains, Settings, checked
from plantfit.errors import SimulationError

DECLARED = Template("""#define ${UPPER}_PERIOD_S ${period}

${pid}
/* Not to be read or written elsewhere. */
struct ${name} {
    struct ${name}_pid outer, inner;
};

/* Once, with the first measurements and the command at which the plant rests there, the set point at the outer one. */
void ${name}_init(struct ${name} *state, ${real} outer, ${real} inner, ${real} command);

/* The command, once a period. */
${real} ${name}_update(struct ${name} *state, ${real} outer, ${real} inner, ${real} reference);
""")

DEFINED = Template("""enum { OUTER, INNER };

${law}void ${name}_init(struct ${name} *state, ${real} outer, ${real} inner, ${real} command)
{
    pid_begin(&gains[OUTER], &state->outer, outer, inner);
    pid_begin(&gains[INNER], &state->inner, inner, command);
}

${real} ${name}_update(struct ${name} *state, ${real} outer, ${real} inner, ${real} reference)
{
    ${real} outer_added, inner_added, wanted, level, asked, command, further;

    wanted = pid_wanted(&gains[OUTER], &state->outer, outer, reference, &outer_added);
    level = wanted;
${ends}    asked = pid_wanted(&gains[INNER], &state->inner, inner, level, &inner_added);
    command = asked;
${clip}    pid_settle(&state->inner, inner_added, asked, command);
    /* the outer integral rests while its set point is at an end, or the command at a limit, and the error drives it further */
    further = gains[INNER].kp < ${zero} ? -outer_added : outer_added;
    if (!((wanted > level && outer_added > ${zero}) || (wanted < level && outer_added < ${zero})${stopped}))
        state->outer.integral += outer_added;
    (void)further;
    return command;
}
""")


def cascade_to_c(
    parameters: Cascade,
    folder: str | os.PathLike[str],
    *,
    period: float,
    lower: float = -math.inf,
    upper: float = math.inf,
    inner_lower: float = -math.inf,
    inner_upper: float = math.inf,
    anti_windup: str = "clamping",
    tracking_time: float | None = None,
    name: str = "cascade",
    number: str = "double",
    signals: tuple[str, str] = ("the outer measurement", "the inner measurement"),
    inner_unit: str | None = None,
    units: Mapping[str, str] | None = None,
    note: str = "",
) -> CFiles:
    """Write the `linear.cascade` of these parameters and settings as C99, NAME.h and NAME.c: struct NAME, NAME_init and
    NAME_update.

    `number`: "double" or "float"; `signals` names both measurements, `inner_unit`, `units` of "measurement" and
    "command" and `note` go into the header's comment. No memory is allocated, no library called. Raises SimulationError
    for what the controller refuses, and for numbers that do not fit.
    """
    checked_name(name)
    checked_number(number, ("double", "float"))
    settings = checked(Settings(float(period), float(lower), float(upper), anti_windup, tracking_time))
    if not inner_lower < inner_upper:
        raise SimulationError(
            f"The inner set point's limits are [{inner_lower:g}, {inner_upper:g}]; give lower below upper."
        )
    both = [Gains(*(float(v) for v in g)) for g in parameters]
    for g in both:
        checked_finite(g._asdict(), number)
    zero = literal(0.0, number)
    stopped = ""
    if math.isfinite(settings.upper):
        stopped += f" || (command >= {literal(settings.upper, number)} && further > {zero})"
    if math.isfinite(settings.lower):
        stopped += f" || (command <= {literal(settings.lower, number)} && further < {zero})"
    common = {"name": name, "UPPER": name.upper(), "real": number, "zero": zero}
    defined = DEFINED.substitute(
        common, law=pid_law_in_c(name, both, settings.period, anti_windup, settings.follow, number),
        clip=clipped("command", settings.lower, settings.upper, number),
        ends=clipped("level", float(inner_lower), float(inner_upper), number), stopped=stopped,
    )  # fmt: skip
    y, u = (units or {}).get("measurement", "its unit"), (units or {}).get("command", "its unit")
    v = inner_unit or "its unit"
    told = [
        f"Cascade every {settings.period:g} s: a PID of {signals[0]} in {y} gives the set point of a PI of "
        f"{signals[1]} in {v}.",
        f"Reference in {y}, command in {u}, limited to [{settings.lower:g}, {settings.upper:g}], anti-windup: "
        f"{settings.anti_windup}.",
        f"Set point of the inner loop within [{inner_lower:g}, {inner_upper:g}].",
        *note.splitlines(),
    ]
    declared = DECLARED.substitute(common, period=literal(settings.period, "double"), pid=pid_state(name, number))
    return write_c(folder, name, told, declared, defined)
