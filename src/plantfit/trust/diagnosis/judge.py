"""How much an addition explains, on samples that were fitted and on those that were not, and whether chance could do
that.

The statistic is n/c ln(s0^2/s1^2), twice the gain of a normal log-likelihood where n residuals count as n/c independent
ones; c is that of the residuals which the addition leaves, more where these are larger at the samples that it moves
(`louder`). So what is left of a wrong model does not count as noise, and coloured noise that no addition explains does
not count as evidence. Compared with chi-squared of one degree of freedom, 1 % shared by all that were tried
(Bonferroni).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from plantfit.problem.measure.long_run import inflation
from plantfit.problem.measure.sample_noise import white_part
from plantfit.trust.diagnosis.catalogue import Extension
from plantfit.trust.diagnosis.plant.carrier import Carrier, Rows
from plantfit.trust.diagnosis.plant.hypothesis import Fitted, columns, fitted
from plantfit.trust.validate.residuals.curved import curved

CHANCE = 0.01  # that anything is named where nothing is missing
LEAST = 0.01  # of the mean square: less is not worth a change of the model
FEWEST = 10  # samples of a part that is unseen
# of samples beyond an end of a sensor: their share, and how far in the noise and in the range of what was measured
BEYOND, FAR, WIDE = 0.02, 5.0, 0.1
BLOCKS, REFITS = 5, 6  # left out in turn where no part of the data is unseen, and steps of each refit


@dataclass(frozen=True)
class Unseen:
    """Mean squares over samples that a fit had not seen, by the base and with an addition; `rows` (m,) bool,
    `blocks` where they were cut out of the fitted part."""

    base: float
    extended: float
    blocks: bool


def independent_share(residuals: np.ndarray, rows: Rows, use: np.ndarray) -> float:
    """c: how many residuals count as one, over all series together."""
    total, square = 0.0, 0.0
    for name in dict.fromkeys(rows.recording):
        for output in dict.fromkeys(rows.output):
            at = rows.part(name, output)
            at = at[use[at]]
            if len(at):
                own = float(np.sum(residuals[at] ** 2))
                total, square = total + own * inflation(residuals[at], rows.sample[at]), square + own
    return total / square if square > 0 else 1.0


def evidence(base: Fitted, extended: Fitted, rows: Rows, use: np.ndarray) -> float:
    """Twice the gain of log-likelihood, by independent residuals."""
    before, after = base.cost(use), extended.cost(use)
    if after <= 0:
        return np.inf if before > 0 else 0.0
    share = independent_share(extended.residuals, rows, use) * louder(base, extended, use)
    count = float(np.sum(use))
    if rows.fitted:  # of few rows nearly the statistic of F (Bartlett, Proc. R. Soc. A 160 (1937) 268)
        count = max(count - rows.fitted - len(extended.additions) + 0.5, 0.0)
    return count / share * np.log(before / after)


def louder(base: Fitted, extended: Fitted, use: np.ndarray) -> float:
    """How many times as large the mean square that is left is where an addition moves the outputs, at least 1.

    Noise that grows with the output has samples that fit what acts there by chance (the ratio of the sandwich to the
    plain variance of White, Econometrica 48 (1980) 817).
    """
    moved, left = (base.residuals - extended.residuals)[use] ** 2, extended.residuals[use] ** 2
    return max(1.0, float(moved @ left) / max(float(np.sum(moved) * np.mean(left)), 1e-300))


def times_noise(carrier: Carrier, one: Fitted, apart: np.ndarray) -> float:
    """The most times its sample-to-sample noise that any output is left with by a fit, without the rows that are
    `apart` (m,) bool."""
    return max(by_output(carrier, one, apart).values(), default=0.0)


def by_output(carrier: Carrier, one: Fitted, apart: np.ndarray) -> dict[str, float]:
    """The same by output; of several recordings the one with most."""
    rows, found = carrier.rows, {}
    for output in carrier.given.outputs:
        noise, size = [], []
        for name in dict.fromkeys(rows.recording):
            at = rows.part(name, output)
            at = at[rows.fit[at]]
            if len(at) > FEWEST:
                r = np.where(apart[at], np.nan, one.residuals[at])[:: carrier.thin]
                noise.append(_noise_of_rows(carrier, name, at, r, one) if carrier.unordered else white_part(r))
                size.append(float(np.sqrt(np.nanmean(r**2))))
        found[output] = float(np.nanmax(np.array(size) / np.maximum(noise, 1e-300))) if noise else 0.0
    return found


def _noise_of_rows(carrier: Carrier, name: str, at: np.ndarray, r: np.ndarray, one: Fitted) -> float:
    """Of residuals (n,) in no order: what a polynomial of the inputs leaves, where it explains more than chance."""
    own, rows = carrier.inputs[name], carrier.rows.sample[at]
    found = curved(r, {u: v[rows] for u, v in own.items()}, carrier.own + len(one.additions))
    return white_part(r) if found is None else min(white_part(r), found.noise)


def beyond_end(carrier: Carrier, one: Fitted, addition: Extension, use: np.ndarray) -> float:
    """The share of the samples of a sensor that lie beyond the end that an addition gives it: one that ends there
    cannot have measured them. 0 for other additions, and where these are so few or so near that noise may do it.

    The end is where what the model shows ends, for offsets may stand behind it.
    """
    if addition.kind not in ("sensor_high", "sensor_low"):
        return 0.0
    rows, sign = carrier.rows, 1.0 if addition.kind == "sensor_high" else -1.0
    beyond, samples = 0, 0
    for name in dict.fromkeys(rows.recording):
        at = rows.part(name, addition.signal)
        at = at[use[at]]
        if len(at) <= FEWEST:
            continue
        measured, left = sign * rows.measured[at], sign * one.residuals[at] / rows.weight[at]
        least = max(FAR * white_part(left), WIDE * float(np.ptp(measured)))
        beyond += int(np.sum(measured > np.max(measured + left) + least))
        samples += len(at)
    share = beyond / max(samples, 1)
    return share if share >= BEYOND else 0.0


def needed(tried: int, freedom: int = 1) -> float:
    """The evidence that chance exceeds in 1 % of the records without a fault, of so many additions of `freedom`
    parameters."""
    return float(special.chdtri(float(freedom), CHANCE / max(tried, 1)))


def validated(rows: Rows, kept: np.ndarray) -> bool:
    """Whether the study keeps a part unseen that is worth a comparison."""
    return bool(np.sum(rows.unseen & kept) >= FEWEST)


def unseen(
    carrier: Carrier, base: Fitted, extended: Fitted, use: np.ndarray, kept: np.ndarray, own: Carrier | None = None,
    held: tuple[int, ...] = (),
) -> Unseen:  # fmt: skip
    """Over the validation part, or over blocks of the fitted part left out in turn.

    `use` are the fitted rows, `kept` those that no outlier takes away; `own` is the carrier of `extended` where it is
    another one of the same rows, of which the coordinates `held` are not fitted.
    """
    later = carrier.rows.unseen & kept
    if validated(carrier.rows, kept):
        return Unseen(base.cost(later) / later.sum(), extended.cost(later) / later.sum(), False)
    sums = np.zeros(2)
    for block in blocks_of(carrier.rows, use, carrier.unordered):
        rest = use & ~block
        for k, (c, one) in enumerate(((carrier, base), (own or carrier, extended))):
            again = fitted(c, one.additions, one.x, one.theta, rest, REFITS, held=held if k else ())
            sums[k] += again.cost(block)
    return Unseen(float(sums[0] / use.sum()), float(sums[1] / use.sum()), True)


def blocks_of(rows: Rows, use: np.ndarray, unordered: bool = False) -> list[np.ndarray]:
    """Fifths of every recording's fitted samples, one after the other; of rows in no order drawn at random, for
    those of a table that is sorted by an input would be asked beyond what was fitted."""
    names = list(dict.fromkeys(rows.recording[use]))
    found, draw = [np.zeros(len(use), dtype=bool) for _ in range(BLOCKS)], np.random.default_rng(0)
    for name in names:
        samples = np.unique(rows.sample[use & (rows.recording == name)])
        if unordered:
            for block, part in zip(found, np.array_split(draw.permutation(samples), BLOCKS), strict=True):
                block |= use & (rows.recording == name) & np.isin(rows.sample, part)
            continue
        for block, part in zip(found, np.array_split(samples, BLOCKS), strict=True):
            if len(part):
                block |= use & (rows.recording == name) & (rows.sample >= part[0]) & (rows.sample <= part[-1])
    return [b for b in found if b.any() and (use & ~b).any()]


def standard_error(carrier: Carrier, one: Fitted, addition: Extension, use: np.ndarray) -> float:
    """Of the parameter of an addition, in its unit, from the linearised fit; correlation of the residuals raises it.
    Infinite where a derivative is."""
    free = columns(carrier, one.additions)
    a = one.jacobian[np.ix_(use, free)]
    if not np.all(np.isfinite(a)):  # as of a root at 0, to which an offset may take an input
        return np.inf
    norms = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    variance = one.cost(use) / max(1, int(use.sum()) - len(free)) * independent_share(one.residuals, carrier.rows, use)
    inverse = np.linalg.pinv((a / norms).T @ (a / norms), rcond=1e-12)
    errors = np.sqrt(np.maximum(np.diag(inverse), 0.0) * variance) / norms
    return float(errors[_place(carrier, one.additions, addition, free)])


def _place(carrier: Carrier, additions: Sequence[Extension], addition: Extension, free: np.ndarray) -> int:
    own = columns(carrier, [addition])
    if addition.place == "inside":
        return int(np.flatnonzero(free == own[-1])[0])
    return int(np.flatnonzero(free == len(carrier.names) + list(additions).index(addition))[0])
