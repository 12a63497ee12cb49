"""Candidates compared on the common samples: errors, paired differences, criteria, and the sentences about them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.findings.results.models_compared import (
    ComparedModel,
    ComparisonOfModels,
    Counted,
    Errors,
    ModelPair,
    ModelSeries,
    OutputErrors,
)
from plantfit.problem.problem import Problem
from plantfit.trust.which_model.candidates import Candidate
from plantfit.trust.which_model.common_data import Series
from plantfit.trust.which_model.criteria import criteria, inflation_of
from plantfit.trust.which_model.paired_losses import paired_difference
from plantfit.trust.which_model.sentences import sentences

Part = Literal["fit", "unseen", "left out"]
FEWEST_UNSEEN = 10  # samples


@dataclass(frozen=True)
class Criteria:
    """AIC, AICc and BIC `above` the least of the models, by candidate; of `samples` that are worth so many
    `independent` ones."""

    samples: int
    independent: float
    above: dict[str, list[float]]


def enough_unseen(series: Sequence[Series]) -> bool:
    """Whether an unseen part is there that is worth a comparison."""
    return sum(int(s.unseen.sum()) for s in series) >= FEWEST_UNSEEN


def common_scales(
    problems: Sequence[Problem], series: Sequence[Series], candidates: Sequence[Candidate]
) -> tuple[dict[str, float], bool]:
    """By output what counts as 1, and whether these are given.

    1 for a single output. Of several those that every problem was given alike, else the least RMS of the residuals of
    any candidate.
    """
    outputs = list(dict.fromkeys(s.output for s in series))
    if len(outputs) == 1:
        return {outputs[0]: 1.0}, False
    given = [p.scales for p in problems if all(p.scale_sources[o].kind == "given" for o in outputs)]
    if len(given) == len(problems) and all(np.isclose(g[o], given[0][o]) for g in given for o in outputs):
        return {o: float(given[0][o]) for o in outputs}, True
    found = {}
    for o in outputs:
        rms = [
            _rms([e[s.fitted] for e, s in zip(_errors(c.simulated, series), series, strict=True) if s.output == o])
            for c in candidates
        ]
        found[o] = min((r for r in rms if np.isfinite(r) and r > 0), default=1.0)
    return found, False


def compared(
    series: Sequence[Series], candidates: Sequence[Candidate], scales: Mapping[str, float], given: bool = False
) -> ComparisonOfModels:
    """Errors of all candidates, their differences and criteria, and what they say."""
    part: Literal["unseen", "left out"] = "unseen" if enough_unseen(series) else "left out"
    losses = {c.name: _losses(c, series, scales, part) for c in candidates}
    errors = {c.name: _scaled(c, series, scales, part) for c in candidates}
    models = [c for c in candidates if c.kind == "model"]
    count = max(1, len(models) * (len(models) - 1) // 2)
    ranked = sorted(models, key=lambda c: _root(losses[c.name]))
    pairs = [_pair(a, b, errors, count) for k, a in enumerate(ranked) for b in ranked[k + 1 :]]
    pairs += [_either(ranked[0], c, losses, errors) for c in candidates if c.kind != "model"]
    made = _criteria(series, models or candidates, candidates, scales, given)
    outputs = list(dict.fromkeys(s.output for s in series))
    found = ComparisonOfModels(
        judged_by=part,
        scales=dict(scales),
        unit=series[0].unit if len(outputs) == 1 else None,
        samples=made.samples,
        independent=made.independent,
        models=[_row(c, series, outputs, scales, made.above[c.name]) for c in candidates],
        pairs=pairs,
        series=[_drawn(s, k, candidates) for k, s in enumerate(series)],
    )
    return found.having(verdict=sentences(found))


def _errors(simulated: Sequence[np.ndarray], series: Sequence[Series]) -> list[np.ndarray]:
    """Simulated minus measured (n,): NaN where nothing was measured, infinite where the simulation was not."""
    return [
        np.where(np.isfinite(s.measured) & ~np.isfinite(y), np.inf, y - s.measured)
        for y, s in zip(simulated, series, strict=True)
    ]


def _part(c: Candidate, series: Sequence[Series], part: Part) -> list[np.ndarray]:
    """Errors (n,) on a part, NaN elsewhere."""
    if part == "left out" and c.left_out is None:
        return [np.full(len(s.t), np.nan) for s in series]
    errors = _errors(c.left_out if part == "left out" and c.left_out is not None else c.simulated, series)
    return [
        np.where(s.unseen if part == "unseen" else s.fitted, e, np.nan) for e, s in zip(errors, series, strict=True)
    ]


def _losses(c: Candidate, series: Sequence[Series], scales: Mapping[str, float], part: Part) -> list[np.ndarray]:
    """By recording the mean over its outputs of (error/scale)^2 at each sample (n,), NaN where none is compared."""
    found = []
    for own in _scaled(c, series, scales, part):
        known = ~np.isnan(own)
        total = np.sum(np.where(known, own**2, 0.0), axis=0)
        found.append(np.divide(total, known.sum(axis=0), out=np.full(own.shape[1], np.nan), where=known.any(axis=0)))
    return found


def _scaled(c: Candidate, series: Sequence[Series], scales: Mapping[str, float], part: Part) -> list[np.ndarray]:
    """By recording the errors over their scales (outputs, n), NaN where none is compared."""
    errors = _part(c, series, part)
    return [
        np.array([e / scales[s.output] for e, s in zip(errors, series, strict=True) if s.recording == name])
        for name in dict.fromkeys(s.recording for s in series)
    ]


def _root(losses: Sequence[np.ndarray]) -> float:
    every = np.concatenate(losses)
    every = every[~np.isnan(every)]
    return float(np.sqrt(np.mean(every))) if len(every) else float("nan")


def _rms(errors: Sequence[np.ndarray]) -> float:
    return _root([e**2 for e in errors]) if errors else float("nan")


def _pair(a: Candidate, b: Candidate, errors: Mapping[str, Sequence[np.ndarray]], pairs: int) -> ModelPair:
    d = paired_difference(errors[a.name], errors[b.name], pairs)
    return ModelPair(
        better=a.name, worse=b.name, difference=d.value, half_width=d.half_width, p=d.p, degrees=d.degrees,
        samples=d.samples,
        correlation=d.correlation, over=d.over, told=d.told,
    )  # fmt: skip


def _either(
    a: Candidate, b: Candidate, losses: Mapping[str, Sequence[np.ndarray]], errors: Mapping[str, Sequence[np.ndarray]]
) -> ModelPair:
    a, b = sorted((a, b), key=lambda c: _root(losses[c.name]))
    return _pair(a, b, errors, 1)


def _criteria(
    series: Sequence[Series],
    models: Sequence[Candidate],
    candidates: Sequence[Candidate],
    scales: Mapping[str, float],
    given: bool,
) -> Criteria:
    """AIC, AICc and BIC by candidate, as differences to the least of the models."""
    errors = {c.name: _part(c, series, "fit") for c in candidates}
    used = [~np.isnan(e) for e in errors[candidates[0].name]]
    scaled = {
        n: [e[u] / scales[s.output] for e, u, s in zip(own, used, series, strict=True)] for n, own in errors.items()
    }
    total = {n: float(sum(np.sum(r**2) for r in own)) for n, own in scaled.items()}
    richest = min((c.name for c in models), key=lambda n: total[n])
    samples = sum(int(u.sum()) for u in used)
    factor = 1.0
    if np.isfinite(total[richest]) and total[richest] > 0:
        factor = inflation_of(scaled[richest], [np.flatnonzero(u) for u in used])
    raw = {}
    for c in candidates:
        groups = list(dict.fromkeys(s.output for s in series))
        if given:
            square = np.log(max(total[c.name] / samples, 1e-300))
        else:
            by = {g: [r for r, s in zip(scaled[c.name], series, strict=True) if s.output == g] for g in groups}
            counts = {g: sum(map(len, own)) for g, own in by.items()}
            square = (
                sum(counts[g] * np.log(max(_rms(own) ** 2, 1e-300)) for g, own in by.items() if counts[g]) / samples
            )
        raw[c.name] = criteria(float(square), samples, c.effective, factor)
    least = np.min([raw[c.name] for c in models], axis=0)
    with np.errstate(invalid="ignore"):
        above = {n: [float(v) for v in np.asarray(row) - least] for n, row in raw.items()}
    return Criteria(samples, samples / factor, above)


def _row(
    c: Candidate, series: Sequence[Series], outputs: Sequence[str], scales: Mapping[str, float], above: list[float]
) -> ComparedModel:
    parts: dict[str, Part] = {"fit": "fit", "unseen": "unseen", "left_out": "left out"}
    own = {}
    for o in outputs:
        unit = next(s.unit for s in series if s.output == o)
        errors = {
            key: [e for e, s in zip(_part(c, series, p), series, strict=True) if s.output == o]
            for key, p in parts.items()
        }
        own[o] = OutputErrors(unit=unit, **{key: _rms(e) for key, e in errors.items()})
    return ComparedModel(
        name=c.name, kind=c.kind, sentence=c.sentence, free=c.free, effective=c.effective,
        determined=None if c.determined is None else Counted(count=c.determined[0], of=c.determined[1]),
        rmse=Errors(**{key: _root(_losses(c, series, scales, p)) for key, p in parts.items()}),
        outputs=own, aic=above[0], aicc=above[1], bic=above[2],
    )  # fmt: skip


def _drawn(s: Series, k: int, candidates: Sequence[Candidate]) -> ModelSeries:
    return ModelSeries(
        recording=s.recording, output=s.output, unit=s.unit, t=s.t.tolist(), measured=s.measured.tolist(),
        part=np.where(s.fitted, "fit", np.where(s.unseen, "validation", "")).tolist(),
        simulated={c.name: np.asarray(c.simulated[k]).tolist() for c in candidates}, timed=s.timed,
    )  # fmt: skip
