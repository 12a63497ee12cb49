"""One recording of the double pendulum, and the filtered columns of a friction law on it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

import plantfit.recording as rec
from plantfit.cases.double_pendulum.fits.laws import Fitted, Law, model_of
from plantfit.cases.double_pendulum.reference import CUTOFF_SHARE, EDGE, JOINTS, reference_torque
from plantfit.problem.measure.filter_alike import filter_alike
from plantfit.recording.record import Recording, Signal

PERIOD = 0.002  # s, the grid on which filters work
CUTOFF = CUTOFF_SHARE * 0.5 / PERIOD  # Hz
NUDGE = 1e-3  # rad


@dataclass(frozen=True, eq=False)
class Run:
    """One recording: `raw` as measured, `motion` smoothed on its own time stamps, and what is made of both."""

    raw: Recording
    motion: Recording
    kept: dict[Any, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, raw: Recording) -> "Run":
        motion = raw
        for j in JOINTS:
            motion = rec.smooth_motion(motion, f"theta{j}", f"omega{j}", f"alpha{j}")
        return cls(raw, motion)

    @cached_property
    def grid(self) -> Recording:
        """The motion on an even grid, made from the time stamps."""
        return rec.resample(self.motion, PERIOD)

    def shifted(self, zeros: Sequence[float] | np.ndarray) -> "Run":
        """The same where the encoders' zeros were `zeros` (rad) lower."""
        moved = self.motion
        for j, zero in zip(JOINTS, zeros, strict=True):
            moved = rec.subtract(moved, f"theta{j}", -zero)
        return Run(self.raw, moved)

    def signals(self, law: Law, shape: float, first: Fitted | None, even: bool = True) -> Recording:
        """The recording with the friction states and the loads that a law reads."""
        made = self.grid if even else self.motion
        for j in JOINTS if law.sign == "presliding" else ():
            made = rec.presliding(made, f"theta{j}", f"slide{j}", shape)
        if first is not None:
            below = self.signals(first.law, first.shape, None, even)
            signals = dict(made.signals)
            for j in JOINTS:
                signals[f"load{j}"] = Signal(
                    first.model.predict({n: below[n] for n in first.model.signals}, first.values, f"tau{j}"), "N*m"
                )
            made = Recording(made.t, signals, made.name, made.log)
        return made

    def block(self, law: Law, shape: float, first: Fitted | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Columns (2, n, k) and torque (2, n), filtered alike on the grid and read at the recorded times that are
        scored."""
        key = law.parts, law.sign, shape, None if first is None else tuple(first.values.values())
        if key not in self.kept:
            model = model_of(law, shape)
            columns, made = filter_alike(model, {"run": self.signals(law, shape, first)}, CUTOFF, drop=0.0)
            run, at = made["run"], self.raw.t[EDGE:-EDGE]
            blocks = columns.blocks({n: run[n] for n in columns.signals})
            A = np.stack([np.stack([np.interp(at, run.t, c) for c in blocks[f"tau{j}"].T], axis=-1) for j in JOINTS])
            self.kept[key] = A, reference_torque(self.raw)
        return self.kept[key]

    def slopes(self, law: Law, shape: float, first: Fitted | None = None) -> list[np.ndarray]:
        """The columns (2, n, k) by each angle, per rad."""
        nudged = [self.nudged(j) for j in JOINTS]
        return [(n.block(law, shape, first)[0] - self.block(law, shape, first)[0]) / NUDGE for n in nudged]

    def nudged(self, joint: int) -> "Run":
        """The run with one angle moved by `NUDGE`; the same one every time."""
        if joint not in self.kept:
            self.kept[joint] = self.shifted([NUDGE * (joint == j) for j in JOINTS])
        return self.kept[joint]
