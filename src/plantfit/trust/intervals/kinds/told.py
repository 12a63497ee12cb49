"""Where intervals of several kinds agree, and why they may not, in sentences."""

from plantfit.findings.results.intervals_compared import ComparisonOfIntervals, IntervalsOfParameter, KindOfInterval
from plantfit.trust.verdict.words import Sentence, say, some

ALIKE = 0.35  # of half a width: how far the ends of two intervals may lie apart
WIDER = 1.25  # times
MOST_R_HAT, LEAST_EFFECTIVE = 1.01, 400.0  # (Vehtari and others, Bayesian Analysis 16 (2021) 667)
FEW_BLOCKS = 12
CONFLICT = 3.0  # standard deviations
UNEVEN = 1.25  # times the variance of errors of one size: what the profile allows for beside them
NAMES = {"verdict": "the verdict", "covariance": "the covariance", "profile": "the profile",
         "bootstrap": "the bootstrap",
         "posterior": "the posterior"}  # fmt: skip


def interval_sentences(found: ComparisonOfIntervals) -> list[Sentence]:
    """About the agreement of kinds, about draws, and about what was not made."""
    refused = [say("info", sentence) for sentence in found.refused.values()]
    return [*_agreement(found), *_draws(found), *_conflicts(found), *_blocks(found), *refused]


def apart(one: KindOfInterval, other: KindOfInterval) -> float:
    """How far the ends of two intervals lie apart at most, in mean half widths; an end that is open in both is the
    same."""
    half = 0.25 * (one.width + other.width)
    low, high = (abs(a - b) for a, b in zip(one.ends, other.ends, strict=True))
    open_low, open_high = one.open_low and other.open_low, one.open_high and other.open_high
    return max(0.0 if open_low else low, 0.0 if open_high else high) / max(half, 1e-300)


def _agreement(found: ComparisonOfIntervals) -> list[Sentence]:
    alike, worst, lines, unset = [], 0.0, [], []
    for p in found.parameters:
        drawn = [k for k in p.kinds if k.low is not None]
        if len(drawn) < 2:
            continue
        reference = next((k for k in drawn if k.kind == "profile"), drawn[0])
        if all(k.open_low and k.open_high for k in drawn):
            unset.append(p.name)
            continue
        others = [(k, apart(reference, k)) for k in drawn if k is not reference]
        far = [(k, d) for k, d in others if d > ALIKE]
        if not far:
            alike.append(p.name)
            worst = max([worst, *(d for _, d in others)])
        lines += [_disagreement(p, reference, k, found) for k, _ in far]
    if unset:
        lines.append(say("info", f"No kind of interval sets an end of {some(unset)} within the bounds of the search."))
    if not alike:
        return lines
    said = (
        f"All kinds agree on {some(alike)}: ends of their intervals "
        f"lie at most {100 * worst:.0f} % of half a width apart."
    )
    return [say("good", said), *lines]


def _disagreement(
    p: IntervalsOfParameter, one: KindOfInterval, other: KindOfInterval, found: ComparisonOfIntervals
) -> Sentence:
    width = other.width / max(one.width, 1e-300)
    unit = f" {p.unit}" if p.unit not in (None, "1") else ""
    size = f"{width:.2g} times as wide as that of" if width > WIDER or width < 1 / WIDER else "elsewhere than that of"
    said = (
        f"{p.name}: the interval of {NAMES[other.kind]} ({_ends(other)}{unit}) is {size} {NAMES[one.kind]} "
        f"({_ends(one)}{unit}): {_reason(p, one, other, width, found)}"
    )
    return say("info" if other.kind in ("covariance", "verdict") else "warning", said)


def _reason(
    p: IntervalsOfParameter, one: KindOfInterval, other: KindOfInterval, width: float, found: ComparisonOfIntervals
) -> str:
    kind = other.kind
    # what makes the verdict's interval longer is no reason for a shorter one
    longer = width > 1 if kind == "verdict" else width < 1
    if "verdict" in (kind, one.kind) and longer and p.scatters:
        return "the verdict allows for a scatter between recordings, the other kinds for the noise alone."
    if kind == "verdict" and longer and not all(p.status == "determined" for p in found.parameters):
        if any(k.open_low or k.open_high for p in found.parameters for k in p.kinds if k.kind == "verdict"):
            return (
                "the verdict lets what is not determined leave the bounds of the search, the other kinds stay within "
                "them."
            )
        return (
            "the verdict holds other answers of as little cost, and valleys that lead to them; the other kinds stay "
            "around the reported one."
        )
    if kind in ("covariance", "verdict"):
        return f"the cost is no parabola here, which the profile follows and {NAMES[kind]} does not. Take the profile."
    if kind == "bootstrap":
        if other.open_low or other.open_high:
            return "refits end on a bound of the search."
        if any(k.open_low or k.open_high for p in found.parameters for k in p.kinds if k.kind != "verdict"):
            return (
                "another parameter meets a bound of the search, at which refits stay; the wider one is the safer one."
            )
        if width > 1:
            return (
                "refits scatter more than the cost foretells: there may be a second optimum, or noise that grows "
                "with the signal."
            )
        if found.bootstrap and max(found.bootstrap.block.values(), default=1) > 1:
            return (
                "blocks of residuals hold less of their slow part than the record does; the wider one is the safer one."
            )
        if (one.inflation or 1.0) > UNEVEN:
            return (
                "refits put any residual at any sample, and the profile allows for larger ones where the value is "
                "told; the wider one is the safer one."
            )
        return "refits tell where estimates fall, the profile what values cost; the wider one is the safer one."
    posterior = found.posterior
    assert posterior is not None  # it is of the kind "posterior"
    if posterior.priors:
        return "it knows the priors too."
    if max(posterior.orders.values(), default=0) > 0:
        if width < 1:
            return (
                "it weighs samples by the correlation of their noise, which least squares do not: right if the "
                "residual is noise."
            )
        return (
            "it weighs samples by the correlation of their noise; "
            "where the two lie apart, the residual may be no noise."
        )
    if one.open_low or one.open_high or other.open_low or other.open_high:
        return "what the data leave open it averages over the bounds of the search."
    if width < 1 and (one.inflation or 1.0) > UNEVEN:
        return (
            "it takes errors as independent and of one size, and the profile allows for larger ones where the value is "
            "told; the wider one is the safer one."
        )
    return "it averages over all values of the others, the profile takes their best."


def _draws(found: ComparisonOfIntervals) -> list[Sentence]:
    p = found.posterior
    if p is None:
        return []
    worst, least = max(v or 0.0 for v in p.r_hat.values()), min(v or 0.0 for v in p.effective.values())
    said = f"{p.chains} chains of {p.draws} draws: R-hat at most {worst:.3f}, at least {least:.0f} effective draws"
    coloured = {o: n for o, n in p.orders.items() if n}
    noise = (
        f"; noise of {', '.join(f'{o} is an autoregression of order {n}' for o, n in coloured.items())}"
        if coloured
        else ""
    )
    if p.diverged:
        return [
            say("warning", f"{said}, {p.diverged} trajectories diverged{noise}. Parts of the posterior may be missing.")
        ]
    if worst > MOST_R_HAT or least < LEAST_EFFECTIVE:
        return [say("warning", f"{said}{noise}. That is too few to trust its ends; give more --draws.")]
    return [say("good", f"{said}, none diverged{noise}.")]


def _conflicts(found: ComparisonOfIntervals) -> list[Sentence]:
    """Priors that the data deny."""
    lines = []
    priors = {} if found.posterior is None else found.posterior.priors
    for p in found.parameters:
        if p.name not in priors or p.standard_error is None:
            continue
        mean, deviation = priors[p.name]
        far = abs(mean - p.value) / (deviation**2 + p.standard_error**2) ** 0.5
        if far > CONFLICT:
            said = (
                f"The prior of {p.name} and what the data say of it lie "
                f"{far:.2g} standard deviations apart: one of them is wrong."
            )
            lines.append(say("warning", said))
    return lines


def _blocks(found: ComparisonOfIntervals) -> list[Sentence]:
    b = found.bootstrap
    if b is None:
        return []
    lines = []
    few = {o: n for o, n in b.blocks.items() if n < FEW_BLOCKS and b.block[o] > 1}
    for output, n in few.items():
        lines.append(
            say("warning", f"The residuals of {output} are so slow that a record holds {n} blocks of {b.block[output]} "
                           f"samples; the "
                  "bootstrap's ends are rough.")
        )  # fmt: skip
    if b.lost:
        lines.append(say("warning", f"{b.lost} of {b.replicates} refits could not be simulated and are left out."))
    return lines


def _ends(k: KindOfInterval) -> str:
    low, high = (f"{v:.4g}" for v in k.ends)
    low, high = f"below {low}" if k.open_low else low, f"above {high}" if k.open_high else high
    return f"{low} to {high}"
