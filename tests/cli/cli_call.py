"""Call the command line in this process, as its entry point does."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np


@dataclass(frozen=True)
class Said:
    code: int
    out: str
    err: str

    def record(self, command: str) -> dict[str, Any]:
        """What `plantfit COMMAND --json` printed, held to the schema of it."""
        from plantfit.findings.results.all_results import result_schema

        found = json.loads(self.out)
        jsonschema.validate(found, result_schema(command))
        return found


def call(capsys, monkeypatch, *words: str | Path) -> Said:
    from plantfit.cli.main import run_cli

    monkeypatch.setattr(sys, "argv", ["plantfit", *map(str, words)])
    capsys.readouterr()
    code = 0
    try:
        run_cli()
    except SystemExit as stop:
        code = int(stop.code or 0)
    said = capsys.readouterr()
    return Said(code, said.out, said.err)


SPEC = """\
name = "heater"
[recording.bench]
file = "heater.csv"
time = "t [s]"
signals = { u = "u [%]", T = "T [degC]" }
split = 0.7
[model]
equations = \"\"\"
x' = (K*delay(u, L) + T0 - x)/tau
T = x
\"\"\"
inputs = { u = "%" }
states = { x = { unit = "degC", initial = "T" } }
outputs = { T = "degC" }
[parameters.K]
bounds = [0.01, 10.0]
unit = "degC/%"
[parameters.T0]
bounds = [0.0, 50.0]
unit = "degC"
[parameters.tau]
bounds = [1.0, 500.0]
scale = "log"
unit = "s"
[parameters.L]
bounds = [0.0, 20.0]
unit = "s"
[search]
seed = 3
"""


def heater(folder, noise=0.05):
    """A heater with known truth: K 0.8 degC/%, T0 21 degC, tau 40 s, L 3.4 s, sampled every second."""
    t = np.arange(400.0)
    u = 30 + 20 * np.sign(np.sin(2 * np.pi * t / 130)) + 10 * (t > 220)
    x, late = np.empty(400), np.interp(np.arange(0, 400, 0.1) - 3.4, t, u)
    late = u[np.clip(np.floor(np.arange(0, 400, 0.1) - 3.4 + 1e-9).astype(int), 0, 399)]
    value = 24.0
    for k in range(4000):
        if k % 10 == 0:
            x[k // 10] = value
        rest = 0.8 * late[k] + 21
        value = rest + (value - rest) * np.exp(-0.1 / 40)  # exact for a held input
    y = x + np.random.default_rng(2).normal(0, noise, 400)
    rows = ["t [s],u [%],T [degC]", *(f"{a:g},{b:g},{c:.6f}" for a, b, c in zip(t, u, y, strict=True))]
    (folder / "heater.csv").write_text("\n".join(rows))
    (folder / "heater.toml").write_text(SPEC)
    return folder / "heater.toml"


def exchangeable(place):
    """A log of seven days whose dates are dates either way, as far apart at its ends."""
    days = ["01/01", "02/02", "02/03", "03/03", "04/04", "04/05", "05/05"]
    rng, rows, y = np.random.default_rng(3), [], 0.0
    for day in days:
        for hour in range(24):
            u = float(hour // 6 % 2)
            y += 0.3 * (2.0 * u - y)
            rows.append(f"{day}/2024 {hour:02d}:00:00,{u:g},{y + 0.01 * rng.standard_normal():.4f}")
    place.write_text("time,power [kW],temperature [degC]\n" + "\n".join(rows) + "\n")
