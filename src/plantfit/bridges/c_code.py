"""The plant as C99: rates, outputs, and a simulation by Runge-Kutta steps between the edges of its inputs."""

from typing import Any

import numpy as np

from plantfit.bridges.plant import Plant, one_line

import jax
import jax.numpy as jnp

_C_HEADER = """/* {told}
 *
 * Arrays in this order: x, u and y as above; p as the macros say. Link with -lm.
 */
#ifndef {UPPER}_PLANT_H
#define {UPPER}_PLANT_H

#define {UPPER}_STATES {n}
#define {UPPER}_INPUTS {m}
#define {UPPER}_OUTPUTS {q}
#define {UPPER}_PARAMETERS {k}

#ifdef __cplusplus
extern "C" {{
#endif

extern const double {name}_parameters[]; /* {names} */
extern const double {name}_x0[];         /* states as the recording began */
extern const double {name}_before[];     /* inputs before the first sample */

/* Outputs y (samples x outputs) at times t (samples) in s for inputs u (samples x inputs) that keep their value until the next sample.
 * steps: of the Runge-Kutta method between two edges of the inputs; {steps} were chosen for the recording. */
void {name}_simulate(const double *p, const double *x0, const double *before, int samples, const double *t, const double *u, int steps,
                     double *y);

#ifdef __cplusplus
}}
#endif

#endif
"""
_C_SOURCE = """#include <math.h>

#include "{name}_plant.h"

const double {name}_parameters[] = {{{values}}};
const double {name}_x0[] = {{{x0}}};
const double {name}_before[] = {{{before}}};

static void rates(const double *x, const double *u, const double *p, double *dx)
{{
    (void)x; (void)u; (void)p;
{rate}{rate_results}}}

static void outputs(const double *x, const double *u, const double *p, double *y)
{{
    (void)x; (void)u; (void)p;
{output}{output_results}}}

static double input_at(int i, double seen, double middle, const double *before, int samples, const double *t, const double *u)
{{
    static const int straight[] = {{{straight}}};
    int low = 0, high = samples; /* the first sample after the middle */
    while (low < high) {{
        const int half = (low + high) / 2;
        if (t[half] <= middle) low = half + 1; else high = half;
    }}
    if (low == 0) return before[i];
    if (!straight[i] || low == samples) return u[(low - 1)*{m} + i];
    return u[(low - 1)*{m} + i] + (u[low*{m} + i] - u[(low - 1)*{m} + i])*(seen - t[low - 1])/(t[low] - t[low - 1]);
}}

static void channels(double now, double middle, const double *p, const double *before, int samples, const double *t, const double *u,
                     double *c)
{{
    static const int input[] = {{{late_inputs}}}, place[] = {{{late_places}}};
    int j;
    (void)p;
    for (j = 0; j < {m}; j++) c[j] = input_at(j, now, middle, before, samples, t, u);
    for (j = 0; j < {d}; j++) c[{m} + j] = input_at(input[j], now - p[place[j]], middle - p[place[j]], before, samples, t, u);
    c[{m} + {d}] = now;
}}

/* the next edge of any input, delayed or not, after now and not after end */
static double next_edge(double now, double end, const double *p, int samples, const double *t)
{{
    static const int place[] = {{{late_places}}};
    double next = end;
    int j;
    for (j = 0; j < {d}; j++) {{
        int low = 0, high = samples;
        while (low < high) {{
            const int half = (low + high) / 2;
            if (t[half] + p[place[j]] <= now) low = half + 1; else high = half;
        }}
        if (low < samples && t[low] + p[place[j]] < next) next = t[low] + p[place[j]];
    }}
    return next;
}}

void {name}_simulate(const double *p, const double *x0, const double *before, int samples, const double *t, const double *u, int steps,
                     double *y)
{{
    double x[{n}], z[{n}], k1[{n}], k2[{n}], k3[{n}], k4[{n}], c[{m} + {d} + 1];
    int i, k, s;
    for (i = 0; i < {n}; i++) x[i] = x0[i];
    for (k = 0; k < samples; k++) {{
        channels(t[k], t[k], p, before, samples, t, u, c);
        outputs(x, c, p, y + k*{q});
        if (k + 1 == samples) break;
        double now = t[k];
        while (now < t[k + 1]) {{
            const double edge = next_edge(now, t[k + 1], p, samples, t), h = (edge - now)/steps, middle = 0.5*(now + edge);
            for (s = 0; s < steps; s++) {{
                const double at = now + s*h;
                channels(at, middle, p, before, samples, t, u, c);
                rates(x, c, p, k1);
                for (i = 0; i < {n}; i++) z[i] = x[i] + 0.5*h*k1[i];
                channels(at + 0.5*h, middle, p, before, samples, t, u, c);
                rates(z, c, p, k2);
                for (i = 0; i < {n}; i++) z[i] = x[i] + 0.5*h*k2[i];
                rates(z, c, p, k3);
                for (i = 0; i < {n}; i++) z[i] = x[i] + h*k3[i];
                channels(at + h, middle, p, before, samples, t, u, c);
                rates(z, c, p, k4);
                for (i = 0; i < {n}; i++) x[i] += h/6.0*(k1[i] + 2.0*k2[i] + 2.0*k3[i] + k4[i]);
            }}
            now = edge;
        }}
    }}
}}
"""


def c_code(plant: Plant) -> dict[str, str | bytes]:
    """Files by name: NAME_plant.h and NAME_plant.c."""
    rate, output = plant.lines("rate", "c"), plant.lines("output", "c")

    def listed(values: Any) -> str:
        return ", ".join(repr(float(v)) for v in values) or "0.0"

    def whole(values: Any) -> str:
        return ", ".join(str(int(v)) for v in values) or "0"

    inputs = list(plant.model.inputs)
    common = {
        "name": plant.name, "UPPER": plant.name.upper(), "n": len(plant.vector.states), "m": len(inputs),
        "q": len(plant.vector.outputs),
        "k": len(plant.p), "d": len(plant.model.delays),
    }  # fmt: skip
    told = "\n * ".join(_comment(line) for line in plant.story)
    header = _C_HEADER.format(**common, told=told, names=_comment(", ".join(plant.p)), steps=_steps(plant))
    typed = {"rate": "    const double {} = {};", "output": "    const double {} = {};"}
    source = _C_SOURCE.format(
        **common, values=listed(plant.p.values()), x0=listed(plant.x0[n] for n in plant.vector.states),
        before=listed(plant.before[n] for n in inputs), rate=rate.text("", typed["rate"]),
        output=output.text("", typed["output"]),
        rate_results="".join(f"    dx[{i}] = {v};\n" for i, v in enumerate(rate.results)),
        output_results="".join(f"    y[{i}] = {v};\n" for i, v in enumerate(output.results)),
        straight=whole(plant.hold[n] == "linear" for n in inputs),
        late_inputs=whole(inputs.index(d.input) for d in plant.model.delays),
        late_places=whole(list(plant.p).index(d.parameter) for d in plant.model.delays),
    )  # fmt: skip
    return {f"{plant.name}_plant.h": header, f"{plant.name}_plant.c": source}


def _comment(text: str) -> str:
    """A text inside a comment: neither its end nor the beginning of another."""
    return one_line(text).replace("*/", "* /").replace("/*", "/ *")


def _steps(plant: Plant) -> int:
    """Runge-Kutta steps between edges, a tenth of the fastest time constant at the beginning each, at least 4."""
    p = tuple(jnp.asarray(v) for v in plant.p.values())
    first = {n: float(v[0]) for n, v in plant.inputs.items()}
    u = [first[n] for n in plant.model.inputs] + [first[d.input] for d in plant.model.delays] + [float(plant.t[0])]
    x = jnp.array([plant.x0[n] for n in plant.vector.states])
    a = jax.jacfwd(lambda z: jnp.stack(plant.vector.rate(tuple(z), tuple(u), p)))(x)
    fastest = float(np.max(np.abs(np.linalg.eigvals(np.asarray(a)))))
    return int(min(max(4, np.ceil(10 * fastest * float(np.max(np.diff(plant.t))))), 1000))
