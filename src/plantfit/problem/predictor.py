"""How a model predicts the outputs of a recording: by simulation, or as a regression on measured signals."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Model
from plantfit.problem.measure.experiment import Experiment, before_in_units
from plantfit.simulate.simulator import Simulator
from plantfit.simulate.steady import rest_channels, steady_outputs, steady_states

import jax
import jax.numpy as jnp


class AtRest(NamedTuple):
    """The numbers of a steady record: per input its values (N,)."""

    value: tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Predictor:
    """`outputs(p, drive)` for named parameters and the prepared numbers of a recording; pure.

    `simulator` is None for a regression; `needs` maps the signals that a recording must have to
    their units; `rows` is the number of stored values for each sample, for the memory of a batch.
    """

    model: Model | LinearModel
    simulator: Simulator | None

    @property
    def needs(self) -> dict[str, str | None]:
        own = self.model.inputs if isinstance(self.model, Model) else self.model.signals
        return {**own, **self.model.outputs}

    @property
    def rows(self) -> int:
        return 1 if self.simulator is None else max(1, len(self.simulator.vector.states)) * self.simulator.parts

    @property
    def has_steps(self) -> bool:
        """Whether anything is integrated over time."""
        return self.simulator is not None and bool(self.simulator.vector.states)

    def stepping(self) -> Simulator:
        """The simulator. Raises SimulationError for a regression."""
        if self.simulator is None:
            raise SimulationError(
                f"Model {self.model.name!r} is a regression: it has no time steps to choose or verify."
            )
        return self.simulator

    def with_simulator(self, simulator: Simulator) -> "Predictor":
        """The same model simulated with other steps."""
        return Predictor(self.model, simulator)

    def drive(
        self,
        experiment: Experiment,
        stop: int | None = None,
        longest: Mapping[str, float] | None = None,
        mesh: np.ndarray | None = None,
    ) -> Any:
        """The numbers of the first `stop` samples of a recording; `longest` and `mesh` as in `Simulator.drive`."""
        r, cut = experiment.recording, slice(None, stop)
        if isinstance(self.model, LinearModel):
            return {o: c[cut] for o, c in self.model.blocks({n: r[n] for n in self.model.signals}).items()}
        if experiment.steady:
            return AtRest(tuple(np.asarray(r[n][cut], dtype=float) for n in self.model.inputs))
        drive = self.stepping().drive(
            r.t[cut],
            {n: r[n][cut] for n in self.model.inputs},
            before=before_in_units(r, experiment.before, self.needs),
            measured={n: r[n] for n in self.model.outputs},
            longest=longest,
            initial_time=experiment.initial_time,
            mesh=mesh,
        )
        moved = experiment.start_corrections
        first = zip(self.model.outputs, drive.first_output, strict=True)
        return drive._replace(first_output=tuple(y + moved[o] if o in moved else y for o, y in first))

    def outputs(self, p: Mapping[str, Any], drive: Any) -> dict[str, Any]:
        """Every output at every sample, name -> (n,)."""
        if isinstance(self.model, LinearModel):
            base = self.coefficients(p)
            return {o: columns @ base for o, columns in drive.items()}
        if isinstance(drive, AtRest):
            return self._at_rest(p, drive)
        return self.stepping().outputs(p, drive)

    def trajectories(self, p: Mapping[str, Any], drive: Any) -> dict[str, Any]:
        """Every signal that a table may be over, name -> (n,): outputs, channels (inputs, late copies, "t"), states."""
        simulator = self.stepping()
        vector, values = simulator.vector, simulator.positional(p)
        if isinstance(drive, AtRest):
            channels = rest_channels(vector, dict(zip(vector.model.inputs, drive.value, strict=True)))
            x = steady_states(vector, channels, values, (0.0,) * len(vector.states)) if vector.states else ()
        else:
            x, channels = simulator.trajectories(p, drive)
        x, channels = jax.tree.map(jnp.atleast_1d, (x, channels))
        y = jax.vmap(vector.output, in_axes=(0, 0, None))(x, channels, values)
        names, signals = (*vector.outputs, *vector.channels, *vector.states), (*y, *channels, *x)
        return dict(zip(names, signals, strict=True))

    def coefficients(self, p: Mapping[str, Any]) -> Any:
        """The coefficients (k,) of a regression at named parameters."""
        assert isinstance(self.model, LinearModel)
        return jnp.stack([jnp.asarray(c, dtype=float) for c in self.model.coefficient_values(p)])

    def _at_rest(self, p: Mapping[str, Any], drive: AtRest) -> dict[str, Any]:
        vector, values = self.stepping().vector, self.stepping().positional(p)
        inputs = dict(zip(vector.model.inputs, drive.value, strict=True))
        if vector.states:
            return steady_outputs(vector, values, inputs)
        return dict(zip(vector.outputs, vector.output((), rest_channels(vector, inputs), values), strict=True))


def predictor_of(model: Model | LinearModel, stepper: str, substeps: int, hold: Mapping[str, str] | None) -> Predictor:
    """The way to predict with a model; raises SimulationError for settings that do not fit."""
    if isinstance(model, LinearModel):
        return Predictor(model, None)
    return Predictor(model, Simulator.of(model, stepper=stepper, substeps=substeps, hold=hold))
