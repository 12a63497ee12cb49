"""Problems, spaces and recordings say in three lines what they are."""

import numpy as np
from face_plants import heated, heater_model

import plantfit as pf


def test_a_recording_tells_counts_times_units_and_where_it_comes_from():
    t = 5.0 + np.arange(0.0, 20.0, 0.5)
    y = t.copy()
    y[3] = np.nan
    r = pf.from_arrays({"t": t, "u": (t, "V"), "y": y}, name="bench")
    assert repr(r).split("\n") == [
        "Recording 'bench': 40 samples, 5 to 24.5 s, every 0.5 s",
        "  signals: u [V], y (1 missing)",
        f"  From arrays in memory. ({len(r.log) - 1} more steps in .log)",
    ]
    uneven = pf.Recording(np.array([0.0, 1.0, 4.0]), {"u": pf.Signal(np.zeros(3))})
    assert repr(uneven).split("\n")[0] == "Recording 'recording': 3 samples, 0 to 4 s, uneven: 1 to 3 s apart"
    assert repr(uneven).split("\n")[2] == "  Made in Python."
    many = pf.from_arrays({f"s{k}": t for k in range(50)}, period=1.0)
    assert len(repr(many).split("\n")) == 3
    assert "and 38 more" in repr(many)


def test_a_problem_tells_model_parameters_recordings_and_signals():
    t = np.arange(0.0, 100.0, 1.0)
    one = pf.Problem(heater_model(), heated(t), {"K": 0.6}, split=0.7, name="lab")
    assert repr(one).split("\n") == [
        "Problem 'lab': model 'heater', 2 free: T0, tau; held: K",
        "  recordings: bench (100 samples, 0 to 99 s: 70 fitted, 30 unseen)",
        "  outputs: T [degC]; inputs: u [W]",
    ]
    several = pf.Problem(heater_model(), {f"r{k}": heated(t) for k in range(6)}, validate=["r1"])
    assert "r1 (100 samples, 0 to 99 s: 100 unseen)" in repr(several)
    assert "and 2 more" in repr(several)
    static = pf.equations("y = a*u", inputs=["u"], outputs=["y"], parameters={"a": {"bounds": (0, 1)}})
    rows = pf.from_arrays({"u": t, "y": t}, period=1.0, name="rows")
    assert "rows (100 samples at rest)" in repr(pf.Problem(static, pf.Experiment(rows, steady=True)))


def test_a_space_tells_bounds_units_and_what_is_held_or_tied():
    space = pf.Space(
        {
            "R": pf.Parameter((0.1, 10.0), "ohm", "log"),
            "x0": pf.Parameter((0, 5), "V", per_recording=True),
            "K": pf.Parameter(value=2.0),
            "Kt": pf.Parameter(tied="R"),
        },
        ("a", "b"),
    )
    assert repr(space).split("\n") == [
        "Space of 3 free coordinates, with values of their own for a, b",
        "  R: 0.1 to 10 ohm (log), x0[a]: 0 to 5 V, x0[b]: 0 to 5 V",
        "  held: K = 2; tied: Kt = R",
    ]
    assert repr(pf.Space({"R": pf.Parameter((0.0, 1.0))})).split("\n") == [
        "Space of 1 free coordinate", "  R: 0 to 1", "  held: none; tied: none",
    ]  # fmt: skip
    wide = pf.Space({"k": pf.Parameter((0.0, 1.0), shape=(40,))})
    assert len(repr(wide).split("\n")) == 3
    assert "28 more" in repr(wide)
