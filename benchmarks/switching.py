"""What jumps cost: a mass with events, dry friction that sticks and backlash, beside smooth models of it, in batches.

Run `python -m benchmarks.switching`.
"""

import sys

import numpy as np

import plantfit.runtime  # noqa: F401
from benchmarks.timing import timed
from plantfit.models.text.equations import equations
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter

SAMPLES, PERIOD, CANDIDATES = 2000, 0.01, 64
MASS = "x' = v\nv' = ({force} - b*v)/m\n"
SMOOTH = MASS.format(force="F - k*x^3") + "y = x"
KINDS = {
    "smooth": SMOOTH,
    "friction as tanh(v/0.02)": MASS.format(force="F - k*x^3 - Fc*tanh(v/0.02)") + "y = x",
    "friction that sticks": MASS.format(force="F - k*x^3 - friction(v, Fc)") + "y = x",
    "two walls (events)": SMOOTH + "\nwhen falling(x + wall): v = -0.5*v, x = -wall\nwhen rising(x - wall): v = -0.5*v, x = wall",
    "backlash": MASS.format(force="F - k*x^3") + "q = play(x, wall)\ny = q",
}
BOX = {"b": (0.1, 3.0), "m": (0.1, 2.0), "k": (0.1, 2.0), "Fc": (0.1, 1.0), "wall": (0.1, 0.5)}


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures."""
    figures: dict[str, float] = {}
    print(f"{SAMPLES} samples, {CANDIDATES} candidates, one step a sample; ratios to the smooth model in this run")
    print(f"{'':28}{'costs':>10}{'ratio':>8}{'gradients':>12}{'ratio':>8}")
    base: tuple[float, float] | None = None
    for kind, text in KINDS.items():
        problem = _problem(text)
        z = np.random.default_rng(1).random((CANDIDATES, problem.space.dimension))
        costs = timed(lambda problem=problem, z=z: problem.costs(z), 3 if quick else 15).median
        slopes = timed(lambda problem=problem, z=z: problem.values_and_gradients(z), 3 if quick else 15).median
        base = base or (costs, slopes)
        print(f"{kind:28}{1e3 * costs:7.2f} ms{costs / base[0]:8.2f}{1e3 * slopes:9.2f} ms{slopes / base[1]:8.2f}")
        figures[f"switching_{kind.split()[0]}_{kind.split()[-1].strip('()')}_over_smooth"] = costs / base[0]
    return figures


def _problem(text: str) -> Problem:
    rng = np.random.default_rng(3)
    names = [n for n in BOX if any(f"{s}{n}{e}" in text for s in " *(-" for e in " *)/,\n") or n in ("b", "m", "k")]
    states = ["x", "v", *(["q"] if "play" in text else [])]
    model = equations(text, inputs=["F"], states=states, outputs=["y"], parameters=dict.fromkeys(names), name="mass", check=False)
    t = PERIOD * np.arange(SAMPLES)
    force = np.repeat(rng.uniform(-3.0, 3.0, SAMPLES // 50), 50)
    record = Recording(t, {"F": Signal(force), "y": Signal(np.cumsum(rng.standard_normal(SAMPLES)) * 0.01)})
    return Problem(model, record, {n: Parameter(BOX[n], scale="log") for n in names}, substeps=1)


if __name__ == "__main__":
    run("--quick" in sys.argv[1:])
