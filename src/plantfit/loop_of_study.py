"""What study, answer and recordings say about a loop that is to be closed: its signals, its family of plants, its
limits and what it is to reach. What they leave out is proposed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit import units
from plantfit.answer import Answer
from plantfit.control.tune.loop_design import MOST_SAMPLES, course_seconds, reduced_for
from plantfit.control.tune.one_loop import OneLoop
from plantfit.control.tune.proposals import levels_of, noise_of, quantum_of, rounded
from plantfit.control.tune.reduction import reduced, slowest
from plantfit.control.tune.stated import JUDGES, given_draws, toleranced
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import SimulationError, SpecError
from plantfit.models.model import Model
from plantfit.recording.clean.sampling import usual_period
from plantfit.recording.record import Recording
from plantfit.spec.tables import ControlTable
from plantfit.trust.intervals.plausible import Plausible, plausible

TRAIN = 80  # plants that gains are searched on; others judge them
SHARES = (0.2, 0.35, 0.5, 0.8, 0.1, 0.05)  # of the recorded range of the output: steps that are proposed
PLACES = (0.6, 0.5, 0.4, 0.7, 0.3, 0.8, 0.2, 0.9, 0.1)  # in that range: set points
LOADS = (0.1, 0.05, 0.02)  # of the input's range
ALLOWED, STATED, GIVEN = "that the data allow", "within the stated tolerances", "of the given draws"
RESOLVED = 5.0  # steps of the sensor that a proposed step of the set point has at least, where the range is as large
PLAN_SAMPLES = 60  # of an MPC, in lag and dead time of its plant
MPC_PERIOD = (
    f", no longer than a {PLAN_SAMPLES}th of lag and dead time: a plan of few moves then sees all that an input does"
)
LEVELS = 4  # of a schedule
# kinds of fixed point; a full number over the largest signal, before it is rounded
FIXED, HEADROOM = (("q15", "q31"), 1.2)
STANDARD = {
    "overshoot": 10.0,
    "ms": 1.6,
    "share": 0.95,
    "input_noise": 0.05,
    "anti_windup": "clamping",
    "over": "chance",
}


def signal_of(what: str, chosen: str | None, names: tuple[str, ...]) -> str:
    if not names:
        raise SpecError(
            f"The model has no {what}, so that there is no loop to close; identify the plant with what drives it."
        )
    if chosen is None:
        if len(names) == 1:
            return names[0]
        raise SpecError(
            f"The model has the {what}s {', '.join(names)}, and one loop has one; name it in the study file ([control] "
            f"{what} = "
            f'"{names[0]}"), or with --{what} {names[0]}.'
        )
    if chosen not in names:
        raise SpecError(f"There is no {what} {chosen!r}; the model has {', '.join(names)}.")
    return chosen


def check_number(chosen: ControlTable, output: str, input_: str) -> None:
    """Raises SpecError for fixed point of what has none, and for full scales of other signals."""
    if chosen.number not in FIXED:
        if chosen.full_scale:
            raise SpecError(
                f"[control] full_scale belongs to number = 'q15' or 'q31', and the number is {chosen.number!r}."
            )
        return
    if chosen.controller not in ("pid", "pi"):
        raise SpecError(
            f"Fixed point is written of a PID or PI, and {chosen.controller!r} "
            "was asked for; give number = 'float' or 'double'."
        )
    unknown = [n for n in chosen.full_scale if n not in (output, input_)]
    if unknown:
        raise SpecError(f"[control] full_scale names {unknown[0]!r}; it may name {output} and {input_}.")


def full_scales(
    answer: Answer, chosen: ControlTable, wishes: Wishes, loop: OneLoop, proposed: dict[str, str]
) -> dict[str, float] | None:
    """Of measurement and command in fixed point: as asked for, else the next round number above what was seen and
    what the limits are."""
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
        proposed[f"full_scale.{name}"] = (
            f"{found[role]:g}{f' {known}' if known else ''}, above all that was recorded and asked for"
        )
    return found


def _next_round(value: float) -> float:
    """The next of 1, 2, 5 times a power of ten."""
    ten = 10.0 ** np.floor(np.log10(value)) if value > 0 else 1.0
    return float(next(m * ten for m in (1.0, 2.0, 5.0, 10.0) if m * ten >= value * (1 - 1e-12)))


def inner_output(chosen: ControlTable, model: Model, output: str) -> str | None:
    """The inner output of a cascade; None for another controller."""
    for name, owner in (
        ("levels", "scheduled"),
        ("inner", "cascade"),
        ("inner_lower", "cascade"),
        ("inner_upper", "cascade"),
    ):
        if getattr(chosen, name) is not None and chosen.controller != owner:
            raise SpecError(
                f"[control] {name} belongs to controller = {owner!r}, and the controller "
                f"is {chosen.controller!r}; leave it out, or ask for {owner!r}."
            )
    if chosen.controller != "cascade":
        return None
    others = [n for n in model.outputs if n != output]
    if chosen.inner is not None and chosen.inner not in others:
        raise SpecError(
            f"There is no inner output {chosen.inner!r}; beside {output} the model has {', '.join(others) or 'none'}."
        )
    if chosen.inner is None and len(others) != 1:
        what = (
            f"the others are {', '.join(others)}; name one"
            if others
            else "the model has no other; identify one that has it"
        )
        raise SpecError(f"A cascade measures an inner output beside {output}: {what} ([control] inner, or --inner).")
    return chosen.inner or others[0]


def levels_to_hold(
    loop: OneLoop, chosen: ControlTable, wishes: Wishes, answer: Answer, proposed: dict[str, str]
) -> list[float]:
    """Of a schedule: as asked for, or evenly over what the recordings cover and the limits hold."""
    if chosen.controller != "scheduled":
        return []
    unit = None if loop.model.outputs[loop.output] == "1" else loop.model.outputs[loop.output]
    if isinstance(chosen.levels, list):
        return [units.in_unit("[control] levels", v, unit) for v in chosen.levels]
    count = chosen.levels or LEVELS
    low, high = levels_of(
        [e.recording[loop.output] for e in answer.problem.experiments.values() if loop.output in e.recording.signals]
    )
    best, middle = loop.part(slice(0, 1)), (wishes.lower, 0.5 * (wishes.lower + wishes.upper), wishes.upper)

    def held(level: float) -> bool:
        u = [float(best.at_rest(v, middle).u[0]) for v in (level, level - wishes.step)]
        return all(
            wishes.lower <= v - load <= wishes.upper for v, load in ((u[0], 0.0), (u[0], wishes.load), (u[1], 0.0))
        )

    can = [v for v in np.linspace(low, high, 41) if held(float(v))]
    if len(can) < 2:
        raise SimulationError(
            "The limits hold the step and the load at no two levels of the recordings; give [control] levels."
        )
    found = [rounded(float(v), high - low) for v in np.linspace(can[0], can[-1], count)]
    proposed["levels"] = (
        f"{', '.join(f'{v:.5g}' for v in found)}{f' {unit}' if unit else ''}: "
        "evenly over what the recordings cover and the limits hold"
    )
    return found


def recording_of(answer: Answer, chosen: str | None) -> str:
    known = list(answer.problem.experiments)
    if chosen is not None and chosen not in known:
        raise SpecError(f"There is no recording {chosen!r}; the study has {', '.join(known)}.")
    fitted = [n for n in known if answer.problem.experiments[n].fit is not None]
    return chosen or (fitted or known)[0]


def other_inputs(recording: Recording, model: Model, input_: str, chosen: ControlTable) -> dict[str, float]:
    """The inputs that the loop does not drive, held as asked for, else at the median of the recording."""
    unknown = [n for n in chosen.inputs if n not in model.inputs or n == input_]
    if unknown:
        raise SpecError(
            f"[control] inputs names {unknown[0]!r}; the other inputs are {[n for n in model.inputs if n != input_]}."
        )
    found = {}
    for name, unit in model.inputs.items():
        if name == input_:
            continue
        given = chosen.inputs.get(name)
        if given is not None:
            found[name] = units.in_unit(f"[control] inputs.{name}", given, unit)
        elif name in recording.signals:
            found[name] = float(np.nanmedian(recording[name]))
        else:
            raise SpecError(
                f"The recording has no {name}; say where it is held ([control] inputs = {{ {name} = ... }})."
            )
    return found


def family(
    answer: Answer, chosen: ControlTable, recording: str, draws: Mapping[str, Any] | None, seed: int
) -> tuple[Plausible, dict[str, np.ndarray], str]:  # fmt: skip
    """The best fit, `TRAIN` plants to search on, others to judge: what is drawn, parameters of the model by name,
    what the plants are."""
    if draws is None and not chosen.tolerances:
        drawn = plausible(
            answer.problem,
            answer.z,
            answer.findings["parameters"],
            (chosen.plants or 200) + TRAIN,
            seed,
            within=True,
        )
        drawn = replace(drawn, values=drawn.values[:-1])  # the best fit is one of the plants
        return drawn, plants_of(answer, drawn, recording), ALLOWED
    if draws is not None and chosen.tolerances:
        raise SpecError("Both draws and tolerances are given; the plants can be of one of them.")
    best = np.asarray(answer.problem.space.physical(answer.z), dtype=float)[None]
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
        found[p.name] = np.stack(
            [np.asarray(row[p.name] if p.name in row else declared[p.name], dtype=float) for row in rows]
        )
    return found


def check_limits(input_: str, unit: str | None, lower: float, upper: float, proposed: Mapping[str, str]) -> None:
    """Raises SimulationError for limits of the input between which nothing lies; `proposed` says which of them are
    those of the recordings."""
    if lower < upper:
        return
    where, u = "[control] lower and upper, or --lower and --upper", f" {unit}" if unit else ""
    if "lower" in proposed and "upper" in proposed:
        raise SimulationError(
            f"The recordings have {input_} at {lower:g}{u} only, so that its limits are not known; give those of the "
            f"actuator ({where})."
        )
    if "lower" in proposed:
        told = f"upper = {upper:g}{u} is not above {lower:g}{u}, the lowest {input_} of the recordings; give lower too"
    elif "upper" in proposed:
        told = f"lower = {lower:g}{u} is not below {upper:g}{u}, the highest {input_} of the recordings; give upper too"
    else:
        told = f"The limits of {input_} are lower = {lower:g}{u} and upper = {upper:g}{u}; give lower below upper"
    raise SimulationError(f"{told} ({where}).")


@dataclass(frozen=True)
class _Asked:
    """The table [control] in the study's units, beside what a recording tells; `proposed` learns what was not asked
    for."""

    answer: Answer
    loop: OneLoop
    chosen: ControlTable
    own: Recording
    proposed: dict[str, str]

    @property
    def units(self) -> tuple[str | None, str | None]:
        """Of output and input, None without one."""
        model, loop = self.loop.model, self.loop
        unit_y, unit_u = (
            None if unit == "1" else unit for unit in (model.outputs[loop.output], model.inputs[loop.input])
        )
        return unit_y, unit_u

    @property
    def recordings(self) -> list[Recording]:
        return [e.recording for e in self.answer.problem.experiments.values()]

    def given(self, name: str, unit: str | None, difference: bool = False) -> float | None:
        value = getattr(self.chosen, name)
        return None if value is None else units.in_unit(f"[control] {name}", value, unit, difference)

    def limits(self) -> tuple[float, float]:
        """Of the input, as asked for, else the lowest and the highest of the recordings."""
        input_, (_, unit) = self.loop.input, self.units
        u, found = np.concatenate([r[input_] for r in self.recordings]), []
        for name, end, word in (("lower", np.nanmin, "lowest"), ("upper", np.nanmax, "highest")):
            value = self.given(name, unit)
            if value is None:
                value = float(end(u))
                self.proposed[name] = f"{value:.5g}{f' {unit}' if unit else ''}, the {word} {input_} of the recordings"
            found.append(float(value))
        lower, upper = found
        check_limits(input_, unit, lower, upper, self.proposed)
        return lower, upper

    def sensor(self) -> tuple[float, float]:
        """Steps and noise of the output, as asked for, else as recorded."""
        output, (unit, _) = self.loop.output, self.units
        quantum, noise = self.given("quantum", unit, True), self.given("noise", unit, True)
        if quantum is None:
            quantum = quantum_of(self.own[output])
            self.proposed["quantum"] = (
                f"{quantum:.4g}{f' {unit}' if unit else ''}, the steps of the recorded {output}"
                if quantum
                else "0: the recorded sensor shows no steps"
            )
        if noise is None:
            noise = noise_of(self.own[output])
            self.proposed["noise"] = f"{noise:.4g}{f' {unit}' if unit else ''} from sample to sample of the recording"
        return quantum, noise

    def course(
        self, lower: float, upper: float, quantum: float, needs: Callable[[float], float]
    ) -> tuple[float, float, float]:
        """Set point, step and load, as asked for, else the first that the limits hold by what a level `needs` of the
        input."""
        output, (unit_y, unit_u) = self.loop.output, self.units
        low, high = levels_of([r[output] for r in self.recordings if output in r.signals])
        level, step, load = (
            self.given("set_point", unit_y),
            self.given("step", unit_y, True),
            self.given("load", unit_u, True),
        )
        span, width = high - low, upper - lower
        levels = [level] if level is not None else [rounded(low + q * span, span) for q in PLACES]
        steps = [step] if step is not None else [rounded(s * q * span, q * span) for q in SHARES for s in (1, -1)]
        loads = [load] if load is not None else [rounded(s * q * width, q * width) for q in LOADS for s in (1, -1)]
        steps = [s for s in steps if abs(s) >= RESOLVED * quantum] or sorted(steps, key=lambda s: -abs(s))
        level, step, load = _first_held(levels, steps, loads, needs, lower, upper)
        for name, value, unit, told in (
            ("set_point", level, unit_y, f"where {output} was in the recordings and the limits hold it"),
            ("step", step, unit_y, "a part of what the recordings cover"),
            ("load", load, unit_u, "a part of the input's range"),
        ):  # fmt: skip
            if getattr(self.chosen, name) is None:
                self.proposed[name] = f"{value:.5g}{f' {unit}' if unit else ''}, {told}"
        return level, step, load

    def ends(self) -> dict[str, Any]:
        """What else the loop is to keep, and the inner sensor of a cascade; only what was asked for or is known."""
        loop, (unit_y, unit_u) = self.loop, self.units
        found: dict[str, Any] = {
            "rate": self.given("rate", f"({unit_u})/s" if unit_u else "1/s"),
            "output_lower": self.given("output_lower", unit_y),
            "output_upper": self.given("output_upper", unit_y),
            "settling": self.given("settling", "s"),
            "travel": self.given("travel", unit_u, True),
            "gain_margin": self.chosen.gain_margin,
            "phase_margin": self.chosen.phase_margin,
            "minimise": self.chosen.minimise,
        }
        if loop.inner is not None:
            unit_v = None if loop.model.outputs[loop.inner] == "1" else loop.model.outputs[loop.inner]
            found |= {
                "inner_lower": self.given("inner_lower", unit_v),
                "inner_upper": self.given("inner_upper", unit_v),
            }
            if loop.inner in self.own.signals:
                found |= {
                    "inner_quantum": quantum_of(self.own[loop.inner]),
                    "inner_noise": noise_of(self.own[loop.inner]),
                }
        return {k: v for k, v in found.items() if v is not None}

    def period(self, best: OneLoop, level: float, starts: tuple[float, ...]) -> float:
        """As asked for, else that of the recording or a multiple of it, fewer samples than `MOST_SAMPLES` in a
        course."""
        asked = self.given("period", "s")
        if asked is not None:
            return asked
        dt = usual_period(self.own)
        rest = best.at_rest(level, starts)
        finite = bool(np.all(np.isfinite(rest.A)))
        total = self.given("horizon", "s")
        if total is None:
            total = course_seconds(reduced_for(best, rest, self.chosen.controller, 0.5 * dt)) if finite else dt
        times, why = max(1, int(total / dt / MOST_SAMPLES)), ""
        if self.chosen.controller == "mpc" and finite:
            times, why = max(times, int(_plan_period(rest, dt) / dt)), MPC_PERIOD
        sampling = "the sampling of the recording" if times == 1 else f"one in {times} samples of the recording"
        self.proposed["period"] = f"{dt * times:.6g} s, {sampling}{why}"
        return dt * times


def wishes_of(answer: Answer, loop: OneLoop, chosen: ControlTable, recording: str, proposed: dict[str, str]) -> Wishes:
    """All wishes in the study's units; `proposed` learns what was not asked for."""
    asked = _Asked(answer, loop, chosen, answer.problem.experiments[recording].recording, proposed)
    lower, upper = asked.limits()
    best, starts = loop.part(slice(0, 1)), (lower + 0.1 * (upper - lower), 0.5 * (lower + upper), upper)
    quantum, noise = asked.sensor()
    level, step, load = asked.course(lower, upper, quantum, lambda v: float(best.at_rest(v, starts).u[0]))
    horizon, prediction, ends = asked.given("horizon", "s"), asked.given("prediction", "s"), asked.ends()
    period = asked.period(best, level, starts)
    standard: dict[str, Any] = {
        n: getattr(chosen, n) if getattr(chosen, n) is not None else v for n, v in STANDARD.items()
    }
    proposed.update({n: f"{v}" for n, v in STANDARD.items() if getattr(chosen, n) is None})
    return Wishes(
        level, step, load, period, lower, upper, quantum, noise, controller=chosen.controller, horizon=horizon,
        prediction=prediction,
        **standard, **ends,
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
