"""The NIST StRD nonlinear regressions as study files made from the certified .dat files."""

import re
from pathlib import Path

import numpy as np

from plantfit.spec import Study, parse

FOLDER = Path(__file__).parents[1] / "models" / "nist_strd"

# boxes that a user who knows the kind of curve, not the answer, would draw
MODELS = {
    "BoxBOD": ("b1*(1 - exp(-b2*x))", {"b1": (1, 1000), "b2": (0.01, 10)}),
    "Chwirut2": ("exp(-b1*x) / (b2 + b3*x)", {"b1": (0.001, 2), "b2": (1e-4, 0.1), "b3": (1e-4, 0.1)}),
    "DanWood": ("b1*x^b2", {"b1": (0.01, 10), "b2": (0, 10)}),
    "Gauss1": (
        "b1*exp(-b2*x) + b3*exp(-(x - b4)^2/b5^2) + b6*exp(-(x - b7)^2/b8^2)",
        {
            "b1": (10, 200),
            "b2": (1e-4, 1),
            "b3": (10, 200),
            "b4": (0, 250),
            "b5": (5, 80),
            "b6": (10, 200),
            "b7": (0, 250),
            "b8": (5, 80),
        },
    ),
    "Lanczos3": (
        "b1*exp(-b2*x) + b3*exp(-b4*x) + b5*exp(-b6*x)",
        {"b1": (0, 10), "b2": (0, 20), "b3": (0, 10), "b4": (0, 20), "b5": (0, 10), "b6": (0, 20)},
    ),
    "MGH09": ("b1*(x^2 + x*b2) / (x^2 + x*b3 + b4)", {"b1": (0, 50), "b2": (0, 80), "b3": (0, 80), "b4": (0, 80)}),
    "Misra1a": ("b1*(1 - exp(-b2*x))", {"b1": (1, 1000), "b2": (1e-6, 0.1)}),
    "Thurber": (
        "(b1 + b2*x + b3*x^2 + b4*x^3) / (1 + b5*x + b6*x^2 + b7*x^3)",
        {
            "b1": (500, 2000),
            "b2": (500, 2000),
            "b3": (100, 1000),
            "b4": (10, 200),
            "b5": (0, 2),
            "b6": (0, 1),
            "b7": (0, 0.5),
        },
    ),
}

# terms of a sum that may change places: tuples that go together, put in order of their first
TERMS = {"Gauss1": (("b4", "b3", "b5"), ("b7", "b6", "b8")), "Lanczos3": (("b2", "b1"), ("b4", "b3"), ("b6", "b5"))}


# widths of a Gaussian enter squared
EVEN = {"Gauss1": ("b5", "b8")}


def ordered(name: str, values: dict[str, float]) -> dict[str, float]:
    """Parameters with interchangeable terms in ascending order, those without a sign positive."""
    groups = TERMS.get(name, ())
    result = {n: abs(v) if n in EVEN.get(name, ()) else v for n, v in values.items()}
    for group, term in zip(groups, sorted(tuple(result[n] for n in g) for g in groups), strict=True):
        result.update(zip(group, term, strict=True))
    return result


def certified(name: str) -> tuple[dict[str, tuple[float, float, float]], float, np.ndarray]:
    """Parameters as (start 1, start 2, certified), residual sum of squares, rows of (y, x)."""
    text = (FOLDER / f"{name}.dat").read_text()
    found = re.findall(r"^ *(b\d) = +(\S+) +(\S+) +(\S+) +\S+ *$", text, re.MULTILINE)
    rest = re.search(r"Residual Sum of Squares: +(\S+)", text)
    assert rest is not None
    return (
        {n: (float(a), float(b), float(c)) for n, a, b, c in found},
        float(rest[1]),
        np.loadtxt(text.splitlines()[60:]),
    )


def wide_study(name: str, folder: Path, *, start: int | None) -> Study:
    """Default settings, bounds at plus and minus ten times the larger start of each parameter."""
    values, _, _ = certified(name)
    box = {n: (-10 * max(abs(a), abs(b)), 10 * max(abs(a), abs(b))) for n, (a, b, _) in values.items()}
    lines = [*_data_and_model(name, folder), "[search]", 'methods = ["auto"]']
    for parameter, bounds in box.items():
        lines += [f"[parameters.{parameter}]", f"bounds = {list(bounds)!r}"]
        if start is not None:
            lines.append(f"start = {values[parameter][start - 1]!r}")
    return parse("\n".join(lines), folder / f"{name}.toml")


def study(name: str, folder: Path, *, start: int | None) -> Study:
    """The study file of one data set: from start 1 or 2 with one local search, or from none with `auto`."""
    _, box = MODELS[name]
    values, _, _ = certified(name)
    lines = [
        *_data_and_model(name, folder),
        "[search]",
        'methods = ["auto"]'
        if start is None
        else 'methods = ["least_squares"]\nsettings = { least_squares = { agree = 1, max_steps = 2000 } }',
        "seed = 5",
    ]
    for parameter, (low, high) in box.items():
        given = values[parameter]
        if start is not None:
            # the second argument of a start may lie outside a user's box: widen it around both starts
            low, high = min(low, *given) - abs(min(low, *given)), 2 * max(high, *given)
        lines += [f"[parameters.{parameter}]", f"bounds = [{low!r}, {high!r}]"]
        if start is not None:
            lines.append(f"start = {given[start - 1]!r}")
    return parse("\n".join(map(str, lines)), folder / f"{name}.toml")


def _data_and_model(name: str, folder: Path) -> list[str]:
    """Writes the recording; the lines of the study file that name it and the equations."""
    _, _, rows = certified(name)
    np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header="y,x", comments="", fmt="%.17g")
    return [
        f'name = "{name}"',
        "[recording.data]",
        f'file = "{name}.csv"',
        "period = 1.0",
        'signals = { x = "x", y = "y" }',
        "[model]",
        f'equations = "y = {MODELS[name][0]}"',
        'inputs = ["x"]',
        'outputs = ["y"]',
    ]
