"""Structures chosen by blocks left out: scores against scipy on the same folds, and orders that are known."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from plantfit.errors import RecordingError
from plantfit.models.library.dc_motor import dc_motor
from plantfit.models.library.hammerstein_wiener import hammerstein_wiener
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter
from plantfit.trust.validate.blocks_left_out import Structure, blocks_left_out, choose_structure

STEP = 0.1


def first_order(gain, tau, u):
    """Exact, from rest under the first input."""
    a = np.exp(-STEP / tau)
    later = lfilter([1 - a], [1, -a], gain * u[:-1], zi=[a * gain * u[0]])[0]
    return np.concatenate([[gain * u[0]], later])


def record(noise=0.05, n=300, second=0.0):
    rng = np.random.default_rng(3)
    u = np.repeat(rng.choice([-1.0, 1.0], n // 10), 10)
    y = first_order(2.0, 0.5, u)
    y = first_order(1.0, second, y) if second else y
    y = y + noise * rng.standard_normal(n)
    y[[5, 150]] = np.nan
    return Recording(np.arange(n) * STEP, {"u": Signal(u, "V"), "y": Signal(y, "V")}, "steps")


def block(order):
    model = hammerstein_wiener("none", order, output_curve="polynomial", input_unit="V", output_unit="V")
    box = {f"a{k}": Parameter((0.02**k, 3.0**k), model.declared(f"a{k}").unit, "log") for k in range(1, order + 1)}
    return Structure(model, box | {"g0": Parameter((-2.0, 2.0)), "g1": Parameter((0.1, 10.0))})


def test_scores_are_those_of_scipy_on_the_same_blocks():
    r = record()
    made = blocks_left_out(block(1), r, blocks=4, substeps=4)
    error = lambda p: p[0] + first_order(p[1], np.exp(p[2]), r["u"]) - r["y"]  # noqa: E731
    seen = np.isfinite(r["y"])
    for score, place in zip(made, np.array_split(np.arange(len(r)), 4), strict=True):
        kept = seen.copy()
        kept[place] = False
        found = least_squares(lambda p, k=kept: error(p)[k], [0.5, 1.0, 0.0], xtol=1e-13, ftol=1e-13).x
        assert score == pytest.approx(np.sqrt(np.nanmean(error(found)[place] ** 2)), rel=1e-5)


def test_the_order_that_made_the_record_is_chosen():
    found = choose_structure({str(n): block(n) for n in (1, 2)}, record(second=0.15), blocks=4, substeps=4)
    assert found.simplest == "2"
    assert found.choice.gains["1"][0] > 3 * found.choice.gains["1"][1]


@pytest.mark.slow
def test_a_second_mode_that_is_not_there_is_not_chosen():
    found = choose_structure({str(n): block(n) for n in (1, 2)}, record(), blocks=4, substeps=4)
    assert found.simplest == "1"


def test_what_cannot_be_left_out_is_refused():
    r = record()
    with pytest.raises(RecordingError, match="blocks is 1"):
        blocks_left_out(block(1), r, blocks=1)
    y = r["y"].copy()
    y[:80] = np.nan
    empty = Recording(r.t, {"u": r.signals["u"], "y": Signal(y, "V")}, "empty")
    with pytest.raises(RecordingError, match="block 1 of 4"):
        blocks_left_out(block(1), empty, blocks=4)
    with pytest.raises(RecordingError, match="a model with one"):
        blocks_left_out(Structure(dc_motor(current_output=True), {}), r)
