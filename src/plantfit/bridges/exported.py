"""`export_plant`: the plant of an answer as a file for another program, with its parameters and how its first recording begins."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer
from plantfit.bridges.straight_line import straight_line
from plantfit.control.tune.one_loop import OneLoop
from plantfit.errors import ModelError, SimulationError, StoreError
from plantfit.models.model import Model
from plantfit.problem.measure.experiment import before_in_units
from plantfit.simulate.steps.vector import VectorModel, vectorise

TARGETS = ("python", "c", "casadi", "control", "matlab", "csv")


@dataclass(frozen=True)
class Plant:
    """What every target needs: the model at one answer, and how one recording begins and goes."""

    name: str
    vector: VectorModel
    model: Model
    p: dict[str, Any]
    x0: dict[str, float]
    hold: dict[str, str]
    before: dict[str, float]
    t: np.ndarray
    inputs: dict[str, np.ndarray]
    answer: Answer
    recording: str

    @property
    def delays(self) -> list[tuple[str, float]]:
        """Input and seconds of every delayed copy."""
        return [(d.input, float(self.p[d.parameter])) for d in self.model.delays]


def export_plant(answer: Answer, to: str, folder: str | Path = ".", name: str | None = None, recording: str | None = None) -> list[Path]:
    """Write the plant for `to`, one of `TARGETS`, into `folder` and return the files (docs/tuning-controllers.md).

    Raises ModelError for a model that the target cannot hold, StoreError where a file cannot be written.
    """
    if to not in TARGETS:
        raise ModelError(f"There is no target {to!r} to export to; there are {', '.join(TARGETS)}.")
    plant = _plant(answer, name, recording)
    makers: dict[str, Callable[[Plant], dict[str, str | bytes]]] = {
        "python": _python, "c": _c, "casadi": _casadi, "control": _control, "matlab": _matlab, "csv": _csv,
    }  # fmt: skip
    files = makers[to](plant)
    folder = Path(folder)
    written = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file, content in files.items():
            place = folder / file
            place.write_bytes(content if isinstance(content, bytes) else content.encode())
            written.append(place)
    except OSError as error:
        raise StoreError(f"{folder} cannot be written: {error.strerror or error}; choose another folder with --out.") from None
    return written


def _plant(answer: Answer, name: str | None, recording: str | None) -> Plant:
    model, problem = answer.problem.model, answer.problem
    if not isinstance(model, Model) or not model.states:
        raise ModelError("A regression or a static model has nothing to simulate; export --to csv is not for it either: see to_frame().")
    if not model.smooth:
        raise ModelError(f"Model {model.name!r} has events, dry friction, backlash or late states, which no bridge carries yet.")
    recording = recording or next(iter(problem.experiments))
    experiment = problem.experiments[recording]
    if experiment.steady:
        raise ModelError(f"Recording {recording!r} is steady; name one that goes through time with --recording.")
    if experiment.initial_time is not None:
        raise ModelError(f"Recording {recording!r} begins before its first sample (initial_time); name another with --recording.")
    own = experiment.recording
    tree = problem.space.tree(answer.problem.space.physical(np.asarray(answer.best.x)), recording)
    declared = {d.name: d.value for d in model.parameters}
    p = {d.name: np.asarray(tree.get(d.name, declared[d.name]), dtype=float) for d in model.parameters}
    inputs = {n: np.asarray(own[n], dtype=float) for n in model.inputs}
    first = {n: float(v[0]) for n, v in inputs.items()}
    seen = {n: float(own[n][np.flatnonzero(np.isfinite(own[n]))[0]]) if n in own.signals else 0.0 for n in model.outputs}
    x0 = {n: 0.0 for n in model.states}
    if model.initial_state is not None:
        x0 = {n: float(v) for n, v in model.initial_state(p, first, seen).items()}
    before = {**first, **before_in_units(own, experiment.before, {**model.inputs})}
    word = re.sub(r"\W", "_", name or problem.name, flags=re.ASCII).strip("_") or "plant"
    word = word if word[0].isalpha() else f"p_{word}"
    simulator = problem.predictor.simulator
    straight = simulator.interpolated if simulator is not None else ()
    hold = {n: "linear" if n in straight else "previous" for n in model.inputs}
    return Plant(word, vectorise(model), model, p, x0, hold, before, np.asarray(own.t), inputs, answer, recording)


def _told(plant: Plant) -> list[str]:
    units = {**plant.model.states, **plant.model.inputs, **plant.model.outputs}
    groups = {"inputs": plant.model.inputs, "states": plant.vector.states, "outputs": plant.vector.outputs}
    rows = [f"{what}: {', '.join(f'{n} [{units[n]}]' if units[n] else n for n in names)}" for what, names in groups.items()]
    return [f"The plant {plant.answer.problem.name} as plantfit identified it from the recording {plant.recording}.", *rows]


def _scalars(plant: Plant, language: str) -> None:
    wrong = [n for n, v in plant.p.items() if np.ndim(v)]
    if wrong:
        raise ModelError(
            f"Model {plant.model.name!r} reads the table {wrong[0]!r}, which is not written as {language} yet; export --to csv "
            f"or control instead."
        )


def _functions(plant: Plant, language: str, names: tuple[list[str], list[str], list[str]]) -> tuple[Any, Any]:
    _scalars(plant, language)
    return tuple(straight_line(plant.vector, what, language, names) for what in ("rate", "output"))  # type: ignore[return-value]


def _body(lines: Any, indent: str, form: str = "{} = {}") -> str:
    return "".join(f"{indent}{form.format(*pair)}\n" for pair in lines.assignments)


_PYTHON = '''"""{told}

Needs numpy and scipy only. `simulate(t, u)` takes times (N,) in s and inputs by name, each (N,), and gives outputs by name.
Between samples an input keeps its value (HOLD "previous") or goes straight to the next one ("linear").
"""

import numpy as np
from scipy.integrate import solve_ivp

PARAMETERS = {parameters}
STATES = {states}
INPUTS = {inputs}
OUTPUTS = {outputs}
HOLD = {hold}
X0 = {x0}  # as the recording began
BEFORE = {before}  # inputs before the first sample
DELAYED = {delayed}  # (input, parameter) of every delayed copy


def rates(x, u, p):
    """d/dt of the states, of arrays in the order of STATES, of INPUTS followed by DELAYED and time, and of PARAMETERS."""
{rate}    return np.array([{rate_results}], dtype=float)


def outputs(x, u, p):
    """Outputs in the order of OUTPUTS."""
{output}    return np.array([{output_results}], dtype=float)


def simulate(t, u, parameters=None, x0=None, before=None, rtol=1e-11):
    """Outputs by name, (N,) each, at the times t (N,) in s for inputs u by name."""
    named = dict(PARAMETERS, **(parameters or {{}}))
    p, start, past = list(named.values()), dict(X0, **(x0 or {{}})), dict(BEFORE, **(before or {{}}))
    t = np.asarray(t, dtype=float)
    u = {{n: np.asarray(u[n], dtype=float) for n in INPUTS}}
    late = [(n, named[q]) for n, q in DELAYED]

    def value(name, seen, interval):
        """The input at a time `seen` inside an interval whose middle is `interval`."""
        k = np.searchsorted(t, interval, side="right") - 1
        if k < 0:
            return past[name]
        if HOLD[name] == "previous" or k + 1 >= len(t):
            return u[name][k]
        return u[name][k] + (u[name][k + 1] - u[name][k]) * (seen - t[k]) / (t[k + 1] - t[k])

    def channels(now, middle):
        return [value(n, now, middle) for n in INPUTS] + [value(n, now - d, middle - d) for n, d in late] + [now]

    edges = np.unique(np.concatenate([t] + [t + d for _, d in late]))
    edges = edges[(edges >= t[0]) & (edges <= t[-1])]
    x = np.array([start[n] for n in STATES], dtype=float)
    found = np.empty((len(t), len(OUTPUTS)))
    found[0] = outputs(x, channels(t[0], t[0]), p)
    k = 1
    for a, b in zip(edges[:-1], edges[1:]):
        middle = 0.5 * (a + b)
        scale = rtol * np.maximum(1e-3, np.abs(x))
        x = solve_ivp(lambda s, z: rates(z, channels(s, middle), p), (a, b), x, method="LSODA", rtol=rtol, atol=scale).y[:, -1]
        if b == t[k]:
            found[k] = outputs(x, channels(b, b), p)
            k += 1
    return {{n: found[:, i] for i, n in enumerate(OUTPUTS)}}
'''


def _indexed(plant: Plant, form: str = "{}[{}]") -> tuple[list[str], list[str], list[str]]:
    sizes = (len(plant.vector.states), len(plant.vector.channels), len(plant.vector.parameters))
    return tuple([form.format(n, i) for i in range(size)] for n, size in zip("xup", sizes, strict=True))  # type: ignore[return-value]


def _values(plant: Plant) -> dict[str, str]:
    return {
        "told": "\n".join(_told(plant)), "parameters": repr({n: float(v) for n, v in plant.p.items()}),
        "states": repr(list(plant.vector.states)),
        "inputs": repr(list(plant.model.inputs)), "outputs": repr(list(plant.vector.outputs)), "hold": repr(plant.hold),
        "x0": repr(plant.x0),
        "before": repr(plant.before), "delayed": repr([(d.input, d.parameter) for d in plant.model.delays]),
    }  # fmt: skip


def _python(plant: Plant) -> dict[str, str | bytes]:
    rate, output = _functions(plant, "python", _indexed(plant))
    text = _PYTHON.format(
        **_values(plant), rate=_body(rate, "    "), rate_results=", ".join(rate.results), output=_body(output, "    "),
        output_results=", ".join(output.results),
    )  # fmt: skip
    return {f"{plant.name}_plant.py": text}


_CASADI = '''"""{told}

Needs casadi. `rates` and `outputs` are casadi Functions of x (STATES), u (INPUTS, then DELAYED copies, then time) and p (PARAMETERS), for
optimal control and estimation; `simulate(t, u)` integrates them with inputs held over each sample.
"""

import casadi as ca
import numpy as np

PARAMETERS = {parameters}
STATES = {states}
INPUTS = {inputs}
OUTPUTS = {outputs}
HOLD = {hold}
X0 = {x0}  # as the recording began
BEFORE = {before}  # inputs before the first sample
DELAYED = {delayed}  # (input, parameter) of every delayed copy


def _functions():
    x, u, p = ca.SX.sym("x", len(STATES)), ca.SX.sym("u", len(INPUTS) + len(DELAYED) + 1), ca.SX.sym("p", len(PARAMETERS))

    def rate():
{rate}        return ca.vertcat({rate_results})

    def output():
{output}        return ca.vertcat({output_results})

    names = ["x", "u", "p"]
    return ca.Function("rates", [x, u, p], [rate()], names, ["dx"]), ca.Function("outputs", [x, u, p], [output()], names, ["y"])


rates, outputs = _functions()


def simulate(t, u, parameters=None, x0=None, before=None):
    """Outputs by name, (N,) each, at the times t (N,) in s for inputs u by name, all of them held."""
    if any(h != "previous" for h in HOLD.values()):
        raise ValueError("an input of this plant goes straight between samples; integrate `rates` yourself")
    named = dict(PARAMETERS, **(parameters or {{}}))
    p, start, past = list(named.values()), dict(X0, **(x0 or {{}})), dict(BEFORE, **(before or {{}}))
    t = np.asarray(t, dtype=float)
    late = [(n, named[q]) for n, q in DELAYED]
    x, c, h = ca.SX.sym("x", len(STATES)), ca.SX.sym("c", len(INPUTS) + len(late)), ca.SX.sym("h", 2)
    s = ca.SX.sym("s")
    ode = h[1] * rates(x, ca.vertcat(c, h[0] + h[1] * s), p)
    problem = {{"x": x, "t": s, "p": ca.vertcat(c, h), "ode": ode}}
    step = ca.integrator("step", "cvodes", problem, 0.0, 1.0, {{"abstol": 1e-10, "reltol": 1e-10}})

    def channels(middle):
        places = [(n, np.searchsorted(t, middle - d, side="right") - 1) for n, d in [(n, 0.0) for n in INPUTS] + late]
        return [float(u[n][k]) if k >= 0 else past[n] for n, k in places]

    edges = np.unique(np.concatenate([t] + [t + d for _, d in late]))
    edges = edges[(edges >= t[0]) & (edges <= t[-1])]
    z = np.array([start[n] for n in STATES], dtype=float)
    found = np.empty((len(t), len(OUTPUTS)))
    found[0] = np.asarray(outputs(z, channels(t[0]) + [t[0]], p)).ravel()
    k = 1
    for a, b in zip(edges[:-1], edges[1:]):
        z = np.asarray(step(x0=z, p=channels(0.5 * (a + b)) + [a, b - a])["xf"]).ravel()
        if b == t[k]:
            found[k] = np.asarray(outputs(z, channels(b) + [b], p)).ravel()
            k += 1
    return {{n: found[:, i] for i, n in enumerate(OUTPUTS)}}
'''


def _casadi(plant: Plant) -> dict[str, str | bytes]:
    rate, output = _functions(plant, "casadi", _indexed(plant))
    text = _CASADI.format(
        **_values(plant), rate=_body(rate, "        "), rate_results=", ".join(rate.results), output=_body(output, "        "),
        output_results=", ".join(output.results),
    )  # fmt: skip
    return {f"{plant.name}_casadi.py": text}


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


def _c(plant: Plant) -> dict[str, str | bytes]:
    rate, output = _functions(plant, "c", _indexed(plant))

    def listed(values: Any) -> str:
        return ", ".join(repr(float(v)) for v in values) or "0.0"

    def whole(values: Any) -> str:
        return ", ".join(str(int(v)) for v in values) or "0"

    inputs = list(plant.model.inputs)
    common = {
        "name": plant.name, "UPPER": plant.name.upper(), "n": len(plant.vector.states), "m": len(inputs), "q": len(plant.vector.outputs),
        "k": len(plant.p), "d": len(plant.model.delays),
    }  # fmt: skip
    told = "\n * ".join(line.replace("*/", "* /") for line in _told(plant))
    header = _C_HEADER.format(**common, told=told, names=", ".join(plant.p).replace("*/", "* /"), steps=_steps(plant))
    typed = {"rate": "    const double {} = {};", "output": "    const double {} = {};"}
    source = _C_SOURCE.format(
        **common, values=listed(plant.p.values()), x0=listed(plant.x0[n] for n in plant.vector.states),
        before=listed(plant.before[n] for n in inputs), rate=_body(rate, "", typed["rate"]), output=_body(output, "", typed["output"]),
        rate_results="".join(f"    dx[{i}] = {v};\n" for i, v in enumerate(rate.results)),
        output_results="".join(f"    y[{i}] = {v};\n" for i, v in enumerate(output.results)),
        straight=whole(plant.hold[n] == "linear" for n in inputs), late_inputs=whole(inputs.index(d.input) for d in plant.model.delays),
        late_places=whole(list(plant.p).index(d.parameter) for d in plant.model.delays),
    )  # fmt: skip
    return {f"{plant.name}_plant.h": header, f"{plant.name}_plant.c": source}


def _linear(plant: Plant) -> tuple[Any, float]:
    """The plant at rest at the middle of its first output in the recording, and the level: Rest of the only input, or SimulationError."""
    model = plant.model
    if len(model.inputs) != 1 or len(model.outputs) != 1:
        raise SimulationError(
            f"Model {model.name!r} has {len(model.inputs)} inputs and {len(model.outputs)} outputs; matrices are exported of single loops. "
            "Export --to python, c or casadi, which hold the whole model."
        )
    (input_,), (output,) = model.inputs, model.outputs
    loop = OneLoop(model, output, input_, {}, {n: np.asarray(v)[None] for n, v in plant.p.items()})
    seen = plant.answer.problem.experiments[plant.recording].recording[output]
    level = float(np.nanmedian(seen))
    u = plant.inputs[input_]
    rest = loop.at_rest(level, (float(u.min()), float(np.median(u)), float(u.max())))
    if not np.isfinite(rest.u[0]):
        raise SimulationError(f"Model {model.name!r} has no rest at {output} = {level:.4g}, where it would be linearised.")
    return rest, level


def _steps(plant: Plant) -> int:
    """Runge-Kutta steps between edges, a tenth of the fastest time constant at the beginning each, at least 4."""
    import jax
    import jax.numpy as jnp

    p = tuple(jnp.asarray(v) for v in plant.p.values())
    first = {n: float(v[0]) for n, v in plant.inputs.items()}
    u = [first[n] for n in plant.model.inputs] + [first[d.input] for d in plant.model.delays] + [float(plant.t[0])]
    x = jnp.array([plant.x0[n] for n in plant.vector.states])
    a = jax.jacfwd(lambda z: jnp.stack(plant.vector.rate(tuple(z), tuple(u), p)))(x)
    fastest = float(np.max(np.abs(np.linalg.eigvals(np.asarray(a)))))
    return int(min(max(4, np.ceil(10 * fastest * float(np.max(np.diff(plant.t))))), 1000))


def _matrices(plant: Plant) -> dict[str, Any]:
    """Matrices of the ways of the input that act, by the seconds that they are late."""
    rest, level = _linear(plant)
    used = [k for k in range(rest.B.shape[1]) if np.any(rest.B[0, k]) or (k == 0 and rest.D[0])]
    return {
        "A": rest.A[0].tolist(), "C": [rest.C[0].tolist()], "x0": rest.x[0].tolist(), "u0": float(rest.u[0]), "y0": level,
        "paths": [
            {"delay": float(rest.late[0, k]), "B": rest.B[0, k][:, None].tolist(), "D": [[float(rest.D[0]) if k == 0 else 0.0]]} for k in
            used ],
        "states": list(plant.vector.states), "input": next(iter(plant.model.inputs)), "output": next(iter(plant.model.outputs)),
        "units": {k: v for k, v in {**plant.model.states, **plant.model.inputs, **plant.model.outputs}.items() if v},
    }  # fmt: skip


_CONTROL = '''"""{told}

Needs python-control. The plant near its rest: {output} = {y0:.6g} at {input} = {u0:.6g}. `paths` are (seconds of dead time, StateSpace);
the whole plant is their sum, each behind its dead time. `system(pade)` is one StateSpace with dead time as Pade fractions of that order.
"""

import control as ct
import numpy as np

A, C = {A}, {C}
U0, Y0, X0 = {u0!r}, {y0!r}, {x0}
paths = [(delay, ct.ss(A, b, C, d)) for delay, b, d in {paths}]


def system(pade=4):
    """One StateSpace; dead time by a Pade fraction, exact to order 2 `pade` at low frequency."""
    whole = None
    for delay, part in paths:
        if delay > 0:
            part = ct.series(ct.tf2ss(ct.tf(*ct.pade(delay, pade))), part)
        whole = part if whole is None else ct.parallel(whole, part)
    return whole


def frequency_response(w):
    """G(jw) at w (F,) in rad/s, dead time exact."""
    return sum(part(1j * np.asarray(w)) * np.exp(-1j * np.asarray(w) * delay) for delay, part in paths)


def simulate(t, u):
    """The output at evenly spaced times t (N,) in s for an input (N,) held over the samples; at rest before, dead time exact."""
    t, u = np.asarray(t, dtype=float), np.asarray(u, dtype=float)
    h, y = t[1] - t[0], np.full(len(t), Y0)
    for delay, part in paths:
        whole = int(np.floor(delay / h + 1e-9))
        share = max(delay / h - whole, 0.0)
        a = np.asarray(part.A)
        sizes = [ct.c2d(part, s * h, "zoh") if s > 0 else None for s in (1.0 - share, share)]
        late = sizes[0]
        x = np.zeros(len(a))
        moved = np.r_[np.zeros(whole + 1), u - U0]
        for k in range(len(t)):
            y[k] += float((part.C @ x)[0] + part.D[0, 0] * moved[k + 1])
            if sizes[1] is not None:  # the input of before acts until its edge
                x = sizes[1].A @ x + sizes[1].B[:, 0] * moved[k]
            x = late.A @ x + late.B[:, 0] * moved[k + 1]
    return y
'''


def _control(plant: Plant) -> dict[str, str | bytes]:
    m = _matrices(plant)
    paths = [(q["delay"], q["B"], q["D"]) for q in m["paths"]]
    text = _CONTROL.format(told="\n".join(_told(plant)), **{**m, "paths": paths})
    return {f"{plant.name}_control.py": text, f"{plant.name}_control.json": json.dumps(m, indent=1) + "\n"}


def _matlab(plant: Plant) -> dict[str, str | bytes]:
    import io

    from scipy.io import savemat

    m, buffer = _matrices(plant), io.BytesIO()
    p = {k: float(v) for k, v in plant.p.items() if not np.ndim(v) and re.fullmatch(r"[A-Za-z]\w{0,30}", k)}
    data = {
        "A": m["A"],
        "C": m["C"],
        "u0": m["u0"],
        "y0": m["y0"],
        "x0": m["x0"],
        "t": plant.t,
        "u": plant.inputs[m["input"]],
        "parameters": p,
    }
    for k, q in enumerate(m["paths"], 1):
        data |= {f"B{k}": q["B"], f"D{k}": q["D"], f"delay{k}": q["delay"]}
    savemat(buffer, data)
    name = plant.name
    parts = [f"ss(plant.A, plant.B{k}, plant.C, plant.D{k}, 'InputDelay', plant.delay{k})" for k in range(1, len(m["paths"]) + 1)]
    lines = [
        *(f"% {line}" for line in _told(plant)),
        f"% Near its rest: {m['output']} = plant.y0 at {m['input']} = plant.u0. Written by plantfit and not run in MATLAB.",
        f"plant = load('{name}_matlab.mat');",
        f"sys = {' + '.join(parts)};",
        f"sys.InputName = '{m['input']}'; sys.OutputName = '{m['output']}';",
        "step(sys)",
    ]
    return {f"{name}_matlab.mat": buffer.getvalue(), f"{name}_matlab.m": "\n".join(lines) + "\n"}


def _csv(plant: Plant) -> dict[str, str | bytes]:
    predicted = plant.answer.predict(plant.recording)
    own = plant.answer.problem.experiments[plant.recording].recording
    columns = {"t [s]": plant.t}
    for names, ending in ((plant.model.inputs, ""), (plant.model.outputs, "")):
        columns |= {f"{n}{ending} [{u or '-'}]": np.asarray(own[n]) for n, u in names.items() if n in own.signals}
    columns |= {f"{n}_simulated [{plant.model.outputs[n] or '-'}]": y for n, y in predicted.items()}
    table = np.column_stack(list(columns.values()))
    rows = [",".join(_cell(c) for c in columns), *(",".join(repr(float(v)) if np.isfinite(v) else "" for v in row) for row in table)]
    found = ["parameter,value,unit,standard_error"]
    for row in plant.answer.findings["parameters"]:
        error = row["standard_error"]
        found.append(",".join([_cell(row["name"]), repr(row["value"]), _cell(row["unit"] or ""), "" if error is None else repr(error)]))
    return {f"{plant.name}_simulated.csv": "\n".join(rows) + "\n", f"{plant.name}_parameters.csv": "\n".join(found) + "\n"}


def _cell(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if re.search(r'[",\n]', text) else text
