"""How often does `plantfit compare` tell models apart that are equally good, and how often ones that are not?

    python -m benchmarks.equal_models [--records 1000] [--seed 0]

Errors of two models are made of one noise of standard deviation 1, white or an AR(1), and: two waves, added to one and
taken from the other ("waves"), or an AR(1) of memory 0.9 of its own to each, half as large ("own errors"). Both predict
equally well, and 5 % should be told apart. "worse": one model is off by a wave of amplitude 0.5 in addition, and should
be told apart. Beside it, blocks of five correlation times with Student's t, as plantfit had it before.
"""

import argparse
from collections.abc import Callable

import numpy as np
from scipy import special
from scipy.signal import lfilter

Pair = tuple[np.ndarray, np.ndarray]


def noise(rng: np.random.Generator, memory: float, n: int) -> np.ndarray:
    """An AR(1) (n,) of standard deviation 1."""
    return lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], rng.normal(size=n + 200))[200:]


def waves(rng: np.random.Generator, memory: float, n: int) -> Pair:
    """Two models that are wrong by as much, in opposite directions."""
    e, t = noise(rng, memory, n), np.arange(n)
    off = 0.3 * np.sin(2 * np.pi * t / 97) + 0.3 * np.sign(np.sin(2 * np.pi * t / 61))
    return e + off, e - off


def own_errors(rng: np.random.Generator, memory: float, n: int) -> Pair:
    """Two models with slow errors of their own."""
    e = noise(rng, memory, n)
    return e + 0.5 * noise(rng, 0.9, n), e + 0.5 * noise(rng, 0.9, n)


def worse(rng: np.random.Generator, memory: float, n: int) -> Pair:
    """The second is off by a wave."""
    e = noise(rng, memory, n)
    return e, e + 0.5 * np.sin(2 * np.pi * np.arange(n) / 40)


KINDS: dict[str, Callable[[np.random.Generator, float, int], Pair]] = {
    "waves": waves,
    "own errors": own_errors,
    "worse": worse,
}


def by_blocks(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether blocks of five correlation times, at most 40 and at least 5, tell the two apart."""
    from plantfit.problem.measure.long_run import inflation

    a, b = first**2, second**2
    d, n = b - a, len(a)
    memory = inflation(d - d.mean(), np.arange(n))
    count = max(1, int(n / max(5.0 * memory if memory > 1.0 else 1.0, n / 40)))
    if count < 5:
        return False
    moved = b / (2 * np.sqrt(b.mean())) - a / (2 * np.sqrt(a.mean()))
    moved -= moved.mean()
    parts = np.array_split(moved, count)
    weights = np.array([len(p) for p in parts]) / n
    error = np.sqrt(count / (count - 1) * np.sum((weights * [p.mean() for p in parts]) ** 2))
    return bool(abs(np.sqrt(b.mean()) - np.sqrt(a.mean())) > special.stdtrit(count - 1, 0.975) * error)


def apart(kind: str, memory: float, n: int, records: int, seed: int = 0) -> tuple[float, float]:
    """Shares of records in which the two are told apart, by plantfit and by blocks."""
    from plantfit.trust.which_model.paired_losses import paired_difference

    ours = theirs = 0
    for k in range(records):
        first, second = KINDS[kind](np.random.default_rng([seed, k, n, int(100 * memory)]), memory, n)
        found = paired_difference([first], [second])
        ours += bool(np.isfinite(found.half_width) and abs(found.value) > found.half_width)
        theirs += by_blocks(first, second)
    return ours / records, theirs / records


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print("| models | memory of the noise | 100 samples | 300 | 1000 |\n|---|---|---|---|---|")
    for kind in KINDS:
        for memory in (0.0, 0.7, 0.9):
            shares = [apart(kind, memory, n, given.records, given.seed) for n in (100, 300, 1000)]
            print(f"| {kind} | {memory:g} | {' | '.join(f'{a:.1%} ({b:.1%})' for a, b in shares)} |", flush=True)


if __name__ == "__main__":
    main()
