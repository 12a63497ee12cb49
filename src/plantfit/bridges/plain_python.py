"""The plant as a Python file that needs numpy and scipy alone."""

from plantfit.bridges.plant import Plant
from plantfit.bridges.python_text import shared

_PYTHON = '''"""{told}

Needs numpy and scipy only. `simulate(t, u)` takes times (N,) in s and inputs by name, each (N,), and gives outputs by name.
Between samples an input keeps its value (HOLD "previous") or goes straight to the next one ("linear").
"""

import numpy as np
from scipy.integrate import solve_ivp

{declared}


def rates(x, u, p):
    """d/dt of the states, of arrays in the order of STATES, of INPUTS followed by DELAYED and time, and of PARAMETERS."""
{rate}    return np.array([{rate_results}], dtype=float)


def outputs(x, u, p):
    """Outputs in the order of OUTPUTS."""
{output}    return np.array([{output_results}], dtype=float)


def simulate(t, u, parameters=None, x0=None, before=None, rtol=1e-11):
    """Outputs by name, (N,) each, at the times t (N,) in s for inputs u by name."""
{given}    u = {{n: np.asarray(u[n], dtype=float) for n in INPUTS}}
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

{edges}    x = np.array([start[n] for n in STATES], dtype=float)
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


def plain_python(plant: Plant) -> dict[str, str | bytes]:
    """Files by name: NAME_plant.py."""
    rate, output = plant.lines("rate", "python"), plant.lines("output", "python")
    text = _PYTHON.format(
        **shared(plant), rate=rate.text("    "), rate_results=", ".join(rate.results), output=output.text("    "),
        output_results=", ".join(output.results),
    )  # fmt: skip
    return {f"{plant.name}_plant.py": text}
