"""The C that linear filters share: their matrices, and one step of each."""

from collections.abc import Mapping
from string import Template
from typing import Any

import numpy as np

from plantfit.control.c_export.files import checked_finite, literal, table
from plantfit.control.linear.kalman import Estimator
from plantfit.control.linear.linear_plant import LinearPlant
from plantfit.errors import SimulationError

SIZES = Template("""#define ${UPPER}_PERIOD_S ${period}

enum { ${UPPER}_STATES = ${n}, ${UPPER}_INPUTS = ${m}, ${UPPER}_OUTPUTS = ${p} };
""")

STEPS = Template("""enum { STATES = ${UPPER}_STATES, INPUTS = ${UPPER}_INPUTS, OUTPUTS = ${UPPER}_OUTPUTS };

/* x+ = x0 + A (x - x0) + B (u - u0),  y = y0 + C (x - x0)${D_told} */
struct filter {
    ${real} A[STATES][STATES], B[STATES][INPUTS], C[OUTPUTS][STATES]${D_declared};
    ${real} gain[STATES][OUTPUTS];  /* of what the prediction misses in y */
    ${real} begin[STATES][OUTPUTS]; /* the pseudo-inverse of C */
    ${real} x0[STATES], u0[INPUTS], y0[OUTPUTS];
};

static const struct filter filters[${rules}] = {
${filters}};

/* the state at rest nearest to x0 that is measured as y */
static void begun(const struct filter *f, const ${real} *y, ${real} *x)
{
    int i, k;
    for (i = 0; i < STATES; i++) {
        x[i] = f->x0[i];
        for (k = 0; k < OUTPUTS; k++)
            x[i] += f->begin[i][k] * (y[k] - f->y0[k]);
    }
}

/* the predicted state x after the measurement y, taken while u acted */
static void corrected(const struct filter *f, const ${real} *x, const ${real} *y, ${u_parameter}${real} *after)
{
    ${real} missed[OUTPUTS];
    int i, k;
    for (k = 0; k < OUTPUTS; k++) {
        missed[k] = y[k] - f->y0[k];
        for (i = 0; i < STATES; i++)
            missed[k] -= f->C[k][i] * (x[i] - f->x0[i]);
${D_used}    }
    for (i = 0; i < STATES; i++) {
        after[i] = x[i];
        for (k = 0; k < OUTPUTS; k++)
            after[i] += f->gain[i][k] * missed[k];
    }
}

/* the state a period later, with u held */
static void predicted(const struct filter *f, const ${real} *x, const ${real} *u, ${real} *after)
{
    int i, k;
    for (i = 0; i < STATES; i++) {
        after[i] = f->x0[i];
        for (k = 0; k < STATES; k++)
            after[i] += f->A[i][k] * (x[k] - f->x0[k]);
        for (k = 0; k < INPUTS; k++)
            after[i] += f->B[i][k] * (u[k] - f->u0[k]);
    }
}
""")

D_USED = "        for (i = 0; i < INPUTS; i++)\n            missed[k] -= f->D[k][i] * (u[i] - f->u0[i]);\n"


def sizes(name: str, plant: LinearPlant, period: float) -> str:
    """Declarations of the period and of how many signals there are."""
    numbers = {"n": len(plant.states), "m": len(plant.inputs), "p": len(plant.outputs)}
    return SIZES.substitute(numbers, UPPER=name.upper(), period=literal(period, "double"))


def estimator_steps(name: str, filters: list[Estimator], real: str) -> tuple[str, str]:
    """`begun`, `corrected` and `predicted` with the matrices of all filters, and the argument u of `corrected` (""
    or its prefix)."""
    through = any(np.any(np.asarray(f.D)) for f in filters)
    keys = ["A", "B", "C", *(["D"] if through else []), "gain", "begin", "x0", "u0", "y0"]
    rows = ""
    for one in filters:
        arrays = {**one._asdict(), "begin": np.linalg.pinv(np.asarray(one.C))}
        checked_finite(arrays, real)
        rows += (
            "    {\n"
            + "".join(f"        /* {key} */\n        {_rows(arrays[key], real)},\n" for key in keys)
            + "    },\n"
        )
    text = STEPS.substitute(
        UPPER=name.upper(),
        real=real,
        rules=len(filters),
        filters=rows,
        D_told=" + D (u - u0)" if through else "",
        D_declared=", D[OUTPUTS][INPUTS]" if through else "",
        D_used=D_USED if through else "",
        u_parameter=f"const {real} *u, " if through else "",
    )
    return text, "u" if through else ""


def _rows(values: Any, real: str) -> str:
    return table(values, real).replace("}, {", "},\n         {")


def story(plant: LinearPlant, period: float) -> list[str]:
    """Lines that say what the numbers in each array are, in which units, and where the plant was linearised."""

    def listed(names: tuple[str, ...], at: Any) -> str:
        units: Mapping[str, str | None] = plant.units
        return ", ".join(
            f"[{k}] {name} [{units.get(name) or '-'}] = {v:g}"
            for k, (name, v) in enumerate(zip(names, at, strict=True))
        )

    if not plant.inputs:
        raise SimulationError("The plant has no input; C is written for plants with one or more.")
    return [
        f"Every {period:g} s. Signals, their units and the point about which the plant was linearised:",
        f"states {listed(plant.states, plant.x0)};",
        f"inputs {listed(plant.inputs, plant.u0)};",
        f"outputs {listed(plant.outputs, plant.y0)}.",
    ]
