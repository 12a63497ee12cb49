"""From an answer to a controller: `tune` asks for nothing that the study knows."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer
from plantfit.control.linear.cascade import Cascade
from plantfit.control.linear.predictive.servo_mpc import STEPS, multiplications
from plantfit.control.linear.servo import Servo
from plantfit.control.linear.smith import Smith
from plantfit.control.pid import Gains, gain_units
from plantfit.control.scheduling.design import ScheduleReport, scheduled_loops
from plantfit.control.scheduling.law import Schedule
from plantfit.control.scheduling.told import schedule_told
from plantfit.control.tune.loop_design import LoopDesign, tuned_loop
from plantfit.control.tune.one_loop import OneLoop
from plantfit.control.tune.searching.parts import begins
from plantfit.control.tune.told import curves, figure_units, table, verdict
from plantfit.control.tune.told import settings as settings_of
from plantfit.errors import ModelError, SpecError
from plantfit.findings.results.tuned_controller import (
    ControllerFront,
    FrontPoint,
    LoopSignal,
    PlanOfEverySample,
    ReducedPlant,
    ScheduledLevel,
    ScheduledLevels,
    TunedController,
)
from plantfit.findings.verdict import Sentence
from plantfit.loop_of_study import (
    ALLOWED,
    TRAIN,
    check_number,
    family,
    full_scales,
    inner_output,
    levels_to_hold,
    other_inputs,
    recording_of,
    signal_of,
    wishes_of,
)
from plantfit.models.model import Model
from plantfit.spec.tables import ControlTable
from plantfit.spec.wished import table_in, wished
from plantfit.trust.intervals.plausible import Plausible
from plantfit.trust.validate.doubts import doubts

if TYPE_CHECKING:
    from plantfit.control.c_export import CFiles

C_NAMES = {
    "LQI": "lqi",
    "MPC": "mpc",
    "Smith predictor": "smith",
    "cascade": "cascade",
    "scheduled PID": "scheduled",
    "LQR": "lqr",
}


@dataclass(frozen=True, eq=False)
class Controller:
    """A tuned controller: `parameters` of it (`Gains` of a PID, `Smith`, `Servo` of an LQI, `Predictive` of an MPC),
    `design` with all that it was judged by, `proposed` what was not asked for and where it is from; `number` and
    `full_scale` are those of its C file.

    `typed` has all figures as attributes, `record` the same as JSON types (docs: reference/results.md); `verdict` its
    sentences.
    """

    answer: Answer
    design: LoopDesign
    drawn: Plausible
    proposed: Mapping[str, str]
    output: str
    input: str
    how: str = ALLOWED
    schedule: ScheduleReport | None = None
    number: str = "double"
    full_scale: Mapping[str, float] | None = None

    @property
    def gains(self) -> Gains:
        """Of the PID tuned on all plants; parallel form, in the study's units. Raises SimulationError for another
        form."""
        return self.design.best.gains

    @property
    def parameters(self) -> Any:
        """Of the controller tuned on all plants, in the study's units: `Gains`, `Smith`, `Servo` or `Predictive`."""
        return self.design.best.parameters

    @property
    def verdict(self) -> list[dict[str, str]]:
        """Sentences with a level, good, info, warning or bad."""
        return [{"level": s.level, "sentence": s.sentence} for s in self.typed.verdict]

    def _sentences(self) -> list[Sentence]:
        n = self.design.family.count
        free = (
            {name: self.drawn.values[-n:, i] for i, name in enumerate(self.drawn.names)}
            if len(self.drawn.values) >= n
            else {}
        )
        told = verdict(self.design, {k: v for k, v in free.items() if len(v) == n}, self.how)
        if self.schedule is not None:
            told[1:1] = schedule_told(self.schedule, self.design, self.output)
        told[:0] = self._doubts
        if self.drawn.open:
            more = (
                f"{', '.join(self.drawn.open)} "
                f"{'is' if len(self.drawn.open) == 1 else 'are'} not determined by the data"
            )
            told.append(
                Sentence(
                    level="warning", sentence=f"{more}: the plants spread over the whole range that the data allow."
                )
            )
        if self.drawn.scatters:
            more = (
                f"Recordings scatter in {', '.join(self.drawn.scatters)}: "
                "plants are those of another recording, within 95 % of each."
            )
            told.append(Sentence(level="info", sentence=more))
        return told

    @cached_property
    def _doubts(self) -> list[Sentence]:
        """Why the plant may be another one than all that it was tuned on: these promises rest on the model."""
        return [Sentence(level=s["level"], sentence=s["sentence"]) for s in doubts(self.answer.findings)]

    @property
    def record(self) -> dict[str, Any]:
        """All figures as JSON types, but for what is infinite."""
        return self.typed.plain()

    @cached_property
    def typed(self) -> TunedController:
        """Everything but the curves."""
        d, model = self.design, self.design.family.model
        gain, lag, dead = d.reduced.first_order
        second = d.family.inner
        inner = None if second is None else LoopSignal(name=second, unit=model.outputs[second])
        return TunedController(
            name=self.answer.problem.name,
            form=d.best.form.name,
            units=self._units(),
            inner=inner,
            output=LoopSignal(name=self.output, unit=model.outputs[self.output]),
            input=LoopSignal(name=self.input, unit=model.inputs[self.input]),
            others=dict(d.family.others),
            wishes=d.wishes,
            proposed=dict(self.proposed),
            plants=d.family.count,
            plants_are=self.how,
            not_determined=list(self.drawn.open),
            reduced=ReducedPlant(
                how=d.reduced.how, gain=gain, lag=lag, dead_time=dead, integrating=d.reduced.integrating,
                second_order=list(d.reduced.second_order),
            ),
            plan=self._plan(),
            tracking_time=d.tracking_time,
            front=self._front(),
            schedule=self._schedule(),
            held=d.held,
            promised=d.promised,
            controllers=table(d),
            verdict=self._sentences(),
        )  # fmt: skip

    def _units(self) -> dict[str, str]:
        """Of the gains; those of a cascade's inner PI are `inner_Kp` and `inner_Ki`, its outer PID commands the
        inner output, and `K` is of the PIDs that stand beside it."""
        model, second = self.design.family.model, self.design.family.inner
        u = model.inputs[self.input]
        plain = gain_units(model.outputs[self.output], u)
        if second is None:
            return plain
        v = model.outputs[second]
        return (
            {"K": plain["Kp"]}
            | gain_units(model.outputs[self.output], v)
            | {f"inner_{n}": unit for n, unit in gain_units(v, u).items() if n != "Kd"}
        )

    def _schedule(self) -> ScheduledLevels | None:
        """The gains of every level, and what they and single PIDs are worth there."""
        found = self.schedule
        if found is None:
            return None
        levels = [
            ScheduledLevel(level=r.level, step=r.step, share=r.scheduled, alone=r.alone.tolist(), iae=r.iae,
                           settings=settings_of(r.gains))
            for r in found.levels
        ]  # fmt: skip
        over = found.across.overshoot
        return ScheduledLevels(
            levels=levels, every=found.every, single=found.single.tolist(), best_single=found.best_single,
            across_overshoot=float(np.quantile(np.where(np.isfinite(over), over, np.inf), 0.95, method="higher")),
        )  # fmt: skip

    def _front(self) -> ControllerFront | None:
        """The controllers none of which is better in every figure that was asked for."""
        front, model = self.design.front, self.design.family.model
        if front is None:
            return None
        units = figure_units(model.outputs[self.output], model.inputs[self.input])
        points = [
            FrontPoint(number=k + 1, figures=dict(zip(front.names, map(float, row), strict=True)),
                       share=float(front.shares[k]),
                       settings=settings_of(front.controllers[k]))
            for k, row in enumerate(front.figures)
        ]  # fmt: skip
        return ControllerFront(
            figures=list(front.names), units={n: units[n] for n in front.names}, picked=front.picked, points=points
        )

    def _plan(self) -> PlanOfEverySample | None:
        """What an MPC does every sample; None for another form."""
        best, plan = self.design.best, self.design.best.form.plan
        if plan is None:
            return None
        return PlanOfEverySample(
            seconds=plan.seconds,
            dead_time=plan.plant.ahead * plan.plant.period,
            moves=plan.lengths.tolist(),
            rows=len(best.parameters.plan.low),
            steps=STEPS,
            multiplications=multiplications(best.parameters),
        )

    @property
    def curves(self) -> dict[str, Any]:
        """Responses and sensitivities of the family for figures: bands and lines, arrays by name."""
        return curves(self.design)

    def to_c(self, folder: str | Path, name: str | None = None, number: str | None = None, **more: Any) -> "CFiles":
        """The controller as NAME.h and NAME.c (`control.c_export`: pid_to_c, smith_to_c, servo_to_c,
        servo_mpc_to_c)."""
        from plantfit.control.c_export import (
            cascade_to_c,
            pid_to_c,
            scheduled_to_c,
            servo_mpc_to_c,
            servo_to_c,
            smith_to_c,
        )

        w, model, best = self.design.wishes, self.design.family.model, self.design.best
        told = {"measurement": model.outputs[self.output], "command": model.inputs[self.input]}
        first = "\n".join(s["sentence"] for s in self.verdict[: len(self._doubts) + 1])
        shared: dict[str, Any] = {
            "period": w.period, "number": number or self.number,
            "name": name or c_name(self.answer.problem.name, best.form.name),
            "units": {k: v for k, v in told.items() if v},
            "note": f"Tuned by plantfit for {self.answer.problem.name}.\n{first}", **more,
        }  # fmt: skip
        if best.form.plan is not None:
            return servo_mpc_to_c(
                best.parameters, folder, inputs=len(best.form.plan.lengths), rated=best.form.plan.rated, **shared
            )
        shared |= {"lower": w.lower, "upper": w.upper}
        if isinstance(best.parameters, Servo):
            return servo_to_c(best.parameters, folder, **shared)
        shared |= {"anti_windup": w.anti_windup, "tracking_time": self.design.tracking_time}
        if isinstance(best.parameters, Cascade):
            inner = self.design.family.inner or ""
            shared |= {"inner_lower": w.inner_lower, "inner_upper": w.inner_upper, "signals": (self.output, inner)}
            return cascade_to_c(best.parameters, folder, inner_unit=model.outputs[inner], **shared)
        if isinstance(best.parameters, Schedule):
            return scheduled_to_c(best.parameters, folder, **shared)
        if isinstance(best.parameters, Smith):
            return smith_to_c(best.parameters, folder, ahead=best.form.ahead, **shared)
        if shared["number"] in ("q15", "q31"):
            shared.setdefault("full_scale", self.full_scale)
        return pid_to_c(best.parameters, folder, **shared)

    def __repr__(self) -> str:
        from plantfit.report.pages.controller import settings

        head = f"{self.design.best.form.name} of {self.output} by {self.input}: {settings(self.typed)}"
        return "\n".join([head, *(f"  {v['level']}: {v['sentence']}" for v in self.verdict)])


def c_name(name: str, form: str) -> str:
    """A study's name as a name of C, with that of the controller."""
    word = re.sub(r"\W", "_", name, flags=re.ASCII).strip("_") or "controller"
    return f"{word if word[0].isalpha() else f'c_{word}'}_{C_NAMES.get(form, 'pid')}"


def tune(
    answer: Answer,
    *,
    budget: int = 400,
    seed: int = 1,
    progress: Callable[[Any], None] | None = None,
    control: Mapping[str, Any] | None = None,
    draws: Mapping[str, Any] | None = None,
    **wishes: Any,
) -> Controller:
    """A controller (PID to MPC) for an answer's plant, tuned on plants that the data allow and judged on others, beside
    classical rules.

    The plants are others where tolerances={"tau": "10 %"} states them (evenly within value +- tolerance, all other
    parameters held), or where `draws` holds them: arrays (n,) by name of the model's parameters, 100 plants or more.

    `wishes` are the keys of the study file's [control] table (docs/tuning-controllers.md), numbers in the study's units
    or texts with a unit, such as set_point="60 degC", output="T1", controller="mpc", plants=500. They count before
    `control`, the table itself, by default that of the answer's study file; what both leave out is proposed. Raises
    SimulationError for a plant that cannot be tuned so, SpecError and UnitError for wishes.
    """
    chosen = _table(answer, control, wishes)
    if chosen.hold or chosen.controller == "lqr":
        raise SpecError(
            "pf.hold(answer, hold=...) or `plantfit tune --hold` "
            "holds an equilibrium; tune() closes a loop of one output."
        )
    model = answer.problem.model
    if not isinstance(model, Model):
        raise ModelError(
            "A regression has no plant that can be simulated, so no loop can be tuned; put its values into a model "
            "with states, or design "
            "with lqr or mpc on its equations (docs/control.md)."
        )
    output, input_ = (
        signal_of("output", chosen.output, tuple(model.outputs)),
        signal_of("input", chosen.input, tuple(model.inputs)),
    )
    recording = recording_of(answer, chosen.recording)
    check_number(chosen, output, input_)
    begins(progress, "drawing plants")
    drawn, plants, how = family(answer, chosen, recording, draws, seed)
    count = len(drawn.values) - 1 - TRAIN
    own = answer.problem.experiments[recording].recording
    others, inner = other_inputs(own, model, input_, chosen), inner_output(chosen, model, output)
    loop = OneLoop(model, output, input_, others, plants, inner)
    proposed: dict[str, str] = {}
    final = wishes_of(answer, loop, chosen, recording, proposed)
    train, fresh = np.arange(0, TRAIN + 1), np.r_[0, np.arange(TRAIN + 1, TRAIN + 1 + count)]
    both, schedule = (loop.part(train), loop.part(fresh)), None
    if final.controller == "scheduled":
        if chosen.front:
            raise SpecError(
                "A front of scheduled PIDs is not searched; leave front out, or ask for another controller."
            )
        levels = levels_to_hold(loop, chosen, final, answer, proposed)
        design, schedule = scheduled_loops(*both, final, levels, budget=budget, seed=seed, progress=progress)
    else:
        design = tuned_loop(
            *both,
            final,
            budget=budget,
            seed=seed,
            progress=progress,
            front=tuple(chosen.front),
            points=chosen.points,
            pick=chosen.pick,
        )
    plan = design.best.form.plan
    if plan is not None and final.prediction is None:
        proposed["prediction"] = (
            f"{plan.seconds:.4g} s: the dead time of {plan.plant.ahead * plan.plant.period:.4g} "
            "s, and then as long as the plant's lag and dead time; after it the LQ servo goes on"
        )
    judged = replace(drawn, values=drawn.values[fresh][design.rows_used])
    scale = full_scales(answer, chosen, final, loop, proposed)
    return Controller(answer, design, judged, proposed, output, input_, how, schedule, chosen.number, scale)


def _table(answer: Answer, control: Mapping[str, Any] | None, wishes: Mapping[str, Any]) -> ControlTable:
    return wished(ControlTable, table_in(answer.spec, "control") if control is None else control, wishes, "tune")
