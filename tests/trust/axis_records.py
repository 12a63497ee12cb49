"""Records of a mass on an axis with friction of which the truth is known, and a study of its force as a regression."""

import numpy as np

from plantfit import Recording, Signal
from plantfit.spec import load

MASS, VISCOUS = 2.3, 4.1


def record(seed, missing, n=1500, noise=0.1):
    """A motion of known sines, and the force that it takes: with `missing` a part of q and v that the model does not
    have."""
    rng, t = np.random.default_rng(seed), np.arange(n) * 0.01
    w, p = 2 * np.pi * np.array([0.13, 0.41, 0.97]) * rng.uniform(0.9, 1.1, 3), rng.uniform(0, 6, 3)
    size = np.array([0.4, 0.15, 0.05])[:, None]
    waves = w[:, None] * t + p[:, None]
    q, v, a = (
        np.sum(size * np.sin(waves), 0),
        np.sum(size * w[:, None] * np.cos(waves), 0),
        -np.sum(size * w[:, None] ** 2 * np.sin(waves), 0),
    )
    force = MASS * a + VISCOUS * v + missing(q, v) + noise * rng.standard_normal(n)
    return Recording(
        t, {"q": Signal(q, "m"), "v": Signal(v, "m/s"), "a": Signal(a, "m/s^2"), "force": Signal(force, "N")}, "run"
    )


def study(tmp_path, seed, missing, filtered):
    r = record(seed, missing, noise=0.02)
    rows = np.column_stack([r.t, r["v"], r["a"], r["force"]])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,velocity,acceleration,force", comments="")
    options = "filter_alike = { cutoff = 10.0, every = 2 }\n" if filtered else ""
    text = (
        'name = "axis"\n[recording.run]\nfile = "run.csv"\ntime = "t"\nsplit = 0.7\n'
        'signals = { velocity = "velocity", acceleration = "acceleration", force = "force" }\n'
        'units = { velocity = "m/s", acceleration = "m/s^2", force = "N" }\n'
        f'[model]\nkind = "drive_regression"\n{options}[parameters]\n'
        "M = { bounds = [0.1, 100] }\nFv = { bounds = [0.1, 100] }\nFc = { value = 0.0 }\noffset = { bounds = [-10, "
        "10] }\n"
    )
    (tmp_path / "axis.toml").write_text(text)
    return load(tmp_path / "axis.toml")
