"""The plant as CasADi functions, and their simulation with its integrators."""

from plantfit.bridges.plant import Plant
from plantfit.bridges.python_text import shared

_CASADI = '''"""{told}

Needs casadi. `rates` and `outputs` are casadi Functions of x (STATES), u (INPUTS, then DELAYED copies, then time) and p (PARAMETERS), for
optimal control and estimation; `simulate(t, u)` integrates them with inputs held over each sample.
"""

import casadi as ca
import numpy as np

{declared}


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
{given}    late = [(n, named[q]) for n, q in DELAYED]
    x, c, h = ca.SX.sym("x", len(STATES)), ca.SX.sym("c", len(INPUTS) + len(late)), ca.SX.sym("h", 2)
    s = ca.SX.sym("s")
    ode = h[1] * rates(x, ca.vertcat(c, h[0] + h[1] * s), p)
    problem = {{"x": x, "t": s, "p": ca.vertcat(c, h), "ode": ode}}
    step = ca.integrator("step", "cvodes", problem, 0.0, 1.0, {{"abstol": 1e-10, "reltol": 1e-10}})

    def channels(middle):
        places = [(n, np.searchsorted(t, middle - d, side="right") - 1) for n, d in [(n, 0.0) for n in INPUTS] + late]
        return [float(u[n][k]) if k >= 0 else past[n] for n, k in places]

{edges}    z = np.array([start[n] for n in STATES], dtype=float)
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


def casadi_functions(plant: Plant) -> dict[str, str | bytes]:
    """Files by name: NAME_casadi.py."""
    rate, output = plant.lines("rate", "casadi"), plant.lines("output", "casadi")
    text = _CASADI.format(
        **shared(plant), rate=rate.text("        "), rate_results=", ".join(rate.results),
        output=output.text("        "),
        output_results=", ".join(output.results),
    )  # fmt: skip
    return {f"{plant.name}_casadi.py": text}
