"""Which parameters the data fix only in combination."""

from dataclasses import dataclass

import numpy as np

from plantfit.trust.verdict.words import some

NAMED = 4  # names in one list of a sentence
KEPT = 12  # weights of a direction, the largest
FLAT = 0.5  # standard deviation of the logarithm along a direction: a factor of 1.6 either way


@dataclass(frozen=True)
class Direction:
    """A way to move several parameters together that the outputs hardly notice.

    `weights` are relative changes (d ln p), the largest 1; `relative_sd` is how far the data let
    the parameters move along it (standard deviation of the logarithm, limited by the box).
    """

    weights: dict[str, float]
    relative_sd: float

    @property
    def moves(self) -> str:
        """That the parameters move together, without what stays constant: where determined combinations are named
        themselves."""
        return self.sentence.split("; only what")[0].rstrip(".") + "."

    @property
    def sentence(self) -> str:
        up = [n for n, w in self.weights.items() if w > 0]
        down = [n for n, w in self.weights.items() if w < 0]
        strongest = sorted(self.weights.items(), key=lambda pair: -abs(pair[1]))[:NAMED]
        strength = ", ".join(f"{n} {100 * w:+.0f} %" for n, w in strongest)
        if len(self.weights) == 1:
            return f"The data leave {up[0] if up else down[0]} open to about {extent(self.relative_sd)}."
        if len(self.weights) > NAMED:
            return (
                f"{len(self.weights)} parameters can move together ({strength}, "
                "the others less) and the simulated outputs hardly change."
            )
        if not down:
            how = f"{some(up)} can grow together"
        else:
            how = f"{some(up)} can grow while {some(down)} shrink{'s' if len(down) == 1 else ''}"
        return (
            f"{how} ({strength}) and the simulated outputs hardly change; only what "
            f"stays constant along this line is determined, here {self.constant}."
        )

    @property
    def constant(self) -> str:
        """Combinations of two that do not change along the direction, in symbols."""
        names = sorted(self.weights, key=lambda n: -abs(self.weights[n]))
        lead = names[0]
        found = []
        for other in names[1:]:
            power = self.weights[lead] / self.weights[other]
            sign, size = ("/", power) if power > 0 else ("*", -power)
            tail = other if abs(size - 1) < 0.08 else f"{other}^{size:.2g}"
            found.append(f"{lead}{sign}{tail}")
        return ", ".join(found)


def flat_directions(
    hessian: np.ndarray, values: np.ndarray, width: np.ndarray, names: tuple[str, ...]
) -> list[Direction]:
    """Directions along which the data fix the parameters less well than by a factor.

    `hessian` (d, d): information about the values in their units (inverse covariance of white
    residuals), `values` (d,), `width` (d,) of the box. In logarithms of the values, with the box
    as prior. A value that stays open even when all others are known is a direction of its own; among
    such values every mixture would be as open. Each keeps the 12 largest weights of at least 0.1.
    """
    size = np.where(np.abs(values) > 1e-9 * width, np.abs(values), width)
    data, prior = hessian * size[:, None] * size[None, :], 12.0 * (size / width) ** 2
    told = np.diag(data) * FLAT**2 >= 1.0
    alone = 1.0 / np.sqrt(np.maximum(np.diag(data) + prior, 1e-300))
    found = [Direction({names[i]: 1.0}, float(alone[i])) for i in np.flatnonzero(~told) if alone[i] >= FLAT]
    together = np.flatnonzero(told)
    return found + _mixtures(data[np.ix_(together, together)], prior[together], tuple(names[i] for i in together))


def _mixtures(data: np.ndarray, prior: np.ndarray, names: tuple[str, ...]) -> list[Direction]:
    """Principal directions of values that each would be known if the others were; the box as long as it is along
    each."""
    vectors = np.linalg.eigh(data + np.diag(prior))[1]
    found = []
    for vector in vectors.T:
        value = vector @ data @ vector + np.max(prior * vector**2)
        sd = 1.0 / np.sqrt(max(value, 1e-300))
        if sd < FLAT:
            continue
        vector = vector / vector[np.argmax(np.abs(vector))]
        heavy = {i for i in np.argsort(-np.abs(vector), kind="stable")[:KEPT] if abs(vector[i]) >= 0.1}
        keep = {n: float(w) for i, (n, w) in enumerate(zip(names, vector, strict=True)) if i in heavy}
        found.append(Direction(keep, float(sd)))
    return found


def extent(sd: float) -> str:
    """A standard deviation of a logarithm in words."""
    return f"{100 * sd:.0f} %" if sd < 1 else f"a factor of {np.exp(min(sd, 20)):.2g}"
