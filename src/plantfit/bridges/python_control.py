"""The plant near its rest as state spaces of python-control, each path of the input behind its dead time."""

import json

from plantfit.bridges.matrices import matrices
from plantfit.bridges.plant import Plant, one_line
from plantfit.bridges.python_text import docstring

_CONTROL = '''"""{told}

Needs python-control. The plant near its rest: {output} = {y0:.6g} at {input} = {u0:.6g}. `paths` are (seconds of dead time, StateSpace);
the whole plant is their sum, each behind its dead time. `system(pade)` is one StateSpace with dead time as Pade fractions of that order.
"""

import numpy as np

try:
    import control as ct
except ImportError:
    raise ImportError("This file needs the package control; install it with: pip install 'plantfit[control]'") from None

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
            y[k] += float((part.C @ x)[0] + part.D[0, 0] * moved[k + (share == 0)])
            if sizes[1] is not None:  # the input of before acts until its edge
                x = sizes[1].A @ x + sizes[1].B[:, 0] * moved[k]
            x = late.A @ x + late.B[:, 0] * moved[k + 1]
    return y
'''


def python_control(plant: Plant) -> dict[str, str | bytes]:
    """Files by name: NAME_control.py and NAME_control.json."""
    m = matrices(plant)
    paths = [(q["delay"], q["B"], q["D"]) for q in m["paths"]]
    names = {k: docstring(one_line(m[k])) for k in ("input", "output")}
    text = _CONTROL.format(told=docstring("\n".join(plant.story)), **{**m, **names, "paths": paths})
    return {
        f"{plant.name}_control.py": text,
        f"{plant.name}_control.json": json.dumps({"made_by": "plantfit", **m}, indent=1) + "\n",
    }
