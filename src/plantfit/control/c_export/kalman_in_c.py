"""A Kalman filter as C."""

import os
from string import Template

import numpy as np

from plantfit.control.c_export.estimator import estimator_steps, sizes, story
from plantfit.control.c_export.files import CFiles, checked_name, checked_number, write_c
from plantfit.control.linear.kalman import Estimator, fitting
from plantfit.control.linear.linear_plant import LinearPlant
from plantfit.errors import SimulationError

DECLARED = Template("""
struct ${name} {
    ${real} x[${UPPER}_STATES]; /* the estimated states */
};

/* Once, at the first measurement: the plant rested there. */
void ${name}_init(struct ${name} *state, const ${real} *measurement);

/* x with the measurement, taken while the input acted. */
void ${name}_correct(struct ${name} *state, const ${real} *measurement, const ${real} *input);

/* x a period later, with the input held. */
void ${name}_predict(struct ${name} *state, const ${real} *input);
""")

DEFINED = Template("""
static void kept(struct ${name} *state, const ${real} *x)
{
    int i;
    for (i = 0; i < STATES; i++)
        state->x[i] = x[i];
}

void ${name}_init(struct ${name} *state, const ${real} *measurement)
{
    begun(&filters[0], measurement, state->x);
}

void ${name}_correct(struct ${name} *state, const ${real} *measurement, const ${real} *input)
{
    ${real} x[STATES];
${unused}    corrected(&filters[0], state->x, measurement, ${u}x);
    kept(state, x);
}

void ${name}_predict(struct ${name} *state, const ${real} *input)
{
    ${real} x[STATES];
    predicted(&filters[0], state->x, input, x);
    kept(state, x);
}
""")


def kalman_to_c(
    estimator: Estimator,
    plant: LinearPlant,
    period: float,
    folder: str | os.PathLike[str],
    *,
    name: str = "kalman",
    number: str = "double",
    note: str = "",
) -> CFiles:
    """Write the filter that `kalman_observer(plant, period, ..)` gave as C99, NAME.h and NAME.c: NAME_init,
    NAME_correct, NAME_predict.

    `number`: "double" or "float"; `note` goes into the header's comment. Raises SimulationError for what does not fit.
    """
    checked_name(name)
    checked_number(number, ("double", "float"))
    if not (np.isfinite(period) and period > 0):
        raise SimulationError(f"period = {period}; give the sampling period in seconds, above 0.")
    told = ["Steady-state Kalman filter.", *story(plant, period), *note.splitlines()]
    common = {"name": name, "UPPER": name.upper(), "real": number}
    steps, u = estimator_steps(name, [fitting(plant, period, estimator)], number)
    defined = steps + DEFINED.substitute(common, u="input, " if u else "", unused="" if u else "    (void)input;\n")
    return write_c(folder, name, told, sizes(name, plant, period) + DECLARED.substitute(common), defined)
