"""State feedback designs as C: one regulator, or several that are blended."""

import os
from collections.abc import Mapping
from string import Template

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.c_export.estimator import estimator_steps, sizes, story
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
from plantfit.control.c_export.pids.per_output_in_c import per_output_to_c
from plantfit.control.linear.design import Design
from plantfit.control.linear.kalman import Estimator
from plantfit.control.linear.lqr import StateFeedback
from plantfit.control.linear.takagi_sugeno import Rules
from plantfit.errors import SimulationError

import jax

DECLARED = Template("""
struct ${name} {
    ${real} x[${UPPER}_STATES]; /* the states as predicted for the next sample */
    ${real} u[${UPPER}_INPUTS]; /* the last command */
};

/* Once, at the first measurement: the plant rested there. */
void ${name}_init(struct ${name} *state, const ${real} *measurement);

/* The command, once a period. `states` are to be followed and `inputs` to be added to; 0 for those of the point above. */
void ${name}_update(struct ${name} *state, const ${real} *measurement, const ${real} *states, const ${real} *inputs, ${real} *command);
""")

DEFINED = Template("""
static const ${real} gains[${rules}][INPUTS][STATES] = ${gains};
static const ${real} x_held[STATES] = ${x0}, u_held[INPUTS] = ${u0};
${memberships}
void ${name}_init(struct ${name} *state, const ${real} *measurement)
{
    int i;
${begun}    for (i = 0; i < INPUTS; i++)
        state->u[i] = u_held[i];
}

void ${name}_update(struct ${name} *state, const ${real} *measurement, const ${real} *states, const ${real} *inputs, ${real} *command)
{
    ${real} x[STATES];
    int i, k;
${corrected}    for (i = 0; i < INPUTS; i++) {
        command[i] = inputs ? inputs[i] : u_held[i];
        for (k = 0; k < STATES; k++)
            command[i] -= ${gain} * (x[k] - (states ? states[k] : x_held[k]));
    }
${clip}    for (i = 0; i < INPUTS; i++)
        state->u[i] = command[i];
${predicted}}
""")

MEMBERSHIPS = Template("""static const ${real} centres[${rules}] = ${centres};

/* how much each point applies: triangles with their tops at the centres, 1 in sum */
static void memberships(${real} premise, ${real} *share)
{
    int r;
    for (r = 0; r < ${rules}; r++)
        share[r] = ${zero};
    for (r = 0; r < ${rules} - 1 && premise > centres[r + 1]; r++)
        ;
    if (r == ${rules} - 1 || premise <= centres[0]) {
        share[r] = ${one};
        return;
    }
    share[r + 1] = (premise - centres[r]) / (centres[r + 1] - centres[r]);
    share[r] = ${one} - share[r + 1];
}

static ${real} blended_gain(const ${real} *share, int i, int k)
{
    ${real} gain = ${zero};
    int r;
    for (r = 0; r < ${rules}; r++)
        gain += share[r] * gains[r][i][k];
    return gain;
}
""")

BLENDED = Template("""    for (i = 0; i < STATES; i++)
        ${into}[i] = ${zero};
    for (r = 0; r < ${rules}; r++) {
        ${call};
        for (i = 0; i < STATES; i++)
            ${into}[i] += share[r] * part[i];
    }
""")


def design_to_c(
    design: Design, folder: str | os.PathLike[str], *, name: str, number: str = "double", note: str = ""
) -> CFiles:
    """Write an `lqr`, `takagi_sugeno` or `pid_per_output` design as C99, NAME.h and NAME.c: struct NAME, NAME_init,
    NAME_update.

    `number`: "double" or "float"; `note` goes into the header's comment. No memory is allocated, no library called.
    Raises SimulationError for designs of another kind and for what does not fit.
    """
    checked_name(name)
    checked_number(number, ("double", "float"))
    given, plant = design.parameters, design.plant
    if isinstance(given, Mapping):
        return per_output_to_c(design, folder, name=name, number=number, note=note)
    told = story(plant, design.period)
    if isinstance(given, StateFeedback):
        filters, premise, centres = [given.estimator], 0, None
        gains, x0, u0 = np.asarray(given.gain)[None], given.estimator.x0, given.estimator.u0
        told.insert(0, "State feedback u = u_ref - K (x - x_ref) with the filter that estimates x.")
    elif isinstance(given, Rules):
        centres, premise = np.asarray(given.centres), int(np.argmax(given.premise))
        filters: list[Estimator] = [jax.tree.map(lambda a, r=r: a[r], given.estimators) for r in range(len(centres))]
        gains, x0, u0 = np.asarray(given.gains), given.x0, given.u0
        told.insert(
            0,
            f"Takagi-Sugeno: state feedback blended over {plant.outputs[premise]} "
            f"= {centres.tolist()}, each with its filter.",
        )
    else:
        raise SimulationError(
            f"A design with {type(given).__name__} as its parameters has no C; export one made by "
            "lqr, takagi_sugeno or pid_per_output, a PID by pid_to_c, a filter by kalman_to_c."
        )
    lower, upper = np.asarray(given.lower), np.asarray(given.upper)
    checked_finite({"gain": gains, "x0": x0, "u0": u0}, number)
    told.append("Commands limited to " + ", ".join(f"[{a:g}, {b:g}]" for a, b in zip(lower, upper, strict=True)) + ".")
    steps, u = estimator_steps(name, filters, number)
    common = {"name": name, "UPPER": name.upper(), "real": number, "rules": len(filters), "zero": literal(0.0, number)}
    defined = steps + DEFINED.substitute(
        common,
        gains=table(gains, number),
        x0=table(x0, number),
        u0=table(u0, number),
        memberships=""
        if centres is None
        else "\n" + MEMBERSHIPS.substitute(common, centres=table(centres, number), one=literal(1.0, number)),
        gain="gains[0][i][k]" if centres is None else "blended_gain(share, i, k)",
        clip="".join(
            clipped(f"command[{k}]", float(a), float(b), number)
            for k, (a, b) in enumerate(zip(lower, upper, strict=True))
        ),
        **_moves(common, "state->u, " if u else "", None if centres is None else premise),
    )
    return write_c(
        folder,
        name,
        [*told, *note.splitlines()],
        sizes(name, plant, design.period) + DECLARED.substitute(common),
        defined,
    )


def _moves(common: dict, u: str, premise: int | None) -> dict[str, str]:
    """Statements that begin, correct and predict the states, by one filter or by all of them blended over the output
    `premise`."""
    calls = {
        "begun": ("measurement, ", "state->x"),
        "corrected": (f"state->x, measurement, {u}", "x"),
        "predicted": ("x, command, ", "state->x"),
    }
    if premise is None:
        return {call: f"    {call}(&filters[0], {given}{into});\n" for call, (given, into) in calls.items()}
    weigh = f"    memberships(measurement[{premise}], share);\n"
    declare = f"    {common['real']} share[{common['rules']}], part[STATES];\n    int r;\n"
    texts = {
        call: BLENDED.substitute(common, into=into, call=f"{call}(&filters[r], {given}part)")
        for call, (given, into) in calls.items()
    }
    return texts | {"begun": declare + weigh + texts["begun"], "corrected": declare + weigh + texts["corrected"]}
