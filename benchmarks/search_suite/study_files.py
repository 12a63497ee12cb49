"""Problems written as study files: recordings in CSV beside a TOML text, read as `plantfit run` reads them."""

import tempfile
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

import plantfit as pf
from benchmarks.search_suite.case import FINER, Drives
from benchmarks.search_suite.oscillators import steps
from plantfit.space import Parameter
from plantfit.spec import parse


@dataclass(frozen=True, eq=False)
class StudyCase:
    """A study file `text` whose recordings NAME lie in NAME.csv, with `truth` and `noise` from which they are made.

    `[simulation]` of the text states its substeps as `substeps = N`; the data are made with finer ones.
    """

    name: str
    family: str
    sentence: str
    text: str
    truth: Mapping[str, float]
    noise: Mapping[str, float]
    drives: Callable[[np.random.Generator], Drives]
    seed: int = 0

    @property
    def perfect(self) -> bool:
        return not any(self.noise.values())

    @cached_property
    def parameters(self) -> Mapping[str, Parameter]:
        """Bounds by name, as the text states them."""
        return {n: Parameter(tuple(p["bounds"])) for n, p in tomllib.loads(self.text)["parameters"].items()}

    def problem(self) -> pf.Problem:
        """The problem with its data."""
        return _problem(self)


@lru_cache(maxsize=4)
def _problem(case: StudyCase) -> pf.Problem:
    rng = np.random.default_rng([case.seed, *case.name.encode()])
    drives = case.drives(rng)
    substeps = tomllib.loads(case.text)["simulation"]["substeps"]
    finer = case.text.replace(f"substeps = {substeps}", f"substeps = {FINER * substeps}")
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / "study.toml"
        for name, (t, inputs) in drives.items():
            _write(study.with_name(f"{name}.csv"), t, {**inputs, **{o: np.zeros(len(t)) for o in case.noise}})
        source = parse(finer, study).problem
        values = source.space.vector(case.truth)
        for name, (t, inputs) in drives.items():
            clean = source.predict(values, name)
            noisy = {o: np.asarray(clean[o]) + s * rng.standard_normal(len(t)) for o, s in case.noise.items()}
            _write(study.with_name(f"{name}.csv"), t, {**inputs, **noisy})
        return parse(case.text, study).problem


def _write(file: Path, t: np.ndarray, signals: Mapping[str, np.ndarray]) -> None:
    columns = np.column_stack([t, *signals.values()])
    np.savetxt(file, columns, fmt="%.17g", delimiter=",", header=",".join(["t", *signals]), comments="")


CASES = (
    StudyCase(
        "late ringing",
        "dead time",
        "A ringing plant behind a dead time, two recordings with an offset of their own.",
        """
name = "late ringing"

[recording.morning]
file = "morning.csv"
time = "t"
units = { u = "V", y = "mm" }

[recording.evening]
file = "evening.csv"
time = "t"
units = { u = "V", y = "mm" }

[model]
inputs = { u = "V" }
outputs = { y = "mm" }
states = { x = "mm", v = "mm/s" }
equations = '''
x' = v
v' = w^2*(K*delay(u, L) - x) - 2*z*w*v
y = x + off
'''

[parameters.K]
bounds = [-2.3, 3.1]
unit = "mm/V"

[parameters.w]
bounds = [0.3, 7.3]
unit = "rad/s"

[parameters.z]
bounds = [0.02, 1.4]

[parameters.L]
bounds = [0.2, 54.0]
unit = "s"

[parameters.off]
bounds = [-9.0, 14.0]
unit = "mm"
per_recording = true

[simulation]
substeps = 2
""",
        {"K": 0.9, "w": 2.07, "z": 0.17, "L": 12.37, "off[morning]": 1.3, "off[evening]": -0.6},
        {"y": 1.1},
        steps(("u",), 120, 0.5, 10.0, 4, ("morning", "evening")),
    ),
    StudyCase(
        "moment of a dose",
        "exponentials",
        "Two outputs after one dose at an unknown moment, washed out at two rates.",
        """
name = "moment of a dose"

[scales]
p = 0.4
q = 0.3

[recording.visit]
file = "visit.csv"
time = "t"
units = { p = "mg", q = "mg" }

[model]
outputs = { p = "mg", q = "mg" }
check_units = false
equations = '''
since = pos(t - begin)
p = a*(exp(-slow*since) - exp(-fast*since))
q = b*since*exp(-fast*since) + base
'''

[parameters.a]
bounds = [0.0, 71.0]
unit = "mg"

[parameters.b]
bounds = [-21.0, 33.0]
unit = "mg"

[parameters.base]
bounds = [-7.0, 9.0]
unit = "mg"

[parameters.slow]
bounds = [0.01, 9.0]
unit = "1/s"

[parameters.fast]
bounds = [0.01, 19.0]
unit = "1/s"

[parameters.begin]
bounds = [-60.0, 990.0]
unit = "s"

[simulation]
substeps = 1
""",
        {"a": 9.2, "b": 3.4, "base": 0.7, "slow": 0.043, "fast": 0.31, "begin": 612.3},
        {"p": 0.4, "q": 0.3},
        lambda rng: {"visit": (np.linspace(0.0, 900.0, 300), {})},
    ),
    StudyCase(
        "sliding in a groove",
        "friction",
        "Force on a slide: Stribeck friction and the ripple of a screw of unknown pitch, worse in one direction.",
        """
name = "sliding in a groove"

[recording.stroke]
file = "stroke.csv"
time = "t"
units = { x = "mm", v = "mm/s", y = "N" }

[model]
inputs = { x = "mm", v = "mm/s" }
outputs = { y = "N" }
check_units = false
equations = '''
y = sign(v)*(Fc + S*exp(-(v/vs)^2)) + (1 + lame*sign(v))*a*sin(n*x + phi)
'''

[parameters.Fc]
bounds = [0.0, 61.0]
unit = "N"

[parameters.S]
bounds = [-9.0, 47.0]
unit = "N"

[parameters.vs]
bounds = [0.1, 140.0]
unit = "mm/s"

[parameters.lame]
bounds = [-0.9, 1.1]

[parameters.a]
bounds = [0.0, 17.0]
unit = "N"

[parameters.n]
bounds = [0.02, 2.7]
unit = "rad/mm"

[parameters.phi]
bounds = [-3.0, 3.4]
unit = "rad"

[simulation]
substeps = 1
""",
        {"Fc": 8.3, "S": 5.1, "vs": 7.2, "lame": 0.31, "a": 2.2, "n": 1.17, "phi": 0.9},
        {"y": 0.9},
        lambda rng: {
            "stroke": (
                np.arange(200.0),
                {
                    "x": 60.0 - 60.0 * np.cos(np.linspace(0.0, 2 * np.pi, 200)),
                    "v": 60.0 * np.sin(np.linspace(1e-3, 2 * np.pi - 1e-3, 200)),
                },
            )
        },
    ),
)
