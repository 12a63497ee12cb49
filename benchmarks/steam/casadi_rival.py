"""The cost and its gradient by CasADi: the exponential scheme as a mapaccum, reverse mode, generated C compiled with
gcc -O3."""

import hashlib
import os
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.data import Steam
from benchmarks.steam.compiler import compiler
from plantfit.folders import cache_folder

try:
    import casadi as ca
except ImportError:
    ca: Any = None

_RECIPE = 2  # raise when the generated program changes
_FLAGS = ("-O3", "-march=native", "-fPIC", "-shared")
_PIECE = 20.0 / 9  # bar


@dataclass(frozen=True)
class CasadiCost:
    """Compiled functions of theta (310,): cost () in bar^2, value and gradient (310,), responses (10, 4500)."""

    cost: Callable[[np.ndarray], float]
    value_and_gradient: Callable[[np.ndarray], tuple[float, np.ndarray]]
    responses: Callable[[np.ndarray], np.ndarray]


def casadi_cost(steam: Steam) -> CasadiCost | None:
    """None without CasADi (extra `bench`) or without a C compiler; the first call on a machine compiles for a while."""
    if ca is None or compiler() is None:
        return None
    library = _library(steam)
    cost, gradient, responses = (ca.external(name, library) for name in ("cost", "gradient", "responses"))

    def padded(theta: np.ndarray) -> np.ndarray:
        y = np.full(steam.y.shape, np.nan)
        for i, row in enumerate(responses.call([theta])):
            y[i, : row.numel()] = np.asarray(row).ravel()
        return y

    def both(theta: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = gradient.call([theta])
        return float(value), np.asarray(slope).ravel()

    return CasadiCost(lambda theta: float(cost(theta)), both, padded)


def _step() -> Any:
    """(state (2,), h, tables (30,), u) -> the state a step later, as one SX function; a table is its first value and
    9 slopes."""
    x, h, tables, u = ca.SX.sym("x", 2), ca.SX.sym("h"), ca.SX.sym("tables", 30), ca.SX.sym("u")
    parts = ca.vertcat(*(ca.fmin(ca.fmax(x[0] - _PIECE * j, 0), _PIECE) for j in range(9)))
    on = ca.vertcat(*(ca.logic_and(x[0] >= _PIECE * j, x[0] < _PIECE * (j + 1)) for j in range(9)))
    k, a1, a2 = (table[0] + ca.dot(table[1:], parts) for table in ca.vertsplit(tables, 10))
    dk, da1, da2 = (ca.dot(table[1:], on) for table in ca.vertsplit(tables, 10))
    acceleration = (k * u - x[0] - a1 * x[1]) / a2
    by_x = (dk * u - 1 - da1 * x[1] - da2 * acceleration) / a2
    c, d = h * by_x, -h * a1 / a2  # Z = [[0, h], [c, d]]
    q, m = d / 6 - 2 / 3, 1 + h * c / 6
    b1, b2 = x[1] - h * acceleration / 6, acceleration - (c * x[1] + d * acceleration) / 6
    scale = h / (m * (m + q * d) - q * h * q * c)
    moved = x + scale * ca.vertcat((m + q * d) * b1 - q * h * b2, m * b2 - q * c * b1)
    return ca.Function("step", [x, h, tables, u], [moved])


def _program(steam: Steam) -> list[Any]:
    theta, step, total, rows = ca.MX.sym("theta", 310), _step(), 0, []
    for i, (row, n, u) in enumerate(zip(ca.vertsplit(theta, 31), steam.samples, steam.opening, strict=True)):
        n = int(n)
        ends = ca.DM(float(steam.period) * np.arange(1, n + 1)).T
        h = ca.fmin(ca.fmax(ends - row[30], 0), float(steam.period))  # 0 while the input rests
        tables = ca.vertcat(*(ca.vertcat(nodes[0], ca.diff(nodes) / _PIECE) for nodes in ca.vertsplit(row[:30], 10)))
        states = step.mapaccum(f"record{i}", n)(ca.DM.zeros(2), h, ca.repmat(tables, 1, n), float(u))
        rows.append(states[0, :])
        total += ca.sumsqr(states[0, :] - ca.DM(steam.y[i, :n]).T) / n
    return [
        ca.Function("cost", [theta], [total]),
        ca.Function("gradient", [theta], [total, ca.gradient(total, theta)]),
        ca.Function("responses", [theta], rows),
    ]


def _library(steam: Steam) -> str:
    folder = cache_folder() / "benchmarks"
    # pyrefly: ignore[missing-attribute]  (casadi's stub leaves it out)
    tag = hashlib.sha256(f"{_RECIPE} {ca.__version__} {_FLAGS}".encode() + steam.y.tobytes()).hexdigest()[:16]
    library = folder / f"casadi-{tag}.so"
    if not library.exists():
        generator = ca.CodeGenerator(f"casadi_{tag}_{os.getpid()}.c")
        for function in _program(steam):
            generator.add(function)
        source = generator.generate(f"{folder}{os.sep}")
        part = library.with_suffix(f".{os.getpid()}")
        subprocess.run([str(compiler()), *_FLAGS, source, "-o", str(part)], check=True)
        os.replace(part, library)
        os.remove(source)
    return str(library)
