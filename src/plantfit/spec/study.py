"""A study file as a problem and a plan."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError, SpecError
from plantfit.models import equations
from plantfit.models.extensions import brought, with_extensions
from plantfit.models.extensions.terms import with_terms
from plantfit.models.library import catalogue as library
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Model
from plantfit.models.parts.clock_shift import shift_name
from plantfit.optimize.registry import make
from plantfit.problem import Experiment, Problem
from plantfit.problem.problem import StudyFile
from plantfit.space import Parameter
from plantfit.spec.error_place import errors_at
from plantfit.spec.instruments import differentiated, missing_instruments
from plantfit.spec.limits import check_problem
from plantfit.spec.recordings import check_units_in_names, counted_signals, experiments_of
from plantfit.spec.tables import AlikeTable, ParameterTable, RecordingTable, SpecTable
from plantfit.spec.uncertainty import errors_of
from plantfit.study.plan import AFTER_SHOOTING, Plan, default_budget
from plantfit.trust.stated_errors.shared_error import SharedError

if TYPE_CHECKING:
    from plantfit.spec.regression import Prepared


@dataclass(frozen=True)
class Study:
    """A study file, ready to run; `text` is its wording, `path` beside which its recordings are looked for.

    `errors` are those of instruments, clock and held values that it states, `draws` the refits that carry them to the
    parameters (None: to first order). `regression` is what [regression] makes of model and recordings, whose problem is
    solved by `plantfit.regress`; `biased` says, as looks at data do, that a regression needs instruments and has none.
    """

    name: str
    text: str
    path: Path
    problem: Problem
    plan: Plan
    table: SpecTable
    errors: tuple[SharedError, ...] = ()
    draws: int | None = None
    regression: "Prepared | None" = None
    biased: Mapping[str, str] | None = None


def study_of(table: SpecTable, text: str, path: Path, files: Mapping[str, Path]) -> Study:
    """The study of checked tables; recordings are looked for beside `path`, or where `files` says."""
    model, tables, experiments = model_of(table, path), {}, {}
    for n, r in table.recording.items():
        own = experiments_of(n, r, path, files)
        measured = model.inputs if isinstance(model, Model) else model.signals
        check_units_in_names(n, r, next(iter(own.values())).recording, {**measured, **model.outputs}, path)
        if twice := own.keys() & experiments.keys():
            raise SpecError(
                f"{path.name}: a piece of recording.{n} is called "
                f"{min(twice)!r}, as another recording is; rename one of them."
            )
        experiments, tables = {**experiments, **own}, {**tables, **dict.fromkeys(own, r)}
    if isinstance(model, Model):
        with errors_at(path.name):
            experiments = {n: _with_counts(e, tables[n], model) for n, e in experiments.items()}
    (noisy, made), regression = differentiated(table, model), None
    if table.regression is not None:
        # filters and instruments need rooms of scipy that are slow to import
        from plantfit.spec.regression import prepared

        regression = prepared(table, model, experiments, path)
        model, experiments = regression.model, regression.experiments
    elif table.model.filter_alike is not None:
        model, experiments = _filtered_alike(model, experiments, table.model.filter_alike, path)
    with errors_at(path.name):
        problem = Problem(
            model,
            experiments,
            {n: _parameter(p) for n, p in table.parameters.items()},
            scales=table.scales if regression is None else {**regression.scales, **table.scales},
            balance=table.balance,
            hold=table.model.hold,
            clock_shift=table.model.clock_shift,
            stepper=table.simulation.stepper,
            substeps=table.simulation.substeps,
            name=table.name,
            standard_errors=table.standard_errors,
            estimator=table.estimator,
        )
        check_problem(problem, table)
    plan, errors = _plan(table, problem, path), errors_of(table, problem, path)
    solved = table.regression is not None
    problem.study_file, problem.differentiated = StudyFile(text, path, errors, table.propagation.draws, solved), noisy
    biased = missing_instruments(noisy, made)
    return Study(table.name, text, path, problem, plan, table, errors, table.propagation.draws, regression, biased)


def _plan(table: SpecTable, problem: Problem, path: Path) -> Plan:
    search = table.search
    methods, settings = tuple(search.methods), search.settings
    if search.shooting is not None and "methods" not in search.model_fields_set and "auto" not in settings:
        method, own = AFTER_SHOOTING
        methods, settings = (method,), {**settings, method: {**own, **settings.get(method, {})}}
    try:
        for method in methods:
            make(method, **settings.get(method, {}))
        return Plan(
            name=table.name,
            methods=methods,
            runs=search.runs,
            budget=search.budget if search.budget is not None else default_budget(problem.space.dimension),
            seed=search.seed,
            settings=settings,
        )
    except SearchError as error:
        raise SpecError(f"{path.name}, [search]: {error}") from None


def model_of(table: SpecTable, path: Path) -> Model | LinearModel:
    """The model of a validated study file; the errors of the models' room name file and table."""
    m = table.model
    if m.kind is None and m.equations is None:
        raise SpecError(
            f'{path.name}: [model] needs either kind = "..." (see `plantfit models`) or equations = """..."""; add one.'
        )
    if m.kind is not None and m.equations is not None:
        raise SpecError(
            f"{path.name}: [model] has kind = {m.kind!r} and also equations; it can have only one, so leave one out."
        )
    with errors_at(f"{path.name}, [model]"):
        model = library.make(m.kind, **m.options) if m.kind is not None else _from_text(table)
        if not m.extensions:
            return model
        return with_extensions(model, m.extensions) if isinstance(model, Model) else with_terms(model, m.extensions)


def _from_text(table: SpecTable) -> Model:
    m = table.model
    added = {shift_name(s) for s in m.clock_shift}
    for kind, own in m.extensions.items():
        added |= {name for s in own for name in brought(kind, s)}
    states = {
        n: ({"unit": s} if isinstance(s, str) else {"unit": s.unit, "initial": s.initial}) for n, s in m.states.items()
    }
    parameters = {
        n: {"unit": p.unit, "bounds": p.bounds, "scale": p.scale, "value": p.value, "sentence": p.sentence}
        for n, p in table.parameters.items()
        if n not in added
    }
    return equations(
        m.equations or "",
        inputs=m.inputs,
        states=states,
        outputs=m.outputs,
        parameters=parameters,
        constants=m.constants,
        tables={n: {"over": t.over, "nodes": t.nodes, "unit": t.unit} for n, t in m.tables.items()},
        name=table.name,
        check=m.check_units,
    )


def _with_counts(e: Experiment, r: RecordingTable, model: Model) -> Experiment:
    """The experiment with the inputs that its cleaning steps make of counts, beside those that the file names."""
    made = {u: size for u, size in counted_signals(r.clean).items() if u in model.inputs}
    return replace(e, counted=made | dict(e.counted)) if made else e


def _filtered_alike(model, experiments: Mapping[str, Experiment], options: AlikeTable, path: Path):
    if not isinstance(model, LinearModel):
        raise SpecError(
            f"{path.name}, [model]: filter_alike is only for "
            f"regressions, but {model.name!r} is simulated; leave it out."
        )
    from plantfit.problem.measure.filter_alike import filter_alike  # needs scipy.signal, slow to import and rarely used

    with errors_at(f"{path.name}, [model] filter_alike"):
        columns, filtered = filter_alike(
            model, {n: e.recording for n, e in experiments.items()}, **options.model_dump()
        )
    return columns, {n: replace(e, recording=filtered[n]) for n, e in experiments.items()}


def _parameter(p: ParameterTable) -> Parameter:
    return Parameter(**{name: getattr(p, name) for name in ParameterTable.model_fields})
