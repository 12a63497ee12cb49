"""What jumps cost: a mass with events, dry friction that sticks and backlash, beside smooth models of it, in batches.

Run `python -m benchmarks.switching`.
"""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from benchmarks.steam.interleaved import interleaved
from plantfit.models.text.equations import equations
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter

SAMPLES, PERIOD, CANDIDATES = 2000, 0.01, 64
MASS = "x' = v\nv' = ({force} - b*v)/m\n"
SMOOTH = MASS.format(force="F - k*x^3") + "y = x"
# the walls give at least 0.3 back: a mass that is pressed to a wall and comes to rest there would meet it without end
WALLS = "\nwhen falling(x + wall): v = 0.3 - 0.5*v, x = -wall\nwhen rising(x - wall): v = -0.3 - 0.5*v, x = wall"
KINDS = {
    "smooth": SMOOTH,
    "friction as tanh(v/0.02)": MASS.format(force="F - k*x^3 - Fc*tanh(v/0.02)") + "y = x",
    "friction that sticks": MASS.format(force="F - k*x^3 - friction(v, Fc)") + "y = x",
    "two walls (events)": SMOOTH + WALLS,
    "backlash": MASS.format(force="F - k*x^3") + "q = play(x, wall)\ny = q",
}
BOX = {"b": (0.1, 3.0), "m": (0.1, 2.0), "k": (0.1, 2.0), "Fc": (0.1, 1.0), "wall": (0.1, 0.5)}


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures."""
    calls: dict[str, Callable[[], Any]] = {}
    for kind, text in KINDS.items():
        problem = _problem(text)
        z = np.random.default_rng(1).random((CANDIDATES, problem.space.dimension))
        if not np.all(np.isfinite(problem.costs(z))):
            raise ValueError(
                f"{kind}: some candidates cannot be simulated, which costs less than those that can; change BOX."
            )
        calls[f"{kind}, costs"] = lambda problem=problem, z=z: problem.costs(z)
        calls[f"{kind}, gradients"] = lambda problem=problem, z=z: problem.values_and_gradients(z)
    seconds = {name: timing.cpu for name, timing in interleaved(calls, 3 if quick else 15, 0.01).items()}
    figures: dict[str, float] = {}
    print(
        f"{SAMPLES} samples, {CANDIDATES} candidates, one step a "
        "sample; seconds of this process, ratios to the smooth model"
    )
    print(f"{'':28}{'costs':>10}{'ratio':>8}{'gradients':>12}{'ratio':>8}")
    for kind in KINDS:
        costs, slopes = (seconds[f"{kind}, {what}"] for what in ("costs", "gradients"))
        over = costs / seconds["smooth, costs"], slopes / seconds["smooth, gradients"]
        print(f"{kind:28}{1e3 * costs:7.2f} ms{over[0]:8.2f}{1e3 * slopes:9.2f} ms{over[1]:8.2f}")
        name = f"switching_{kind.split()[0]}_{kind.split()[-1].strip('()')}"
        figures |= {f"{name}_over_smooth": over[0], f"{name}_gradients_over_smooth": over[1]}
    return figures


def _problem(text: str) -> Problem:
    rng = np.random.default_rng(3)
    names = [n for n in BOX if any(f"{s}{n}{e}" in text for s in " *(-" for e in " *)/,\n") or n in ("b", "m", "k")]
    states = ["x", "v", *(["q"] if "play" in text else [])]
    model = equations(
        text, inputs=["F"], states=states, outputs=["y"], parameters=dict.fromkeys(names), name="mass", check=False
    )
    t = PERIOD * np.arange(SAMPLES)
    force = np.repeat(rng.uniform(-3.0, 3.0, SAMPLES // 50), 50)
    record = Recording(t, {"F": Signal(force), "y": Signal(np.cumsum(rng.standard_normal(SAMPLES)) * 0.01)})
    return Problem(model, record, {n: Parameter(BOX[n], scale="log") for n in names}, substeps=1)


if __name__ == "__main__":
    run("--quick" in sys.argv[1:])
