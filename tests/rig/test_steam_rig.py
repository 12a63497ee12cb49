"""The virtual steam chamber: exact to a tight solver, its instruments true to their data sheets."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plantfit.errors import SimulationError
from plantfit.rig.steam_chamber import NODES, OPENINGS, SteamChamberRig, smooth_truth


@pytest.mark.parametrize("opening", [10, 73.0, 100])
def test_the_exact_pressure_agrees_with_a_tight_solver(opening):
    run = SteamChamberRig().record(opening, 1, 40.0)
    p, t = run.truth["parameters"], run.exact.t

    def rate(_, x):
        y = min(max(x[0], 0.0), 20.0)
        k, a1, a2 = (np.interp(y, NODES, p[n]) for n in ("k", "A1", "A2"))
        return [x[1], (k * opening - x[0] - a1 * x[1]) / a2]

    on = t > p["Td"]
    solved = solve_ivp(rate, (p["Td"], t[-1]), [0, 0], "Radau", t_eval=t[on], rtol=1e-9, atol=1e-11, max_step=0.5)
    np.testing.assert_allclose(run.exact["y"][on], solved.y[0], atol=3e-6)
    assert np.all(run.exact["y"][~on] == 0.0)


def test_the_truth_fits_the_boxes_of_the_tasks():
    for opening in np.linspace(10, 100, 37):
        p = smooth_truth(opening)
        assert np.all((p["k"] > 0.1) & (p["k"] < 1.5))
        assert all(np.all((p[n] > 0.1) & (p[n] < 160.0)) for n in ("A1", "A2"))
        assert 0.2 <= p["Td"] <= 0.8
    rest = [SteamChamberRig().record(u, 1).exact["y"][-1] for u in (10, 100)]
    assert 11 < rest[0] < 14
    assert 17 < rest[1] < 19


def test_readings_are_multiples_of_the_cards_step_and_as_noisy_as_told():
    rig = SteamChamberRig(errors=False)
    run = rig.record(50, 4)
    off = run.recording["y"] - run.exact["y"]
    step = 39 / 4096
    np.testing.assert_allclose(run.recording["y"] / step, np.round(run.recording["y"] / step), atol=1e-9)
    assert np.std(off) == pytest.approx(np.hypot(0.05, step / np.sqrt(12)), rel=0.05)
    assert abs(np.mean(off)) < 4 * 0.05 / np.sqrt(len(off))
    np.testing.assert_array_equal(rig.record(50, 4).recording["y"], run.recording["y"])


def test_instrument_errors_keep_within_the_data_sheet_and_are_one_set_up():
    rig = SteamChamberRig(noise=0.0, bits=24, zeroed=False)
    drawn = np.array([[list(e.values()) for e in rig.instrument_errors(s).values()] for s in range(300)])
    limits = np.array([0.039, 0.117])
    assert np.all(np.abs(drawn) <= limits[:, None])
    np.testing.assert_allclose(drawn.std(axis=(0, 2)), limits / np.sqrt(3), rtol=0.1)
    low, high = (rig.record(u, 7, 60.0) for u in (20, 90))
    line = np.polyfit(
        *(
            np.r_[low.exact["y"], high.exact["y"]],
            np.r_[low.recording["y"] - low.exact["y"], high.recording["y"] - high.exact["y"]],
        ),
        1,
    )
    assert line[1] == pytest.approx(drawn[7, :, 0].sum(), abs=1e-5)
    assert np.polyval(line, 39.0) == pytest.approx(drawn[7, :, 1].sum(), abs=1e-4)
    zeroed = SteamChamberRig(noise=0.0, bits=24).record(20, 7, 60.0)
    assert zeroed.recording["y"][0] == pytest.approx(0.0, abs=1e-5)


def test_a_slow_valve_with_limits_and_a_wandering_supply():
    run = SteamChamberRig(valve_limits=(5.0, 80.0), valve_rate=20.0).record(100, 1, 20.0)
    assert run.exact["valve"][0] == 5.0
    assert run.exact["valve"][10] == pytest.approx(25.0)
    assert run.exact["valve"][-1] == 80.0
    assert np.all(run.recording["u"] == 100.0)
    wandering = [SteamChamberRig(drift=0.02, drift_time=5.0).record(50, s, 200.0).exact["supply"] for s in range(5)]
    assert np.std(np.concatenate(wandering)) == pytest.approx(0.02, rel=0.25)
    correlation = np.mean([np.corrcoef(s[:-50], s[50:])[0, 1] for s in wandering])
    assert correlation == pytest.approx(np.exp(-1.0), abs=0.2)


def test_ten_openings_have_the_names_and_lengths_of_the_paper():
    runs = SteamChamberRig().records(1)
    assert list(runs) == [f"opening{u}" for u in OPENINGS]
    assert [len(r.recording) - 1 for r in runs.values()] == [4500, 4000, 3500, 3000, 2500, 2000, 1600, 1300, 1100, 900]


def test_wrong_settings_are_refused():
    with pytest.raises(SimulationError, match="noise is -1"):
        SteamChamberRig(noise=-1)
    with pytest.raises(SimulationError, match="valve_limits"):
        SteamChamberRig(valve_limits=(50, 20))
    with pytest.raises(SimulationError, match="opening is 0"):
        SteamChamberRig().record(0, 1)
    with pytest.raises(SimulationError, match="duration is 0 s"):
        SteamChamberRig().record(50, 1, 0.0)
