"""What the derivatives of multiple shooting cost: in one native loop, beside those of states that both modes can be
taken of.

    python -m benchmarks.shooting [--repeats 9]

A pendubot by voltage (4 states, 4 parameters, encoders) and a driven double well (2 states, 3 parameters), in 50
segments of 100 samples each, with the derivatives by local parameters and first states of each. The unit beside the
ratio is one simulation of the same segments.
"""

import argparse
import functools
from collections.abc import Callable
from unittest.mock import patch

import numpy as np

import plantfit as pf
from benchmarks.timing import timed
from plantfit.models.library.pendubot import pendubot
from plantfit.problem.shooting.start import Shooting
from plantfit.simulate.simulator import Simulator

SEGMENTS, SAMPLES = 50, 100
WELL = "x' = v\nv' = b*x - c*x^3 - d*v + u\ny = x"


def pendubot_problem() -> pf.Problem:
    """A pendubot that hangs, under random steps of voltage; what was measured does not matter here."""
    t = np.arange(SEGMENTS * SAMPLES) * 0.002
    V = np.repeat(np.random.default_rng(0).uniform(-3, 3, len(t) // 100), 100)
    signals = {"V": V, "theta1": -0.5 * np.pi + 0 * t, "theta2": 0 * t}
    return pf.Problem(pendubot("base", drive="voltage"), pf.from_arrays(t, signals=signals), stepper="rk4", substeps=1)


def well_problem() -> pf.Problem:
    """A double well driven into chaos."""
    t = np.arange(SEGMENTS * SAMPLES) * 0.02
    names = {"b": (0.1, 10.0), "c": (0.1, 10.0), "d": (0.01, 1.0)}
    model = pf.equations(
        WELL, inputs=["u"], states=["x", "v"], outputs=["y"], parameters={n: {"bounds": b} for n, b in names.items()}
    )
    return pf.Problem(
        model, pf.from_arrays(t, signals={"u": 0.5 * np.cos(1.2 * t), "y": 0 * t}), stepper="rk4", substeps=1
    )


def both_modes(states: Callable) -> Callable:
    """`Simulator.states` without its short cut for forward mode."""

    @functools.wraps(states)
    def slow(*given, forwards=False, **more):
        return states(*given, **more)

    return slow


def run(make: Callable[[], pf.Problem], repeats: int) -> tuple[float, float, float]:
    """Seconds of the derivatives in one loop and for both modes, and of a simulation."""
    shooting = Shooting.of(make(), segments=SEGMENTS)
    z = np.full(shooting.cut.local.shape, 0.5)
    states = np.asarray(shooting.functions["initial"](z, shooting.cut.segments))
    given = z, states, shooting.cut.segments
    alone = timed(lambda: shooting.functions["simulated"](*given), repeats).median
    loop = timed(lambda: shooting.functions["linearised"](*given), repeats).median
    with patch.object(Simulator, "states", both_modes(Simulator.states)):
        other = Shooting.of(make(), segments=SEGMENTS)
        slow = timed(lambda: other.functions["linearised"](*given), repeats).median
    return loop, slow, alone


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=9)
    repeats = parser.parse_args().repeats
    for name, make in (("pendubot", pendubot_problem), ("double well", well_problem)):
        loop, slow, alone = run(make, repeats)
        print(
            f"{name}: {1e3 * loop:.2f} ms in one loop, {slow / loop:.1f} "
            f"times that for both modes; {loop / alone:.0f} simulations"
        )


if __name__ == "__main__":
    main()
