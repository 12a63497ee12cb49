"""The demos by name; a driver is imported only when it is asked for."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

Run = Callable[..., dict[str, Any]]

_SENTENCES = {
    "pendubot": "A pendubot on a virtual rig: PSO, genetic algorithm and salp swarm beside the optimum, what the "
    "torque determines, and controllers.",
    "gearmotor": "A real geared DC motor: a first model, what it lacks, physics that predicts its static curve, and a "
    "controller.",
    "tanks": "Two tanks in series with overflow: an upper level that nobody measured, and the unseen last quarter "
    "predicted.",
    "emps": "A linear drive with friction: force regression, free run from the measured force, and the closed loop.",
    "double_pendulum": "A real double pendulum: torque of both joints, a friction law chosen by runs left out, angles "
    "simulated from it.",
    "motor": "A DC motor on a microcontroller's virtual bench: surrogate, two error signals, a genetic algorithm, and "
    "what they can know.",
    "steam": "A steam chamber on a virtual rig: dead time and 310 parameters, five methods, and what exact derivatives "
    "change.",
    "exchanger": "A plate heat exchanger: one table model for a staircase, and how far it holds half a year later.",
    "heater": "A heater board: gain, lag and dead time of one heater with intervals, and energy balances of two.",
    "thermal": "A heated element whose surroundings drift: a dead time that cannot be told from zero.",
    "robot": "A robot's motor on a virtual bench: identified, then its PID tuned by 300 000 closed loops and by a "
    "hundredth of them.",
}

# seconds of processor time on one core of a server (x86-64, 2026) with compiled code in the cache, measured
_SECONDS = {
    "pendubot": 31, "gearmotor": 25, "tanks": 3, "emps": 11, "double_pendulum": 22, "motor": 51, "steam": 67,
    "exchanger": 26,
    "heater": 4, "thermal": 5, "robot": 23,
}  # fmt: skip
TIMED_ON = (
    "Times are of one core of an x86-64 server, without --full. A first run compiles for up to half a minute more."
)


def seconds(name: str) -> int:
    """How long a demo takes, without `full`: processor time in s, see `TIMED_ON`."""
    return _SECONDS[name]


def demos() -> dict[str, tuple[str, Callable[[], Run]]]:
    """Name -> (sentence, loader); `loader()` gives `run(folder, progress=None) -> record`, some with `full=False`
    besides.

    `run` copies the study files and recordings of the demo into `folder` (made when missing), fits
    them there and returns a record:

        {"name": str, "title": str,
         "figures": [{"name", "value", "unit", "reference": number | None, "source": str}],
         "found": [what was found, str; may be none], "sentences": [str], "answers": [Answer], "files": [Path of each
         study file], "subtitle": str, "sections": [parts of a page of its own, see `plantfit.report.case_page`; may be
         none], "pages": [Path of each further page that was written]}

    Everything but `answers`, `files` and `pages` is of JSON types. Raises StoreError for a folder that cannot be
    written to.
    """
    return {name: (sentence, _loader(name)) for name, sentence in _SENTENCES.items()}


def _loader(name: str) -> Callable[[], Run]:
    return lambda: import_module(f"plantfit.cases.{name}.demo").run
