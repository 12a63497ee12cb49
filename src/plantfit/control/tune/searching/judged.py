"""Controllers judged on the plants that they have to keep the wishes on: every figure, each wish alone, and a row of
the table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains
from plantfit.control.steps.robust import stacked_controllers
from plantfit.control.tune.forms.form import Form
from plantfit.control.tune.frequency import Margins, loop_margins, noise_at_input, noise_in_moves, open_loop
from plantfit.control.tune.loop_scores import Judge, LoopScores
from plantfit.control.tune.searching.search import noises
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import SimulationError


class Judged(NamedTuple):
    """Controllers on plants, arrays (controllers, plants): `scores`, `ms`, `stable`, standard deviation
    `input_noise` of the input by the noise (share of its range), `kept` whether all wishes are, `meets`
    (controllers, plants, k) which `specifications` are, each alone."""

    scores: LoopScores
    ms: np.ndarray
    stable: np.ndarray
    input_noise: np.ndarray
    kept: np.ndarray
    meets: np.ndarray


@dataclass(frozen=True, eq=False)
class Row:
    """One controller of the table: its name, `form`, `parameters` and `source`; `scores` and `margins` on the best
    fit, the `share` of plants that keep the wishes and the `worst` tenth of overshoot, Ms and IAE (their 90 %
    quantiles)."""

    name: str
    form: Form
    parameters: Any
    source: str
    scores: LoopScores
    margins: Margins
    share: float
    worst: Mapping[str, float]

    @property
    def gains(self) -> Gains:
        """Of a PID, in parallel form; raises SimulationError for another form."""
        if not isinstance(self.parameters, Gains):
            raise SimulationError(
                f"An {self.form.name} has no Kp, Ki and Kd; its parameters are {', '.join(self.parameters._fields)}."
            )
        return self.parameters


def judged_on(
    judge: Judge, form: Form, controllers: Sequence[Any], h: np.ndarray, w: np.ndarray, wishes: Wishes, count: Any,
    outside: Any = 0
) -> Judged:  # fmt: skip
    """`Judged` of controllers of a form on the plants of a judge whose sampled responses are `h` (n, F), or (n, 2,
    F); `count` poles of every loop lie at 1, and `outside` the unit circle those of the plants, numbers for all or
    (n,)."""
    ms, stable, moved, moves, wide = [], [], [], [], []
    weights, noise = np.gradient(w) / np.pi * wishes.period, noises(wishes, form.inner)
    span = wishes.upper - wishes.lower
    for one in controllers:
        c = form.response(one, w)
        s = 1.0 / (1.0 + open_loop(c, h))
        seen = loop_margins(c, h, w, count, outside + form.unstable(one))
        ms.append(seen.ms)
        stable.append(seen.stable)
        wide.append(np.stack([seen.gain >= wishes.gain_margin, seen.phase >= wishes.phase_margin], axis=-1))
        moved.append(noise_at_input(c, s, weights, noise))
        moves.append(span * noise_in_moves(c, s, w, wishes.period, weights, noise))
    ms, stable = np.array(ms), np.array(stable)
    scores = judge.scores(stacked_controllers(list(controllers)), np.array(moves))
    scores = LoopScores(*(np.asarray(v) for v in scores))
    with np.errstate(invalid="ignore"):
        met = [
            stable, scores.overshoot <= wishes.overshoot, ms <= wishes.ms, scores.left <= wishes.settled,
            scores.outside <= wishes.tolerated, np.array(wide)[..., 0], np.array(wide)[..., 1],
            scores.settling <= wishes.settling,
            scores.travel <= wishes.travel,
        ]  # fmt: skip
    meets = np.stack(met, axis=-1)
    return Judged(scores, ms, stable, np.array(moved), np.all(meets, axis=-1), meets)


def specifications(wishes: Wishes) -> dict[str, int]:
    """What is asked for by name, with its place in `Judged.meets`; the last ones only where they are given."""
    asked = {"stable": 0, f"overshoot {wishes.overshoot:g} %": 1, f"Ms {wishes.ms:g}": 2, "at the set point": 3}
    ends = np.isfinite(wishes.output_lower) or np.isfinite(wishes.output_upper)
    more = {
        "within the limits": (4, ends), f"gain margin {wishes.gain_margin:g}": (5, wishes.gain_margin > 1),
        f"phase margin {wishes.phase_margin:g} deg": (6, wishes.phase_margin > 0),
        f"settling {wishes.settling:.4g} s": (7, np.isfinite(wishes.settling)),
        f"travel {wishes.travel:.4g}": (8, np.isfinite(wishes.travel)),
    }  # fmt: skip
    return asked | {name: k for name, (k, given) in more.items() if given}


def row_of(i: int, named: tuple[str, Form, Any, str], found: Judged, w: np.ndarray, h: np.ndarray, poles: int) -> Row:
    """A row of the table: name, form, parameters and source of controller number `i` of `found`; `h` is the sampled
    response of the best fit, `poles` count those of its loop at 1."""
    name, form, parameters, source = named
    first = LoopScores(*(float(v[i, 0]) for v in found.scores))
    own = loop_margins(form.response(parameters, w), h, w, poles, form.unstable(parameters))
    own = Margins(*(v[0].item() for v in own))

    def high(values):
        return float(np.quantile(np.where(np.isfinite(values), values, np.inf), 0.9, method="higher"))

    worst = {"overshoot": high(found.scores.overshoot[i]), "ms": high(found.ms[i]), "iae": high(found.scores.iae[i])}
    return Row(name, form, parameters, source, first, own, float(np.mean(found.kept[i])), worst)
