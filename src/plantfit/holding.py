"""From a finished study to a regulator that holds an equilibrium: `hold` takes plants that fall by themselves, and
regressions."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit import units
from plantfit.answer import Answer
from plantfit.control.holding.design import HoldDesign
from plantfit.control.holding.design import hold as designed
from plantfit.control.holding.one_input import driven_by
from plantfit.control.holding.point import held_point, slow_time
from plantfit.control.holding.told import curves, regulator, verdict
from plantfit.control.linear.linear_plant import linearised
from plantfit.control.tune.proposals import noise_of, quantum_of, rounded
from plantfit.errors import ModelError, SpecError
from plantfit.findings.results.held_plant import HeldPlant, HoldWishes
from plantfit.findings.verdict import Sentence
from plantfit.loop_of_study import check_limits, other_inputs, signal_of
from plantfit.models.library.pendubot import pendubot
from plantfit.models.model import Model
from plantfit.recording.clean.sampling import usual_period
from plantfit.recording.record import Recording
from plantfit.spec.reading import load
from plantfit.spec.recordings import experiment_of
from plantfit.spec.study import Study
from plantfit.spec.tables import ControlTable
from plantfit.spec.wished import table_in, wished
from plantfit.trust.intervals.plausible import plausible
from plantfit.trust.validate.doubts import doubts

if TYPE_CHECKING:
    from plantfit.control.c_export import CFiles

TRAIN, JUDGES = 40, 100  # plants that regulators are searched on, and that judge them
ALLOWED = "that the data allow"
LEAN = 0.5  # of what the best fit is caught from: the lean that is asked for
ROUNDING = 1e-9
SAMPLES = 200  # that a loop may take to return where no time of the plant is known
TIMES = 10.0  # the slowest time of the plant at the point: how long a loop may take to return
ANGLES = ("rad", "deg", "degree")
TWINS = (
    "parameters",
    "angles",
    "friction",
    "gear_ratio",
    "motors",
    "sign",
    "sign_width",
    "stribeck_velocity",
    "l1",
    "g",
)


@dataclass(frozen=True, eq=False)
class _Plants:
    """What a study knows: its model, plants (parameters (n,) by name, the first the best fit), a recording, its
    name; parameters that the data leave open, whether they determine no parameter at all, and what the verdict of the
    study says against the model."""

    model: Model
    values: Mapping[str, np.ndarray]
    recording: Recording
    name: str
    open: tuple[str, ...] = ()
    nothing: bool = False
    doubts: tuple[Sentence, ...] = ()


@dataclass(frozen=True, eq=False)
class Held:
    """A regulator with its filter: `design` with all that it was judged by, `proposed` what was not asked for.

    `typed` has all figures as attributes, `record` the same as JSON types; `parameters` is its `StateFeedback`,
    `verdict` its sentences. `open` are parameters that the data leave open, `nothing` says that they determine none,
    `doubts` what the verdict of the study says against the model.
    """

    name: str
    design: HoldDesign
    proposed: Mapping[str, str]
    open: tuple[str, ...] = ()
    nothing: bool = False
    doubts: tuple[Sentence, ...] = ()

    @property
    def parameters(self) -> Any:
        return self.design.best.design.parameters

    @property
    def verdict(self) -> list[dict[str, str]]:
        """Sentences with a level, good, info, warning or bad."""
        return [{"level": s.level, "sentence": s.sentence} for s in self._sentences]

    @cached_property
    def _sentences(self) -> list[Sentence]:
        return [*self._first, *verdict(self.design, ALLOWED)]

    @property
    def _first(self) -> list[Sentence]:
        """What the study says of the plant, on which all that follows rests."""
        return [*self.doubts, *_of_the_fit(self.open, self.nothing)]

    @property
    def record(self) -> dict[str, Any]:
        """All figures as JSON types."""
        return self.typed.plain()

    @cached_property
    def typed(self) -> HeldPlant:
        """Everything but the curves."""
        d, p = self.design, self.design.plant
        return HeldPlant(
            name=self.name, form="LQR", wishes=d.wishes, proposed=dict(self.proposed), units=dict(p.units),
            states=list(p.states),
            outputs=list(p.outputs), point=_point(d),
            unstable=sorted((float(v) for v in np.real(d.unstable)), reverse=True), plants=len(d.best.stable),
            plants_are=ALLOWED,
            promised=d.best.share(d.wishes) >= d.wishes.share, regulators=[regulator(d, r) for r in d.rows],
            verdict=self._sentences,
        )  # fmt: skip

    @property
    def curves(self) -> dict[str, Any]:
        """Responses from the lean that was asked for: bands, arrays by name."""
        return curves(self.design)

    def to_c(self, folder: str | Path, name: str | None = None, number: str = "double") -> "CFiles":
        """The regulator with its filter as NAME.h and NAME.c (`control.c_export.design_to_c`)."""
        from plantfit.control.c_export import design_to_c
        from plantfit.controllers import c_name

        chosen = name or c_name(self.name, "LQR")
        told = "\n".join(s.sentence for s in self._sentences[: len(self._first) + 1])
        note = f"Made by plantfit for {self.name}.\n{told}"
        return design_to_c(self.design.best.design, folder, name=chosen, number=number, note=note)

    def __repr__(self) -> str:
        head = f"LQR of {self.name} by {self.design.wishes.input}"
        return "\n".join([head, *(f"  {v['level']}: {v['sentence']}" for v in self.verdict)])


def _of_the_fit(open_: tuple[str, ...], nothing: bool) -> list[Sentence]:
    """What the fit says about the plant, where that is little."""
    if nothing:
        told = (
            "The data determine none of the parameters, so that the fit says nothing about the plant: the plants below "
            "are as different as the bounds of the study let them be. Measure again before you use this regulator."
        )
        return [Sentence(level="bad", sentence=told)]
    if not open_:
        return []
    told = f"{', '.join(open_)} {'is' if len(open_) == 1 else 'are'} not determined by the data"
    whole = "the plants spread over the whole range that the data allow."
    return [Sentence(level="warning", sentence=f"{told}: {whole}")]


def _point(design: HoldDesign) -> dict[str, float]:
    """States and input at rest; what is 0 but for rounding is 0."""
    p = design.plant
    values = np.concatenate([p.x0, p.u0])
    return {n: 0.0 if abs(v) < ROUNDING else float(v) for n, v in zip((*p.states, *p.inputs), values, strict=True)}


def hold(
    source: Answer | Study | str | Path,
    *,
    seed: int = 1,
    progress: Callable[[str], None] | None = None,
    control: Mapping[str, Any] | None = None,
    **wishes: Any,
) -> Held:
    """A regulator that holds an equilibrium of an answer's plant, or of a study file's whose [regression] is solved at
    once.

    `wishes` are keys of the table [control] (docs/tuning-controllers.md): hold={"theta1": "90 deg"} with states of the
    model, lower, upper, period, lean, ms, share, plants. Numbers are in the study's units. Raises SimulationError for a
    point that is no equilibrium or cannot be held, SpecError and UnitError for wishes, ModelError for a regression
    whose plant is not known.
    """
    table = control if control is not None else table_in(source.spec, "control") if isinstance(source, Answer) else None
    if not isinstance(source, Answer):
        study = source if isinstance(source, Study) else load(source)
        table = study.table.control.model_dump(exclude_unset=True) if table is None else table
        source = study
    chosen = wished(ControlTable, table or {}, wishes, "hold")
    count = TRAIN + (chosen.plants or JUDGES)
    known = _answered(source, count, seed) if isinstance(source, Answer) else _regressed(source, count, seed)
    proposed: dict[str, str] = {}
    known = _one_input(known, chosen, proposed)
    asked = _wishes(known, chosen, proposed)
    train = {n: v[: TRAIN + 1] for n, v in known.values.items()}
    family = {n: np.concatenate([v[:1], v[TRAIN + 1 :]]) for n, v in known.values.items()}
    design = designed(known.model, train, family, asked, progress)
    if chosen.lean is None:
        design, proposed["lean"] = _leaning(design, known)
    return Held(known.name, design, proposed, known.open, known.nothing, known.doubts)


def _answered(answer: Answer, count: int, seed: int) -> _Plants:
    from plantfit.loop_of_study import plants_of

    model = answer.problem.model
    if not isinstance(model, Model):
        raise ModelError(
            "The answer is of a regression, which has no plant that moves; give the study file whose table "
            "[regression] is solved."
        )
    drawn = plausible(answer.problem, answer.z, answer.findings["parameters"], count, seed, within=True)
    name = next(iter(answer.problem.experiments))
    return _Plants(
        model, plants_of(answer, drawn, name), answer.problem.experiments[name].recording, answer.problem.name,
        tuple(drawn.open), all(p["status"] not in ("determined", "fixed") for p in answer.findings["parameters"]),
        tuple(Sentence(level=s["level"], sentence=s["sentence"]) for s in doubts(answer.findings)),
    )  # fmt: skip


def _regressed(study: Study, count: int, seed: int) -> _Plants:
    """Draws of the coefficients, normal with the covariance of the instrumental variables, in the model that moves
    by them."""
    from plantfit.regression import regress

    table = study.table
    if table.regression is None:
        raise SpecError(f"{study.path.name} has no table [regression]; run it, and give its answer.")
    found = regress(study)
    model, constants = _twin(study)
    best = found.best
    rng = np.random.default_rng(seed)
    drawn = rng.multivariate_normal(best.values, best.covariance, size=count, method="eigh")
    rows = np.concatenate([best.values[None], drawn])
    values = {n: rows[:, i] for i, n in enumerate(best.names)} | {
        n: np.full(len(rows), v) for n, v in found.held.items()
    }
    for p in model.parameters:
        if p.name in constants:
            values[p.name] = np.full(len(rows), constants[p.name])
        elif p.name not in values:
            if p.value is None:
                raise ModelError(
                    f"The regression of {study.name} does not give {p.name}, "
                    f"which {model.name} needs; add it to [regression.constants]."
                )
            values[p.name] = np.full(len(rows), float(p.value))
    name, first = next(iter(table.recording.items()))  # as it was measured: the regression has its columns alone
    recording = experiment_of(name, first, study.path, {}).recording
    return _Plants(model, {p.name: values[p.name] for p in model.parameters}, recording, study.name)


def _twin(study: Study) -> tuple[Model, dict[str, float]]:
    """The model whose motion a regression explains, and values of its constants."""
    table = study.table
    assert table.regression is not None
    constants = table.regression.constants
    if table.model.kind == "pendubot_regression":
        options = {k: v for k, v in table.model.options.items() if k in TWINS}
        joints = [int(n[-1]) for n, text in table.regression.targets.items() if text.strip() not in ("0", "0.0")] or [1]
        voltage = {"kt", "ke", "Ra"} <= set(constants) and joints == [1]
        model = pendubot(**options, joints=joints, drive="voltage" if voltage else "torque")
    elif table.model.kind is None:
        from plantfit.spec.study import model_of

        own = model_of(table, study.path)
        if not isinstance(own, Model):
            raise ModelError(f"The equations of {study.path.name} have no states, so that there is nothing to hold.")
        model = own
    else:
        raise ModelError(
            f"The plant behind the regression {table.model.kind!r} is not known; `plantfit "
            "tune --hold` knows pendubot_regression, and regressions of equations."
        )
    declared = {p.name: p.unit for p in model.parameters}
    values = {
        n: units.in_unit(f"[regression.constants] {n}", v, declared[n]) for n, v in constants.items() if n in declared
    }
    return model, values


def _one_input(known: _Plants, chosen: ControlTable, proposed: dict[str, str]) -> _Plants:
    """The plants with one input, the others held; `proposed` learns where, if it was not asked for."""
    model = known.model
    input_ = signal_of("input", chosen.input, tuple(model.inputs))
    others = other_inputs(known.recording, model, input_, chosen)
    for name, value in others.items():
        if name not in chosen.inputs:
            unit = model.inputs[name]
            shown = f"{value:.5g}{f' {unit}' if unit and unit != '1' else ''}"
            proposed[f"inputs.{name}"] = f"{shown}, its median in the recording"
    return replace(known, model=driven_by(model, input_, others))


def _wishes(known: _Plants, chosen: ControlTable, proposed: dict[str, str]) -> HoldWishes:
    """All wishes in the study's units; `proposed` learns what was not asked for."""
    model, recording = known.model, known.recording
    if not chosen.hold:
        raise SpecError(
            'Nothing is to be held; give states and where, as in hold = { theta1 = "90 deg" } or --hold "theta1=90 '
            'deg".'
        )
    unknown = [n for n in chosen.hold if n not in model.states]
    if unknown:
        raise SpecError(f"[control] hold names {unknown[0]!r}; the states are {', '.join(model.states)}.")
    ((input_, unit_u),) = model.inputs.items()
    at = {n: units.in_unit(f"[control] hold.{n}", v, model.states[n]) for n, v in chosen.hold.items()}
    along = next(iter(at))
    asked = {n: getattr(chosen, n) for n in ("lower", "upper")}
    given = {n: None if v is None else units.in_unit(f"[control] {n}", v, unit_u) for n, v in asked.items()}
    seen = recording[input_] if input_ in recording.signals else None
    for name, end in (("lower", np.nanmin), ("upper", np.nanmax)):
        if given[name] is None:
            if seen is None:
                raise SpecError(
                    f"The recording has no {input_}; give the limits of the actuator ([control] lower and upper)."
                )
            given[name] = float(end(seen))
            most = "lowest" if name == "lower" else "highest"
            proposed[name] = f"{given[name]:.5g}{f' {unit_u}' if unit_u else ''}, the {most} {input_} of the recording"
    lower, upper = given["lower"], given["upper"]
    assert lower is not None
    assert upper is not None
    check_limits(input_, unit_u, lower, upper, proposed)
    period = None if chosen.period is None else units.in_unit("[control] period", chosen.period, "s")
    if period is None:
        period = usual_period(recording)
        proposed["period"] = f"{period:.6g} s, the sampling of the recording"
    spread = {n: float(np.nanstd(recording[n])) if n in recording.signals else 0.0 for n in model.outputs}
    widest = max(spread.values()) or 1.0
    sizes = {n: s if s > 1e-3 * widest else widest for n, s in spread.items()}
    told = ", ".join(f"{n} {v:.3g}{f' {u}' if (u := model.outputs[n]) and u != '1' else ''}" for n, v in sizes.items())
    proposed["sizes"] = f"{told}: how the outputs spread in the recording; deviations are weighed by them"
    measured = {n: recording[n] for n in model.outputs if n in recording.signals}
    quantum = {n: quantum_of(measured[n]) if n in measured else 0.0 for n in model.outputs}
    noise = {n: noise_of(measured[n]) if n in measured else 0.0 for n in model.outputs}
    unit_x = model.states[along]
    lean = None if chosen.lean is None else units.in_unit("[control] lean", chosen.lean, unit_x, True)
    largest = 2.0 * lean if lean is not None else _largest(unit_x, sizes.get(along, widest))
    seconds = None if chosen.horizon is None else units.in_unit("[control] horizon", chosen.horizon, "s")
    if seconds is None:
        seconds, why = _seconds(known, at, input_, (lower, upper), largest, period)
        proposed["horizon"] = f"{seconds:.3g} s, {why}"
    return HoldWishes(
        at, input_, period, float(given["lower"]), float(given["upper"]), along,  # pyrefly: ignore[bad-argument-type]
        lean if lean is not None else 0.0, largest, seconds, 0.1 * largest, sizes, quantum, noise,
        ms=chosen.ms or 2.0, share=chosen.share or 0.95,
    )  # fmt: skip


def _largest(unit: str | None, size: float) -> float:
    """The farthest start that is tried: half a radian of an angle, else twice the spread of the recording."""
    return units.in_unit("largest", "0.5 rad", unit, True) if unit in ANGLES else 2.0 * size


def _seconds(
    known: _Plants, at: Mapping[str, float], input_: str, limits: tuple[float, float], largest: float, period: float
) -> tuple[float, str]:
    """How long a loop may take to return from `largest` away, and why; the equilibrium is that of `hold_design`."""
    best = {n: float(v[0]) for n, v in known.values.items()}
    x0, u0 = held_point(known.model, best, at, input_, *limits)
    plant, along = linearised(known.model, best, x0, u0), next(iter(at))
    room = min(u0[input_] - limits[0], limits[1] - u0[input_])  # below 0 the limits do not hold the point, said later
    slow, integrates = slow_time(plant, along, largest, room if room > 0 else 0.5 * (limits[1] - limits[0]))
    if slow is None:
        return SAMPLES * period, f"{SAMPLES:g} periods"
    unit = known.model.states[along]
    far = f"{largest:.3g}{f' {unit}' if unit and unit != '1' else ''}"
    moved = f"the time in which {input_} within its limits moves {along} by {far}"
    why = moved if integrates else "the slowest time of the plant there"
    return float(rounded(TIMES * slow, TIMES * slow)), f"{TIMES:g} times {why}"


def _leaning(design: HoldDesign, known: _Plants) -> tuple[HoldDesign, str]:
    """The lean that is asked for where none was: half of what the best fit is caught from."""
    far = float(np.min(design.best.caught[0]))
    lean = rounded(LEAN * far, far) if far > 0 else float(design.distances[0])
    unit = known.model.states[design.wishes.along]
    return replace(
        design, wishes=replace(design.wishes, lean=lean)
    ), f"{lean:.3g}{f' {unit}' if unit and unit != '1' else ''}, half of what the best fit is caught from"
