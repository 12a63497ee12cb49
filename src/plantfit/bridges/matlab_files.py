"""The plant near its rest as a MAT file and a script of MATLAB."""

import io
import re

import numpy as np
from scipy.io import savemat

from plantfit.bridges.matrices import matrices
from plantfit.bridges.plant import Plant, one_line


def matlab_files(plant: Plant) -> dict[str, str | bytes]:
    """Files by name: NAME_matlab.mat and NAME_matlab.m."""
    m, buffer = matrices(plant), io.BytesIO()
    p = {k: float(v) for k, v in plant.p.items() if not np.ndim(v) and re.fullmatch(r"[A-Za-z]\w{0,30}", k)}
    data = {
        "made_by": "plantfit",
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
    parts = [
        f"ss(plant.A, plant.B{k}, plant.C, plant.D{k}, 'InputDelay', plant.delay{k})"
        for k in range(1, len(m["paths"]) + 1)
    ]
    lines = [
        *(f"% {line}" for line in plant.story),
        f"% Near its rest: {one_line(m['output'])} = plant.y0 at {one_line(m['input'])} = plant.u0.",
        "% Written by plantfit and not run in MATLAB.",
        f"plant = load('{name}_matlab.mat');",
        f"sys = {' + '.join(parts)};",
        f"sys.InputName = {_quoted(m['input'])}; sys.OutputName = {_quoted(m['output'])};",
        "step(sys)",
    ]
    return {f"{name}_matlab.mat": buffer.getvalue(), f"{name}_matlab.m": "\n".join(lines) + "\n"}


def _quoted(text: str) -> str:
    return "'" + one_line(text).replace("'", "''") + "'"
