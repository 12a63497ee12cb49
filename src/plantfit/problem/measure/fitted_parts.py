"""What the fitted parts of all recordings hold: inputs and times, the scored samples, and what one of them counts."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import RecordingError, SpaceError
from plantfit.problem.evaluate.compress import compress
from plantfit.problem.measure.experiment import Experiment
from plantfit.problem.measure.scale_source import GIVEN, SPREAD, UNIT, ScaleSource
from plantfit.problem.predictor import Predictor


def _held(name: str, experiment: Experiment) -> str:
    """How long a recording lasts and how much of it is fitted."""
    t, count = experiment.recording.t, int(np.sum(experiment.mask("fit")))
    return (
        f"recording {name!r} lasts from {t[0]:g} to {t[-1]:g} s, "
        f"and {count} of its {len(t)} samples are in the fitted part"
    )


@dataclass(frozen=True, eq=False)
class FittedParts:
    """`whole` recordings and the `drives` of their fitted parts as the predictor takes them, by recording; places
    (k,) of the scored samples (`index`) and their `measured` values (k,), by recording and output."""

    outputs: tuple[str, ...]
    whole: dict[str, Any]
    drives: dict[str, Any]
    index: dict[tuple[str, str], np.ndarray]
    measured: dict[tuple[str, str], np.ndarray]

    @classmethod
    def of(
        cls, predictor: Predictor, experiments: Mapping[str, Experiment], outputs: tuple[str, ...],
        longest: Mapping[str, float],
        mesh: Mapping[str, np.ndarray],
    ) -> "FittedParts":  # fmt: skip
        """With so much history for the `longest` delays, and steps that also end at the times of `mesh`.

        Raises RecordingError where no sample is left, or none of an output.
        """
        whole = {n: predictor.drive(e, longest=longest, mesh=mesh.get(n)) for n, e in experiments.items()}
        drives, index, measured = {}, {}, {}
        for name, experiment in experiments.items():
            mask = experiment.mask("fit")
            if not np.any(mask):
                continue
            stop = int(np.flatnonzero(mask)[-1]) + 1
            drives[name] = predictor.drive(experiment, stop=stop, longest=longest, mesh=mesh.get(name))
            for output in outputs:
                y = experiment.recording[output]
                own = np.flatnonzero(mask & np.isfinite(y))
                index[name, output], measured[name, output] = own, y[own]
        found = cls(outputs, whole, drives, index, measured)
        if sum(found.counts.values()) == 0:
            told = "; ".join(_held(n, e) for n, e in experiments.items())
            raise RecordingError(
                f"No measured sample of {' or '.join(map(repr, outputs))} is left to fit "
                f"({told}); check the fit interval, skip, and the missing values of the outputs."
            )
        for output in outputs:
            if not any(map(len, found.of_output(output))):
                raise RecordingError(
                    f"Output {output!r} has no measured sample inside the fitted "
                    "part; widen that part, or remove the output from the model."
                )
        return found

    @cached_property
    def counts(self) -> dict[str, int]:
        """Scored samples of each recording, over its outputs."""
        return {n: sum(len(self.measured[n, o]) for o in self.outputs) for n in self.drives}

    def of_output(self, output: str) -> list[np.ndarray]:
        """Measured values (k,) of an output, recording by recording."""
        return [y for (_, o), y in self.measured.items() if o == output]

    def scales(self, given: Mapping[str, float] | None) -> tuple[dict[str, float], dict[str, ScaleSource]]:
        """By output what a residual is divided by, in its unit, and who chose it: 1 for one output, the spread for
        several, or as given.

        Raises SpaceError for outputs that there are not and for numbers that are no scales.
        """
        result, sources = {}, dict.fromkeys(self.outputs, UNIT if len(self.outputs) == 1 else SPREAD)
        for output in self.outputs:
            y = np.concatenate(self.of_output(output))
            result[output] = 1.0 if len(self.outputs) == 1 else max(float(np.std(y)), 1e-12)
        for output, scale in (given or {}).items():
            if output not in result:
                raise SpaceError(f"scales names {output!r}, which is not one of the outputs {list(self.outputs)}.")
            if not (np.isfinite(scale) and scale > 0):
                raise SpaceError(f"The scale of output {output!r} is {scale}; give a positive number in its unit.")
            result[output], sources[output] = float(scale), GIVEN
        return result, sources

    def weights(self, balance: str) -> dict[str, float] | None:
        """How often the squares of each recording count; None: once. Raises SpaceError for a balance that is not
        known."""
        if balance not in ("samples", "recordings"):
            raise SpaceError(f"balance = {balance!r} is not known; use 'samples' or 'recordings'.")
        if balance == "samples":
            return None
        share = sum(self.counts.values()) / sum(c > 0 for c in self.counts.values())
        return {n: share / max(c, 1) for n, c in self.counts.items()}

    def spread(self, scales: Mapping[str, float]) -> float:
        """Of the scaled measured outputs about the mean of each (rms)."""
        values = [np.concatenate(self.of_output(out)) / scales[out] for out in self.outputs]
        return float(np.sqrt(np.mean(np.concatenate([v - v.mean() for v in values]) ** 2)))

    def triangles(self) -> dict[str, dict[str, Any]]:
        """The rows of a regression in few, by recording and output."""
        return {
            n: {
                o: compress(np.asarray(drive[o])[self.index[n, o]], self.measured[n, o])
                for o in self.outputs
                if len(self.index[n, o])
            }
            for n, drive in self.drives.items()
        }  # fmt: skip
