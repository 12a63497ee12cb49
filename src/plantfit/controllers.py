"""From an answer to a controller: `tune` asks for nothing that the study knows."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit import units
from plantfit.answer import Answer
from plantfit.control.linear.cascade import Cascade
from plantfit.control.linear.predictive.servo_mpc import STEPS, multiplications
from plantfit.control.linear.servo import Servo
from plantfit.control.linear.smith import Smith
from plantfit.control.pid import Gains, gain_units
from plantfit.control.scheduling.design import ScheduleReport, scheduled_loops
from plantfit.control.scheduling.law import Schedule
from plantfit.control.scheduling.told import schedule_told
from plantfit.control.tune.loop_design import MOST_SAMPLES, LoopDesign, course_seconds, tuned_loop
from plantfit.control.tune.one_loop import OneLoop
from plantfit.control.tune.proposals import levels_of, noise_of, quantum_of, rounded
from plantfit.control.tune.reduction import reduced, slowest
from plantfit.control.tune.stated import JUDGES, given_draws, toleranced
from plantfit.control.tune.told import curves, figure_units, table, verdict
from plantfit.control.tune.told import settings as settings_of
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import ModelError, SimulationError, SpecError
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
from plantfit.models.model import Model
from plantfit.spec.tables import ControlTable
from plantfit.spec.wished import table_in, wished
from plantfit.trust.intervals.plausible import Plausible, plausible

if TYPE_CHECKING:
    from plantfit.control.c_export import CFiles

TRAIN = 80  # plants that gains are searched on; others judge them
SHARES = (0.2, 0.35, 0.5, 0.8, 0.1, 0.05)  # of the recorded range of the output: steps that are proposed
ALLOWED, STATED, GIVEN = "that the data allow", "within the stated tolerances", "of the given draws"
RESOLVED = 5.0  # steps of the sensor that a proposed step of the set point has at least, where the range is as large
PLAN_SAMPLES = 60  # of an MPC, in lag and dead time of its plant
MPC_PERIOD = f", no longer than a {PLAN_SAMPLES}th of lag and dead time: a plan of few moves then sees all that an input does"
C_NAMES = {"LQI": "lqi", "MPC": "mpc", "Smith predictor": "smith", "cascade": "cascade", "scheduled PID": "scheduled", "LQR": "lqr"}
LEVELS = 4  # of a schedule
FIXED, HEADROOM = ("q15", "q31"), 1.2  # kinds of fixed point; a full number over the largest signal, before it is rounded
LOADS = (0.1, 0.05, 0.02)  # of the input's range


@dataclass(frozen=True, eq=False)
class Controller:
    """A tuned controller: `parameters` of it (`Gains` of a PID, `Smith`, `Servo` of an LQI, `Predictive` of an MPC), `design` with all
    that it was judged by, `proposed` what was not asked for and where it is from; `number` and `full_scale` are those of its C file.

    `typed` has all figures as attributes, `record` the same as JSON types (docs: reference/results.md); `verdict` its sentences.
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
        """Of the PID tuned on all plants; parallel form, in the study's units. Raises SimulationError for another form."""
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
        free = {name: self.drawn.values[-n:, i] for i, name in enumerate(self.drawn.names)} if len(self.drawn.values) >= n else {}
        told = verdict(self.design, {k: v for k, v in free.items() if len(v) == n}, self.how)
        if self.schedule is not None:
            told[1:1] = schedule_told(self.schedule, self.design, self.output)
        if self.drawn.open:
            more = f"{', '.join(self.drawn.open)} {'is' if len(self.drawn.open) == 1 else 'are'} not determined by the data"
            told.append(Sentence(level="warning", sentence=f"{more}: the plants spread over the whole range that the data allow."))
        if self.drawn.scatters:
            more = f"Recordings scatter in {', '.join(self.drawn.scatters)}: plants are those of another recording, within 95 % of each."
            told.append(Sentence(level="info", sentence=more))
        return told

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
        """Of the gains; those of a cascade's inner PI are `inner_Kp` and `inner_Ki`, its outer PID commands the inner output, and `K` is of
        the PIDs that stand beside it."""
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
            ScheduledLevel(level=r.level, step=r.step, share=r.scheduled, alone=r.alone.tolist(), iae=r.iae, settings=settings_of(r.gains))
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
            FrontPoint(number=k + 1, figures=dict(zip(front.names, map(float, row), strict=True)), share=float(front.shares[k]),
                       settings=settings_of(front.controllers[k]))
            for k, row in enumerate(front.figures)
        ]  # fmt: skip
        return ControllerFront(figures=list(front.names), units={n: units[n] for n in front.names}, picked=front.picked, points=points)

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
        """The controller as NAME.h and NAME.c (`control.c_export`: pid_to_c, smith_to_c, servo_to_c, servo_mpc_to_c)."""
        from plantfit.control.c_export import cascade_to_c, pid_to_c, scheduled_to_c, servo_mpc_to_c, servo_to_c, smith_to_c

        w, model, best = self.design.wishes, self.design.family.model, self.design.best
        told = {"measurement": model.outputs[self.output], "command": model.inputs[self.input]}
        first = self.verdict[0]["sentence"]
        shared: dict[str, Any] = {
            "period": w.period, "number": number or self.number,
            "name": name or c_name(self.answer.problem.name, best.form.name), "units": {k: v for k, v in told.items() if v},
            "note": f"Tuned by plantfit for {self.answer.problem.name}.\n{first}", **more,
        }  # fmt: skip
        if best.form.plan is not None:
            return servo_mpc_to_c(best.parameters, folder, inputs=len(best.form.plan.lengths), rated=best.form.plan.rated, **shared)
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
    """A controller (PID to MPC) for an answer's plant, tuned on plants that the data allow and judged on others, beside classical rules.

    The plants are others where tolerances={"tau": "10 %"} states them (evenly within value +- tolerance, all other parameters held), or
    where `draws` holds them: arrays (n,) by name of the model's parameters, 100 plants or more.

    `wishes` are the keys of the study file's [control] table (docs/tuning-controllers.md), numbers in the study's units or texts with a
    unit, such as set_point="60 degC", output="T1", controller="mpc", plants=500. They count before `control`, the table itself, by
    default that of the answer's study file; what both leave out is proposed. Raises SimulationError for a plant that cannot be tuned so,
    SpecError and UnitError for wishes.
    """
    chosen = _table(answer, control, wishes)
    if chosen.hold or chosen.controller == "lqr":
        raise SpecError("pf.hold(answer, hold=...) or `plantfit tune --hold` holds an equilibrium; tune() closes a loop of one output.")
    model = answer.problem.model
    if not isinstance(model, Model):
        raise ModelError(
            "A regression has no plant that can be simulated, so no loop can be tuned; put its values into a model with states, or design "
            "with lqr or mpc on its equations (docs/control.md)."
        )
    output, input_ = _signal("output", chosen.output, tuple(model.outputs)), _signal("input", chosen.input, tuple(model.inputs))
    recording = _recording(answer, chosen.recording)
    _check_number(chosen, output, input_)
    drawn, plants, how = _family(answer, chosen, recording, draws, seed)
    count = len(drawn.values) - 1 - TRAIN
    loop = OneLoop(model, output, input_, _others(answer, model, input_, chosen, recording), plants, _inner(chosen, model, output))
    proposed: dict[str, str] = {}
    final = _wishes(answer, loop, chosen, recording, proposed)
    train, fresh = np.arange(0, TRAIN + 1), np.r_[0, np.arange(TRAIN + 1, TRAIN + 1 + count)]
    both, schedule = (loop.part(train), loop.part(fresh)), None
    if final.controller == "scheduled":
        if chosen.front:
            raise SpecError("A front of scheduled PIDs is not searched; leave front out, or ask for another controller.")
        levels = _levels(loop, chosen, final, answer, proposed)
        design, schedule = scheduled_loops(*both, final, levels, budget=budget, seed=seed, progress=progress)
    else:
        design = tuned_loop(
            *both, final, budget=budget, seed=seed, progress=progress, front=tuple(chosen.front), points=chosen.points, pick=chosen.pick
        )
    plan = design.best.form.plan
    if plan is not None and final.prediction is None:
        proposed["prediction"] = (
            f"{plan.seconds:.4g} s: the dead time of {plan.plant.ahead * plan.plant.period:.4g} s, and then as long as the plant's lag and "
            "dead time; after it the LQ servo goes on"
        )
    judged = replace(drawn, values=drawn.values[fresh][design.rows_used])
    scale = _full_scale(answer, chosen, final, loop, proposed)
    return Controller(answer, design, judged, proposed, output, input_, how, schedule, chosen.number, scale)


def _table(answer: Answer, control: Mapping[str, Any] | None, wishes: Mapping[str, Any]) -> ControlTable:
    return wished(ControlTable, table_in(answer.spec, "control") if control is None else control, wishes, "tune")


def _signal(what: str, chosen: str | None, names: tuple[str, ...]) -> str:
    if chosen is None:
        if len(names) == 1:
            return names[0]
        raise SpecError(
            f"The model has the {what}s {', '.join(names)}, and one loop has one; name it in the study file ([control] {what} = "
            f'"{names[0]}"), or with --{what} {names[0]}.'
        )
    if chosen not in names:
        raise SpecError(f"There is no {what} {chosen!r}; the model has {', '.join(names)}.")
    return chosen


def _check_number(chosen: ControlTable, output: str, input_: str) -> None:
    """Raises SpecError for fixed point of what has none, and for full scales of other signals."""
    if chosen.number not in FIXED:
        if chosen.full_scale:
            raise SpecError(f"[control] full_scale belongs to number = 'q15' or 'q31', and the number is {chosen.number!r}.")
        return
    if chosen.controller not in ("pid", "pi"):
        raise SpecError(
            f"Fixed point is written of a PID or PI, and {chosen.controller!r} was asked for; give number = 'float' or 'double'."
        )
    unknown = [n for n in chosen.full_scale if n not in (output, input_)]
    if unknown:
        raise SpecError(f"[control] full_scale names {unknown[0]!r}; it may name {output} and {input_}.")


def _full_scale(answer: Answer, chosen: ControlTable, wishes: Wishes, loop: OneLoop, proposed: dict[str, str]) -> dict[str, float] | None:
    """Of measurement and command in fixed point: as asked for, else the next round number above what was seen and what the limits are."""
    if chosen.number not in FIXED:
        return None
    output, input_, model, found = loop.output, loop.input, loop.model, {}
    seen = [np.abs(e.recording[output]) for e in answer.problem.experiments.values() if output in e.recording.signals]
    levels = [abs(wishes.set_point), abs(wishes.set_point - wishes.step), *(float(np.nanmax(v)) for v in seen)]
    largest = {output: max(levels), input_: max(abs(wishes.lower), abs(wishes.upper))}
    for role, name, unit in (("measurement", output, model.outputs[output]), ("command", input_, model.inputs[input_])):
        given, known = chosen.full_scale.get(name), None if unit == "1" else unit
        if given is not None:
            found[role] = units.in_unit(f"[control] full_scale.{name}", given, known)
            continue
        found[role] = _next_round(HEADROOM * largest[name])
        proposed[f"full_scale.{name}"] = f"{found[role]:g}{f' {known}' if known else ''}, above all that was recorded and asked for"
    return found


def _next_round(value: float) -> float:
    """The next of 1, 2, 5 times a power of ten."""
    ten = 10.0 ** np.floor(np.log10(value)) if value > 0 else 1.0
    return float(next(m * ten for m in (1.0, 2.0, 5.0, 10.0) if m * ten >= value * (1 - 1e-12)))


def _inner(chosen: ControlTable, model: Model, output: str) -> str | None:
    """The inner output of a cascade; None for another controller."""
    for name, owner in (("levels", "scheduled"), ("inner", "cascade"), ("inner_lower", "cascade"), ("inner_upper", "cascade")):
        if getattr(chosen, name) is not None and chosen.controller != owner:
            raise SpecError(
                f"[control] {name} belongs to controller = {owner!r}, and the controller is {chosen.controller!r}; leave it out, or ask "
                f"for {owner!r}."
            )
    if chosen.controller != "cascade":
        return None
    others = [n for n in model.outputs if n != output]
    if chosen.inner is not None and chosen.inner not in others:
        raise SpecError(f"There is no inner output {chosen.inner!r}; beside {output} the model has {', '.join(others) or 'none'}.")
    if chosen.inner is None and len(others) != 1:
        what = f"the others are {', '.join(others)}; name one" if others else "the model has no other; identify one that has it"
        raise SpecError(f"A cascade measures an inner output beside {output}: {what} ([control] inner, or --inner).")
    return chosen.inner or others[0]


def _levels(loop: OneLoop, chosen: ControlTable, wishes: Wishes, answer: Answer, proposed: dict[str, str]) -> list[float]:
    """Of a schedule: as asked for, or evenly over what the recordings cover and the limits hold."""
    if chosen.controller != "scheduled":
        return []
    unit = None if loop.model.outputs[loop.output] == "1" else loop.model.outputs[loop.output]
    if isinstance(chosen.levels, list):
        return [units.in_unit("[control] levels", v, unit) for v in chosen.levels]
    count = chosen.levels or LEVELS
    low, high = levels_of([e.recording[loop.output] for e in answer.problem.experiments.values() if loop.output in e.recording.signals])
    best, middle = loop.part(slice(0, 1)), (wishes.lower, 0.5 * (wishes.lower + wishes.upper), wishes.upper)

    def held(level: float) -> bool:
        u = [float(best.at_rest(v, middle).u[0]) for v in (level, level - wishes.step)]
        return all(wishes.lower <= v - load <= wishes.upper for v, load in ((u[0], 0.0), (u[0], wishes.load), (u[1], 0.0)))

    can = [v for v in np.linspace(low, high, 41) if held(float(v))]
    if len(can) < 2:
        raise SimulationError("The limits hold the step and the load at no two levels of the recordings; give [control] levels.")
    found = [rounded(float(v), high - low) for v in np.linspace(can[0], can[-1], count)]
    proposed["levels"] = f"{', '.join(f'{v:.5g}' for v in found)} {unit or ''}: evenly over what the recordings cover and the limits hold"
    return found


def _recording(answer: Answer, chosen: str | None) -> str:
    known = list(answer.problem.experiments)
    if chosen is not None and chosen not in known:
        raise SpecError(f"There is no recording {chosen!r}; the study has {', '.join(known)}.")
    fitted = [n for n in known if answer.problem.experiments[n].fit is not None]
    return chosen or (fitted or known)[0]


def _others(answer: Answer, model: Model, input_: str, chosen: ControlTable, recording: str) -> dict[str, float]:
    """The inputs that the loop does not drive, held as asked for, else at the median of the recording."""
    unknown = [n for n in chosen.inputs if n not in model.inputs or n == input_]
    if unknown:
        raise SpecError(f"[control] inputs names {unknown[0]!r}; the other inputs are {[n for n in model.inputs if n != input_]}.")
    found = {}
    for name, unit in model.inputs.items():
        if name == input_:
            continue
        given = chosen.inputs.get(name)
        values = answer.problem.experiments[recording].recording[name]
        found[name] = float(np.nanmedian(values)) if given is None else units.in_unit(f"[control] inputs.{name}", given, unit)
    return found


def _family(
    answer: Answer, chosen: ControlTable, recording: str, draws: Mapping[str, Any] | None, seed: int
) -> tuple[Plausible, dict[str, np.ndarray], str]:  # fmt: skip
    """The best fit, `TRAIN` plants to search on, others to judge: what is drawn, parameters of the model by name, what the plants are."""
    if draws is None and not chosen.tolerances:
        drawn = plausible(answer.problem, answer.best.x, answer.findings["parameters"], (chosen.plants or 200) + TRAIN, seed, within=True)
        drawn = replace(drawn, values=drawn.values[:-1])  # the best fit is one of the plants
        return drawn, plants_of(answer, drawn, recording), ALLOWED
    if draws is not None and chosen.tolerances:
        raise SpecError("Both draws and tolerances are given; the plants can be of one of them.")
    best = np.asarray(answer.problem.space.physical(np.asarray(answer.best.x)), dtype=float)[None]
    held = {n: v[0] for n, v in plants_of(answer, Plausible((), best, (), 1.0), recording).items()}
    if draws is not None:
        plants, names, how = given_draws(held, draws, TRAIN + 20), tuple(draws), GIVEN
    else:
        unit = {p.name: p.unit for p in answer.problem.model.parameters}
        count, names, how = (chosen.plants or JUDGES) - 1, tuple(chosen.tolerances), STATED
        plants = toleranced(held, chosen.tolerances, unit, count + TRAIN, seed)
    single = [n for n in names if plants[n].ndim == 1]
    return Plausible(tuple(single), np.stack([plants[n] for n in single], axis=1), (), 1.0), plants, how


def plants_of(answer: Answer, drawn: Plausible, recording: str) -> dict[str, np.ndarray]:
    """Parameters of all plants by name of the model, held and tied ones too."""
    rows = [answer.problem.space.tree(values, recording) for values in drawn.values]
    model = answer.problem.model
    declared = {p.name: p.value for p in model.parameters}
    found = {}
    for p in model.parameters:
        found[p.name] = np.stack([np.asarray(row[p.name] if p.name in row else declared[p.name], dtype=float) for row in rows])
    return found


def _wishes(answer: Answer, loop: OneLoop, chosen: ControlTable, recording: str, proposed: dict[str, str]) -> Wishes:
    """All wishes in the study's units; `proposed` learns what was not asked for."""
    model, output, input_ = loop.model, loop.output, loop.input
    unit_y, unit_u = (None if unit == "1" else unit for unit in (model.outputs[output], model.inputs[input_]))
    used = [e.recording for e in answer.problem.experiments.values()]
    own = answer.problem.experiments[recording].recording

    def given(name: str, unit: str | None, difference: bool = False) -> float | None:
        value = getattr(chosen, name)
        return None if value is None else units.in_unit(f"[control] {name}", value, unit, difference)

    u = np.concatenate([r[input_] for r in used])
    limits = [given("lower", unit_u), given("upper", unit_u)]
    for i, (name, end) in enumerate((("lower", np.nanmin), ("upper", np.nanmax))):
        if limits[i] is None:
            limits[i] = float(end(u))
            proposed[name] = f"{limits[i]:.5g} {unit_u or ''}, the {'lowest' if i == 0 else 'highest'} {input_} of the recordings"
    lower, upper = float(limits[0]), float(limits[1])  # type: ignore[arg-type]
    if not lower < upper:
        raise SimulationError(
            f"The recordings have {input_} from {lower:g} to {upper:g} {unit_u or ''} only; give the actuator's limits "
            f"([control] lower and upper)."
        )
    y = [r[output] for r in used if output in r.signals]
    low, high = levels_of(y)
    best = loop.part(slice(0, 1))
    starts = (lower + 0.1 * (upper - lower), 0.5 * (lower + upper), upper)

    def needs(level: float) -> float:
        return float(best.at_rest(level, starts).u[0])

    quantum, noise = given("quantum", unit_y, True), given("noise", unit_y, True)
    if quantum is None:
        quantum = quantum_of(own[output])
        proposed["quantum"] = (
            f"{quantum:.4g} {unit_y or ''}, the steps of the recorded {output}" if quantum else "0: the recorded sensor shows no steps"
        )
    if noise is None:
        noise = noise_of(own[output])
        proposed["noise"] = f"{noise:.4g} {unit_y or ''} from sample to sample of the recording"
    level, step, load = given("set_point", unit_y), given("step", unit_y, True), given("load", unit_u, True)
    span = high - low
    levels = [level] if level is not None else [rounded(low + q * span, span) for q in (0.6, 0.5, 0.4, 0.7, 0.3, 0.8, 0.2, 0.9, 0.1)]
    steps = [step] if step is not None else [rounded(s * q * span, q * span) for q in SHARES for s in (1, -1)]
    loads = [load] if load is not None else [rounded(s * q * (upper - lower), q * (upper - lower)) for q in LOADS for s in (1, -1)]
    steps = [s for s in steps if abs(s) >= RESOLVED * quantum] or sorted(steps, key=lambda s: -abs(s))
    level, step, load = _first_held(levels, steps, loads, needs, lower, upper)
    for name, value, unit, told in (
        ("set_point", level, unit_y, f"where {output} was in the recordings and the limits hold it"),
        ("step", step, unit_y, "a part of what the recordings cover"), ("load", load, unit_u, "a part of the input's range"),
    ):  # fmt: skip
        if getattr(chosen, name) is None:
            proposed[name] = f"{value:.5g}{f' {unit}' if unit else ''}, {told}"
    period = given("period", "s")
    seconds, prediction = given("horizon", "s"), given("prediction", "s")
    per_second = f"({unit_u})/s" if unit_u else "1/s"
    ends: dict[str, Any] = {
        "rate": given("rate", per_second),
        "output_lower": given("output_lower", unit_y),
        "output_upper": given("output_upper", unit_y),
        "settling": given("settling", "s"),
        "travel": given("travel", unit_u, True),
        "gain_margin": chosen.gain_margin,
        "phase_margin": chosen.phase_margin,
        "minimise": chosen.minimise,
    }
    if loop.inner is not None:
        unit_v = None if model.outputs[loop.inner] == "1" else model.outputs[loop.inner]
        ends |= {"inner_lower": given("inner_lower", unit_v), "inner_upper": given("inner_upper", unit_v)}
        if loop.inner in own.signals:
            ends |= {"inner_quantum": quantum_of(own[loop.inner]), "inner_noise": noise_of(own[loop.inner])}
    if period is None:
        dt = float(np.median(np.diff(own.t)))
        rest = best.at_rest(level, starts)
        total = seconds or (course_seconds(reduced(rest, 0.5 * dt)) if np.all(np.isfinite(rest.A)) else dt)
        times = max(1, int(total / dt / MOST_SAMPLES))
        why = ""
        if chosen.controller == "mpc" and np.all(np.isfinite(rest.A)):
            times, why = max(times, int(_plan_period(rest, dt) / dt)), MPC_PERIOD
        period = dt * times
        proposed["period"] = (
            f"{period:.6g} s, {'the sampling of the recording' if times == 1 else f'one in {times} samples of the recording'}{why}"
        )
    standard = {"overshoot": 10.0, "ms": 1.6, "share": 0.95, "input_noise": 0.05, "anti_windup": "clamping", "over": "chance"}
    asked = {n: getattr(chosen, n) if getattr(chosen, n) is not None else v for n, v in standard.items()}
    proposed.update({n: f"{v}" for n, v in standard.items() if getattr(chosen, n) is None})
    return Wishes(
        level, step, load, period, lower, upper, quantum, noise, controller=chosen.controller, horizon=seconds,
        prediction=prediction, **asked, **{k: v for k, v in ends.items() if v is not None},
    )  # fmt: skip


def _plan_period(rest: Any, dt: float) -> float:
    """Seconds that leave `PLAN_SAMPLES` to lag and dead time, and four at least to the dead time."""
    late = [float(v) for v in rest.late[0] if v > 0]
    return min([slowest(reduced(rest, 0.5 * dt)) / PLAN_SAMPLES, *(0.25 * v for v in late)])


def _first_held(levels, steps, loads, needs, lower: float, upper: float) -> tuple[float, float, float]:
    """The first set point, step and load that the limits hold; the first of all where none is."""
    known: dict[float, float] = {}

    def u(level):
        if level not in known:
            known[level] = needs(level)
        return known[level]

    for step in steps:
        for level in levels:
            if not (lower <= u(level) <= upper and lower <= u(level - step) <= upper):
                continue
            for load in loads:
                if lower <= u(level) - load <= upper:
                    return level, step, load
    return levels[0], steps[0], loads[0]
