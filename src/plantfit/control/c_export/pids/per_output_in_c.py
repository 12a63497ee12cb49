"""PIDs of several outputs whose commands add up, as C."""

import os
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
from plantfit.control.linear.design import Design
from plantfit.control.pid import Gains
from plantfit.errors import SimulationError

DECLARED = Template("""#define ${UPPER}_PERIOD_S ${period}

enum { ${UPPER}_OUTPUTS = ${n} };

${pid}
/* Not to be read or written elsewhere. */
struct ${name} {
    struct ${name}_pid pid[${n}];
};

/* Once, at the first measurement. Integral and derivative parts begin at 0: the first command is that of the point above and, of each PID,
 * Kp (b reference - measurement). */
void ${name}_init(struct ${name} *state, const ${real} *measurement);

/* The command, once a period. `reference` holds the outputs to follow; 0 for those of the point above. */
${real} ${name}_update(struct ${name} *state, const ${real} *measurement, const ${real} *reference);
""")

DEFINED = Template("""enum { OUTPUTS = ${UPPER}_OUTPUTS };

static const ${real} held[OUTPUTS] = ${held};

${law}void ${name}_init(struct ${name} *state, const ${real} *measurement)
{
    int i;
    for (i = 0; i < OUTPUTS; i++) {
        state->pid[i].integral = ${zero};
        state->pid[i].derivative = ${zero};
        state->pid[i].error = ${zero};
        state->pid[i].weighted = (gains[i].c - ${one}) * measurement[i];
    }
}

${real} ${name}_update(struct ${name} *state, const ${real} *measurement, const ${real} *reference)
{
    ${real} added[OUTPUTS], wanted = ${rest}, command;
    int i;

    for (i = 0; i < OUTPUTS; i++)
        wanted += pid_wanted(&gains[i], &state->pid[i], measurement[i], reference ? reference[i] : held[i], &added[i]);
    command = wanted;
${clip}    for (i = 0; i < OUTPUTS; i++) /* by the limits of the sum: parts beyond them may cancel */
        pid_settle(&state->pid[i], added[i], wanted, command);
    return command;
}
""")


def per_output_to_c(
    design: Design, folder: str | os.PathLike[str], *, name: str, number: str = "double", note: str = ""
) -> CFiles:
    """Write a `pid_per_output` design as C99, NAME.h and NAME.c: struct NAME, NAME_init, NAME_update; see
    `design_to_c`."""
    checked_name(name)
    checked_number(number, ("double", "float"))
    plant = design.plant
    if design.limits is None or set(design.parameters) != set(plant.outputs):
        raise SimulationError(
            f"The design's PIDs are those of {sorted(design.parameters)}; give one made by pid_per_output."
        )
    every = [Gains(*(float(v) for v in design.parameters[n])) for n in plant.outputs]
    for g in every:
        checked_finite(g._asdict(), number)
    low, high = (float(v[0]) for v in design.limits)
    zero = literal(0.0, number)
    law = pid_law_in_c(name, every, design.period, "clamping", 0.0, number)
    begin = law.index("/* at rest at a measurement")  # the sum of the PIDs rests at the command of the point, each at 0
    law = law[:begin] + law[law.index("/* the command before any limit") :]
    common = {
        "name": name,
        "UPPER": name.upper(),
        "real": number,
        "n": len(every),
        "zero": zero,
        "one": literal(1.0, number),
    }
    defined = DEFINED.substitute(
        common, held=table(np.asarray(plant.y0), number), law=law, rest=literal(float(plant.u0[0]), number),
        clip=clipped("command", low, high, number),
    )  # fmt: skip
    told = [
        f"A PID of each of {', '.join(plant.outputs)} every {design.period:g} s; their commands add up to "
        f"{plant.inputs[0]}.",
        f"Measurements and references in the order {', '.join(plant.outputs)}; linearised at "
        f"{np.asarray(plant.y0).tolist()} with "
        f"{plant.inputs[0]} = {float(plant.u0[0]):g}.",
        f"Command limited to [{low:g}, {high:g}]; an integral rests while it would drive the sum further beyond.",
        *note.splitlines(),
    ]
    declared = DECLARED.substitute(common, period=literal(design.period, "double"), pid=pid_state(name, number))
    return write_c(folder, name, told, declared, defined)
