"""What a comparison of models says."""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from plantfit.findings.record import Level
from plantfit.findings.results.models_compared import ComparedModel, ComparisonOfModels, ModelPair
from plantfit.findings.verdict import Sentence
from plantfit.trust.verdict.words import some
from plantfit.trust.which_model.criteria import NEAR
from plantfit.trust.which_model.paired_losses import FEWEST, equal

Part = Literal["unseen", "left_out"]
# difference of a criterion that leaves a model essentially no support (Burnham and Anderson 2002, section 2.6)
CLOSE = 0.1  # of an RMSE: two models whose difference is surely less do as well as each other
STRONG = 10.0


def sentences(found: ComparisonOfModels) -> list[Sentence]:
    """The verdict: which predicts best, what the criteria choose, what is determined, and what a linear model
    reaches."""
    models = [m for m in found.models if m.kind == "model"]
    part = _part(found)
    ranked = sorted(models, key=lambda m: _rmse(m, part))
    said = [] if len(models) < 2 else [_which(found, ranked, part), _criteria(found, ranked)]
    said += _determined(ranked)
    said += [_linear(found, ranked[0], m, part) for m in found.models if m.kind == "linear"]
    return said


def told_apart(found: ComparisonOfModels, better: str, worse: str) -> bool:
    """Whether the data tell a pair apart."""
    return any(p.told for p in found.pairs if (p.better, p.worse) == (better, worse))


def places(half: float | None, values: Sequence[float]) -> int:
    """Decimals that show a half width in two digits, else values in three; four digits of a value at most."""
    sizes = [abs(v) for v in values if np.isfinite(v) and v != 0]
    largest = max(sizes, default=1.0)
    finest = max(half / 10.0, largest * 1e-4) if half else min(sizes, default=1.0) / 100.0
    return int(np.clip(-np.floor(np.log10(finest) + 1e-9), 0, 9))


def _part(found: ComparisonOfModels) -> Part:
    return "unseen" if found.judged_by == "unseen" else "left_out"


def _known(value: float | None) -> float:
    return float("inf") if value is None else value


def _rmse(model: ComparedModel, part: Part) -> float:
    """Of the part that models are judged by; infinite where it is not known, as where the model cannot be simulated."""
    return _known(model.rmse.unseen if part == "unseen" else model.rmse.left_out)


def _unit(found: ComparisonOfModels) -> str:
    unit = found.unit
    return f" {unit}" if unit not in (None, "", "1", "dimensionless") else ""


def _where(found: ComparisonOfModels) -> str:
    return "unseen data" if found.judged_by == "unseen" else "blocks left out of its fit"


def _shown(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if np.isfinite(value) else "without end"


def _gap(pair: ModelPair, decimals: int) -> str:
    if pair.half_width is None:
        return f"{_known(pair.difference):.{decimals}f}, of unknown uncertainty,"
    return f"{pair.difference:.{decimals}f} ± {pair.half_width:.{decimals}f}"


def _by(pair: ModelPair, decimals: int) -> str:
    if pair.difference is None:
        return "which cannot be simulated there"
    return f"by {pair.difference:.{decimals}f} ± {pair.half_width:.{decimals}f}"


def _which(found: ComparisonOfModels, ranked: Sequence[ComparedModel], part: Part) -> Sentence:
    best, rest = ranked[0], ranked[1:]
    own = {p.worse: p for p in found.pairs if p.better == best.name}
    close = [m for m in rest if not own[m.name].told]
    far = [m for m in rest if own[m.name].told]
    if close:
        return _undecided(found, [best, *close], far, own, part)
    pair = own[rest[0].name]
    decimals = places(pair.half_width, [_rmse(best, part), _rmse(rest[0], part)])
    unit = _unit(found)
    others = [f"{_shown(_rmse(m, part), decimals)}{unit} ({m.name}, {_by(own[m.name], decimals)})" for m in rest]
    if len(rest) == 1:
        tail = (
            f"instead of {_shown(_rmse(rest[0], part), decimals)}{unit} by {rest[0].name}, {_by(pair, decimals)} (95 %)"
        )
        text = f"{best.name} predicts {_where(found)} better: RMSE {_shown(_rmse(best, part), decimals)} {tail}."
    else:
        tail = f"instead of {some(others, len(others))} (95 %, all pairs together)"
        text = f"{best.name} predicts {_where(found)} best: RMSE {_shown(_rmse(best, part), decimals)}{unit} {tail}."
    if any(own[m.name].over == "noise" for m in rest):
        text += (
            " The difference changes too slowly for a figure over other stretches of such data; ± is over the "
            "noise of these samples."
        )
    return _said("good", text, best=_rmse(best, part), difference=pair.difference, half_width=pair.half_width)


def _undecided(
    found: ComparisonOfModels,
    group: Sequence[ComparedModel],
    far: Sequence[ComparedModel],
    own: Mapping[str, ModelPair],
    part: Part,
) -> Sentence:
    names, unit = [m.name for m in group], _unit(found)
    pair = own[group[1].name]
    values = [_rmse(m, part) for m in group]
    where = "unseen data" if part == "unseen" else "blocks left out of the fits"
    half = pair.half_width
    if all(equal(values[0], v) for v in values):
        text = f"The data do not tell {some(names, 9)} apart: on {where} they predict alike, RMSE {values[0]:.4g}{unit}"
    elif half is None:
        few = f"{pair.samples} samples are too few for a comparison"
        if pair.correlation is not None and pair.correlation >= 1.5:
            few = (
                f"what differs has a memory of {pair.correlation:.0f} samples, so that the {pair.samples} are worth "
                f"{pair.degrees}, and {FEWEST} are the fewest that a comparison can be made of"
            )
        text = (
            f"The data do not tell {some(names, 9)} apart: RMSE on {where} "
            f"{some([f'{v:.4g}' for v in values], 9)}{unit}, but {few}; keep a longer part unseen"
        )
    else:
        decimals = places(half, values)
        each = some([_shown(v, decimals) for v in values], 9)
        gaps = [_gap(own[m.name], decimals) for m in group[1:]]
        text = (
            f"The data do not tell {some(names, 9)} apart: RMSE on {where} {each}{unit}, "
            f"difference{'s' * (len(gaps) > 1)} {some(gaps, 9)} (95 %)"
        )
    if far:
        decimals = places(own[far[0].name].half_width, [_rmse(far[0], part)])
        worse = [f"{m.name} ({_shown(_rmse(m, part), decimals)}{unit}, {_by(own[m.name], decimals)})" for m in far]
        text += f"; worse than {names[0]}: {some(worse, 9)}"
    least = min(m.free for m in group)
    simple = [m for m in group if m.free == least]
    known = all(equal(values[0], _rmse(m, part)) or own[m.name].half_width is not None for m in group[1:])
    if len(simple) == 1 and known and _known(simple[0].bic) <= STRONG:
        more = some([str(m.free) for m in group if m is not simple[0]], 9)
        text += (
            f". Nothing asks for more than {simple[0].name} has: {least} parameter{'s' * (least > 1)} instead of {more}"
        )
    return _said("info", text + ".", difference=pair.difference, half_width=half)


def _criteria(found: ComparisonOfModels, ranked: Sequence[ComparedModel]) -> Sentence:
    """What AICc and BIC choose; models within NEAR of the least have as much support."""
    chosen = {}
    for key, word in (("aicc", "AICc"), ("bic", "BIC")):
        near = [m.name for m in ranked if _known(getattr(m, key)) <= NEAR]
        chosen[word] = near or [min(ranked, key=lambda m: _known(getattr(m, key))).name]
    worth = f"{found.samples} residuals count as {found.independent:.0f} independent ones"
    texts = {
        word: f"chooses {n[0]}" if len(n) == 1 else f"does not tell {some(n, 9)} apart" for word, n in chosen.items()
    }
    if chosen["AICc"] == chosen["BIC"]:
        both = texts["AICc"].replace("chooses", "choose").replace("does not", "do not")
        text = f"AICc and BIC {both} ({worth})."
    else:
        text = f"AICc {texts['AICc']}, BIC {texts['BIC']} ({worth})."
    return _said("info", text)


def _determined(ranked: Sequence[ComparedModel]) -> list[Sentence]:
    counted = {m.name: m.determined for m in ranked if m.determined is not None}
    loose = [f"{name} {d.count} of {d.of}" for name, d in counted.items()]
    if all(d.count == d.of for d in counted.values()):
        return [_said("good", "All parameters of all models are determined by the data.")] if counted else []
    return [
        _said(
            "warning",
            f"Parameters that the data determine: {some(loose, 9)}. "
            "A model can predict well with values that mean nothing.",
        )
    ]


def _linear(found: ComparisonOfModels, best: ComparedModel, linear: ComparedModel, part: Part) -> Sentence:
    pair = next(p for p in found.pairs if linear.name in (p.better, p.worse))
    unit, value, own = _unit(found), _rmse(linear, part), _rmse(best, part)
    what = linear.sentence or linear.name
    half = pair.half_width
    decimals = places(half, [value, own])
    if not pair.told:
        gap, alike = "of unknown uncertainty", equal(value, own)
        if half is not None and pair.difference is not None:
            gap = f"difference {pair.difference:.{decimals}f} ± {half:.{decimals}f}"
            alike = alike or abs(pair.difference) + half <= CLOSE * own
        both = f"RMSE {_shown(value, decimals)} against {_shown(own, decimals)}{unit} ({gap})"
        # not told apart is no proof that they are alike
        said = f"does as well as {best.name}" if alike else f"and {best.name} cannot be told apart"
        text = f"{what} {said}: {both}."
        return _said("info", text)
    if pair.better == linear.name:
        text = (
            f"{what} predicts better than {best.name}: RMSE {_shown(value, decimals)} "
            f"instead of {_shown(own, decimals)}{unit}, {_by(pair, decimals)}. Something "
            "that a linear model has is missing in it; `plantfit diagnose` looks for what."
        )
        return _said("warning", text)
    return _said(
        "good",
        f"{what} reaches RMSE {_shown(value, decimals)}{unit}: {best.name} predicts better, {_by(pair, decimals)}.",
    )


def _said(level: Level, sentence: str, **figures: float | None) -> Sentence:
    known = {k: float(v) for k, v in figures.items() if v is not None and np.isfinite(v)}
    return Sentence(level=level, sentence=sentence, figures=dict[str, float | None](known))
