"""Where only ratios are known, no refit that the edge of the room holds tells an end of a range."""

import numpy as np
import pytest

import plantfit as pf
from plantfit.trust.finish.descent import descent
from plantfit.trust.intervals.follow.following import followed_ranges
from plantfit.trust.intervals.linearised import linearise

TRUTH = {"A": 1.2e-3, "b": 900.0, "m": 80.0, "E": 1.556e12, "k": 2.2e-8, "ps": 1.4e7, "Cl": 2e-12}
BOX = {
    "A": (2e-4, 5e-3), "b": (10.0, 1e4), "m": (10.0, 1e3), "E": (1e11, 1e13), "k": (1e-9, 1e-6), "ps": (5e6, 3e7),
    "Cl": (1e-14, 1e-10),
}  # fmt: skip


def cylinder(seed: int) -> pf.Problem:
    """Stroke and load pressure of a hydraulic cylinder behind a valve: b/A, m/A, A*E, k/A, Cl/A and ps are known."""
    rng, n = np.random.default_rng(seed), 2800
    t, u = np.arange(n) * 0.002, np.repeat(rng.uniform(-6, 6, n // 125 + 1), 125)[:n]
    model = pf.equations(
        "s' = v\nv' = (A*pl - b*v)/m\npl' = E*(k*u*sqrt(max(ps - sign(u)*pl, 0)) - A*v - Cl*pl)\nx = s\np = pl",
        inputs=["u"], outputs=["x", "p"], parameters=list(TRUTH),
        states={"s": {"initial": 0.2}, "v": {"initial": 0.0}, "pl": {"initial": 0.0}},
    )  # fmt: skip
    box = {p: pf.Parameter(b, scale="linear" if p == "ps" else "log") for p, b in BOX.items()}
    empty = pf.from_arrays({"t": t, "u": u, "x": 0 * t, "p": 0 * t})
    scales = {"x": 5e-5, "p": 6e4}
    problem = pf.Problem(model, empty, box, substeps=4, scales=scales)
    clean = problem.predict(problem.space.vector(TRUTH))
    noisy = {o: clean[o] + s * rng.normal(size=n) for o, s in scales.items()}
    return pf.Problem(model, pf.from_arrays({"t": t, "u": u, **noisy}), box, substeps=4, scales=scales)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("seed", "times"),
    [(1, 2.5), (2, 3.5), *(pytest.param(s, k, marks=SLOW) for s in (4, 6, 8) for k in (0.5, 1.7, 3.5))],
)
@pytest.mark.thorough
def test_what_is_known_as_ratios_has_no_ends(seed, times):
    """A run said "Cl is at least 4.4e-15", and of other records that E is at most 2.8e14: where A and others stood on
    edges of the room, refits that cost 300 times the threshold counted as inside and those above it as outside.
    """
    problem = cylinder(seed)
    start = TRUTH | {p: TRUTH[p] * times for p in ("A", "b", "m", "k", "Cl")} | {"E": TRUTH["E"] / times}
    end = descent(problem, problem.space.cube(problem.space.vector(start)))
    local = linearise(problem, end.z)
    assert local.linear is not None
    ranges = followed_ranges(problem, end.z, local.linear, 0.0)
    names = list(problem.space.names)
    for p in ("A", "b", "m", "E", "k", "Cl"):
        found = ranges[names.index(p)]
        assert found.low < 1e-6 * TRUTH[p]
        assert found.high == np.inf
    known = ranges[names.index("ps")]
    assert known.low < TRUTH["ps"] < known.high < 1.05 * TRUTH["ps"]
