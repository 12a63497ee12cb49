"""Looks at one signal: constant, missing, wrapped, clipped, stuck, quantised, with spikes; and at an input that follows
an output."""

from collections.abc import Iterator, Sequence

import numpy as np
import scipy  # scipy.special is loaded at its first use

from plantfit.recording.clean.outliers import inline, step_without
from plantfit.recording.looks.look import MARKED, Look
from plantfit.recording.looks.no_value import no_value_look
from plantfit.recording.looks.refreshed import refreshed_look
from plantfit.recording.looks.wrapped import wrapped_look
from plantfit.recording.record import Recording

_TO_SD = 1.4826  # median absolute deviation of a normal distribution to its standard deviation
PLATEAU = 5  # samples at one end of the range, and times the runs that the signal has elsewhere
TURN = 10  # steps that a quantised signal falls on the way round, see `_turns`
APART, SLOWER = (1, 2, 3, 5, 8, 13, 21), 5.0  # samples of a move, and steps by which the next is less, see `_stops`
WHOLE = 12  # samples in front of it whose moves are whole steps
STUCK = 20  # equal samples, where the plant does not rest, see `_rests`
STRETCHES = 20  # of equal samples in one line
# of a step: noise that carries a signal across levels, so that these do not show; the part of second differences that
# is looked at for it, and the deviation of that part of a normal distribution
ACROSS, CALM, PART = 0.6, 0.9, 0.789
SPIKE = 10.0  # robust deviations
LEVELS, COARSE = 0.2, 0.01  # levels by samples below which a signal is quantised; step by range from which it is said
# of the test for feedback: samples back, chance, and share of the input's news that past outputs tell
LAGS, SURE, SHARE = (5, 1e-6, 0.05)
# samples back of the input itself, and what outputs must tell of it at least, as a share of its deviation
OWN, SMALL = (40, 0.02)
RARE = 12.0  # times the usual gap between two measured samples, from which on a gap is told
MOVED = 0.1  # of the samples that change, in a signal that stays level and jumps
# of the test for late stamps: samples back, samples ahead and of the record at most
NEAR, EARLIER, MOST = ((3, LAGS), 30, 20_000)


def signal_looks(recording: Recording, name: str, measured: bool, settles: bool = False) -> Iterator[Look]:
    """What is odd about a signal of a recording; `measured` for an output, whose values have noise and are not chosen
    by anyone; `settles` for an input of a plant that moves by itself.

    A signal with fewer than 10 finite samples is not looked at; of one that never moves nothing else is said, of an
    input nothing but that.
    """
    t, y = recording.t, recording[name]
    good = np.isfinite(y)
    missing = len(y) - int(good.sum())
    unit = f" {recording.signals[name].unit}" if recording.signals[name].unit not in (None, "", "1") else ""
    if good.sum() < 10:
        return
    values, times = y[good], t[good]
    low, high = float(values.min()), float(values.max())
    every = (float(t[0]), float(t[-1]))
    if high == low:
        # a model may know what it does all the same, by the level that it leads to
        what = (
            "and there is nothing to fit" if measured else "so that the record does not show what a change of it does"
        )
        level = "info" if settles else "warning"
        yield Look(
            "constant", level, recording.name, name, f"{name} never moves: it is {low:.4g}{unit} throughout, {what}.",
            *every,
            figures={"value": low},
        )  # fmt: skip
        return
    # of what is measured seldom, as in a laboratory, a usual gap is no loss
    usual = RARE * float(np.median(np.diff(np.flatnonzero(good)) - 1))
    if missing and measured and (longest := _longest(~good)) >= max(STUCK, usual):
        begin = _begin_of_longest(~good)
        yield Look(
            "missing", "info", recording.name, name,
            f"{name} is missing for {longest} samples from t = {t[begin]:.4g} s on.",
            float(t[begin]), float(t[begin + longest - 1]), figures={"samples": longest},
        )  # fmt: skip
    if (marker := no_value_look(recording, name)) is not None:  # and no reading, so that it tells nothing else
        yield marker
        return
    if (wrapped := wrapped_look(recording, name)) is not None:  # then its ends and leaps are those of its range
        yield wrapped
        return
    if not measured:
        return
    runs, begins = _runs(values)
    usual = float(np.quantile(runs, 0.9))
    clipped, levels = set(), np.unique(values)
    step = float(np.min(np.diff(levels)))
    for end, value in (("upper", high), ("lower", low)):
        at = (values[begins] == value) & (runs >= max(PLATEAU, PLATEAU * usual)) & (begins > 0)
        at[at] = ~_turns(values, runs[at], begins[at], step)
        if np.any(at):
            clipped.add(value)
            count, first = int(runs[at].sum()), int(begins[at][0])
            kind = "sensor_high" if end == "upper" else "sensor_low"
            yield Look(
                "clipped", "warning", recording.name, name,
                f"{count} samples of {name} lie exactly at its {end} end {value:.4g}{unit}, first for "
                f"{int(runs[at][0])} in a row at "
                f"t = {times[first]:.4g} s: the sensor may end there.",
                float(times[first]), float(times[min(begins[at][-1] + runs[at][-1], len(times)) - 1]),
                f"extensions = {{ {kind} = {{ {name} = [{value - 0.01 * (high - low):.6g}, "
                f"{value + 0.01 * (high - low):.6g}] }} }}",
                {"samples": count, "value": value}, _times(times, np.repeat(at, runs)),
            )  # fmt: skip
    stuck = [
        (n, b)
        for n, b in zip(runs, begins, strict=True)
        if n >= max(STUCK, 2 * PLATEAU * usual)
        and values[b] not in clipped
        and b > 0
        and not _rests(values, int(b), int(n), step)
    ]
    if stuck:
        longest, begin = max(stuck)
        yield Look(
            "stuck", "warning", recording.name, name,
            f"{name} shows {values[begin]:.4g}{unit} for {longest} samples in a "
            f"row from t = {times[begin]:.4g} s on: the sensor may have been stuck.",
            float(times[begin]), float(times[begin + longest - 1]),
            _without(name, times, sorted((b, n) for n, b in stuck)),
            figures={"samples": float(longest)},
        )  # fmt: skip
    if len(levels) <= LEVELS * len(values) and step > COARSE * (high - low) and _shakes(values) < ACROSS * step:
        yield Look(
            "quantised", "info", recording.name, name,
            f"{name} comes in {len(levels)} levels, {step:.4g}{unit} apart at least.", *every,
            f"{name} = quantize(..., {step:.4g})", {"step": step, "levels": len(levels)},
        )  # fmt: skip
    if (refreshed := refreshed_look(recording, name)) is not None:
        yield refreshed
    yield from _spikes(recording, name, values, times, unit)


def _turns(values: np.ndarray, runs: np.ndarray, begins: np.ndarray, step: float) -> np.ndarray:
    """Whether runs at an end of the range are no longer than where a smooth signal read in such steps turns round, or
    where it comes to rest until an input moves it away, (n,).

    A parabola that lies within one step over n samples has fallen by 8 more where as many have gone by on either side.
    So has what comes to rest, before it does.
    """
    before, after = begins - runs, begins + 2 * runs - 1
    fallen = [np.abs(values[np.clip(at, 0, len(values) - 1)] - values[begins]) for at in (before, after)]
    inside = [before >= 0, after < len(values)]
    # a signal leaves as fast as the next step of an input makes it, but comes slowly
    seen = np.where(inside[0], fallen[0], fallen[1])
    stops = np.array([_stops(values, int(b), step) for b in begins], bool)
    return (inside[0] | inside[1]) & (seen <= TURN * step) | stops


def _stops(values: np.ndarray, begin: int, step: float) -> bool:
    """Whether a signal slows down in front of a run so that it goes on by no more than it does, as what friction stops:
    past the end of a sensor it would go on as it came.

    Three moves are looked at, over as many samples each as it takes to see it slow down; of a signal without noise, as
    of an encoder, which comes in whole steps and one direction.
    """
    whole = np.diff(values[max(0, begin - WHOLE) : begin + 1]) / step
    if np.any(np.abs(whole - np.round(whole)) > 0.05):
        return False
    for apart in (k for k in APART if begin >= 3 * k):
        every, moves = (np.diff(values[begin - 3 * apart : begin + 1 : k]) for k in (1, apart))
        if not (np.all(every >= 0) or np.all(every <= 0)) or np.any(moves == 0):
            return False
        first, second, last = np.abs(moves)
        if (slower := first - second) >= SLOWER * step:
            further = second - slower * np.arange(1, np.ceil(second / slower) + 1)
            return bool(np.sum(further[further > 0]) <= last + 2 * step)
    return False


def _rests(values: np.ndarray, begin: int, count: int, step: float) -> bool:
    """Whether a plant without noise rests there: it comes in one direction and leaves in one, no faster than it goes
    on.

    A sensor that was stuck leaps to where the plant is by then. One with noise turns round from sample to sample.
    """
    end = begin + count
    before, after = np.diff(values[max(0, begin - 3) : begin + 1]), np.diff(values[end - 1 : end + 3])
    ends = end == len(values)
    if len(before) < 2 or (len(after) < 3 and not ends):
        return False
    for moves in (before, after):
        clear = moves[np.abs(moves) > 1.5 * step]
        if len(clear) and np.ptp(np.sign(clear)) > 0:
            return False
    if ends:  # it slows down before
        return bool(abs(before[-1]) <= 0.5 * abs(before[0]) + 1.5 * step)
    return bool(abs(after[0]) <= 3.0 * np.max(np.abs(after[1:])) + 1.5 * step)


def _without(name: str, times: np.ndarray, stuck: Sequence[tuple[int, int]]) -> str:
    """The cleaning step that takes stretches away but for their first sample, which may have been right; each is
    (first sample, count)."""
    stretches = [[float(f"{times[k]:.9g}") for k in (b + 1, b + n - 1)] for b, n in stuck[:STRETCHES]]
    return f"clean = [{inline({'step': 'drop_samples', 'signal': name, 'between': stretches})}]"


def _shakes(values: np.ndarray) -> float:
    """The noise of a signal from sample to sample, without the tenth of the samples where it moves most. One read in
    steps without noise gives half a step at most."""
    second = np.sort(np.abs(np.diff(values, 2)))
    calm = second[: max(1, int(CALM * len(second)))]
    return float(np.sqrt(np.mean(calm**2) / 6.0)) / PART


def _spikes(recording: Recording, name: str, values: np.ndarray, times: np.ndarray, unit: str) -> Iterator[Look]:
    away = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    width = min(51, len(away) // 2 * 2 - 1)
    padded = np.pad(np.abs(away), width // 2, mode="reflect")
    local = _TO_SD * np.median(np.lib.stride_tricks.sliding_window_view(padded, width), axis=1)
    scale = np.maximum(local, max(_TO_SD * float(np.median(np.abs(away))), 1e-3 * float(np.ptp(values))))
    # neighbours on both sides agree: no step, and no sharp corner either
    levels = np.unique(values)
    level = float(np.min(np.diff(levels))) if len(levels) > 2 else 0.0  # one step of a coarse signal is no spike
    alone = (np.abs(away) > np.maximum(SPIKE * scale, 2.0 * level)) & (
        np.abs(values[2:] - values[:-2]) < 0.5 * np.abs(away)
    )
    moves = np.abs(np.diff(np.pad(values, 1, mode="edge")))
    alone &= np.minimum(moves[1:-2], moves[2:-1]) > 2.0 * np.maximum(moves[:-3], moves[3:])
    if not np.any(alone) or np.mean(alone) > 0.1:
        return
    at = np.flatnonzero(alone) + 1
    worst = at[np.argmax(np.abs(away[at - 1]))]
    marked = np.zeros(len(values), dtype=bool)
    marked[at] = True
    told = f"1 sample of {name} stands alone" if len(at) == 1 else f"{len(at)} samples of {name} stand alone"
    yield Look(
        "spikes", "warning", recording.name, name,
        f"{told}, more than {SPIKE:g} robust deviations from both neighbours; the largest by "
        f"{abs(away[worst - 1]):.3g}{unit} at t = {times[worst]:.4g} s.",
        float(times[at[0]]), float(times[at[-1]]),
        f"clean = [{inline(step_without(name, values, times, marked)[0])}]",
        {"samples": len(at), "largest": float(abs(away[worst - 1]))}, _times(times, at),
    )  # fmt: skip


def feedback_look(recording: Recording, u: str, y: str, misread: float = 0.0) -> Look | None:
    """Whether past values of y tell of u what past values of u do not: the input was computed from the output.

    Granger, Econometrica 37 (1969) 424, by an F test of 5 lags of y; None where it is not so. The input has up to 40
    lags: sines, sweeps and filtered noise are told by their own long past, which y remembers, too (5 lags of both
    called 7 of 10 multisines computed from y). What y tells must be 2 % of the input's deviation, for the news of a
    smooth input is next to nothing. A late stamp looks the same, and where that tells the record better, the sentence
    names both. `misread` is the error (rms, in the unit of u) of single readings of u, as of a coarse converter: y is
    driven by what was there, so past values of y tell up to this much of them without any loop.
    """
    a, b = recording[u], recording[y]
    good = np.isfinite(a) & np.isfinite(b)
    if good.sum() < 20 * LAGS or not good.all() or np.ptp(a) == 0 or np.ptp(b) == 0:
        return None
    if _share_told(a, *news_told(a, b, LAGS))[0] < SHARE:
        return None
    new, told = news_told(a, b)
    share, gain = _share_told(a, new, told)
    if share < SHARE or gain <= len(new) * max(misread, SMALL * float(np.std(a))) ** 2:
        return None
    free = 2 * len(new) - len(a) - LAGS - 1
    f = share / max(1.0 - share, 1e-300) * free / LAGS
    chance = float(scipy.special.fdtrc(LAGS, free, f))
    if chance > SURE:
        return None
    told_of = f"Past values of {y} explain {100 * share:.0f} % of what is new in {u}: {u} "
    if _level(b) and not _level(a):
        told_of = (
            f"{y}, the output, stays level and jumps as an input does, and {u}, the input, moves all the time as an "
            f"output does: see whether their columns are exchanged. {told_of}"
        )
    figures: dict[str, int | float | None] = {"share": share, "chance": chance}
    if late := stamped_late(a, b):
        shift = late * float(np.median(np.diff(recording.t)))
        write = f"clock_shift = {{ {u} = [{-2 * shift:.3g}, {2 * shift:.3g}] }}"
        sentence = (
            f"{told_of}may be stamped about {shift:.3g} s late (two clocks), so that {y} answers "
            f"early, or be computed from {y} (closed loop). Try {write} under [model] first: a "
            "shift well below zero says the clocks. Otherwise see docs/closed-loop.md. A filter "
            f"before {u}, or {y} smoothed over later samples, looks the same."
        )
        figures["late"] = shift
    else:
        write = ""
        sentence = (
            f"{told_of}seems to be computed from {y} (closed loop), or {y} knows it better: {u} was "
            f"read with noise, through a filter or too seldom, or {y} was smoothed or interpolated "
            "over later samples. All of that pulls the parameters. For a loop see "
            "docs/closed-loop.md, or estimate with a Kalman filter; else take both as they were read, "
            f"smooth a noisy {u} in a cleaning step, and sample faster what moves between samples."
        )
    return Look(
        "feedback", "warning", recording.name, u, sentence, float(recording.t[0]), float(recording.t[-1]), write,
        figures, other=y
    )  # fmt: skip


def _level(values: np.ndarray) -> bool:
    """Whether a signal (n,) stays level and jumps."""
    return bool(np.count_nonzero(np.diff(values)) <= MOVED * len(values))


def stamped_late(a: np.ndarray, b: np.ndarray) -> int:
    """By how many samples an input a (n,) seems to be stamped late beside an output b (n,): 0 where a feedback tells
    both better.

    Both predict one sample ahead from a few samples of each (`NEAR`), and the likelihoods of the two signals are
    compared. Late: the input from its own past, the output from its past and the input some samples ahead. Feedback:
    each from the past of both, where the input may also follow the newest output.
    """
    first = max(0, int(np.argmax(a != a[0])) - LAGS)
    a, b = a[first : first + MOST], b[first : first + MOST]
    better, late = max(_better_late(a, b, back) for back in NEAR)
    return late if better > 0 and late > 1 else 0  # by one sample: then past outputs would tell nothing new of it


def _better_late(a: np.ndarray, b: np.ndarray, lags: int) -> tuple[float, int]:
    """By how much a late stamp tells two signals (n,) better than a feedback (logarithm of squares), and by how many
    samples it is late."""
    most = min(EARLIER, len(a) // 10)
    now = np.arange(lags, len(a) - most)
    back = now[:, None] - np.arange(1, lags + 1)

    def missed(of: np.ndarray, *by: np.ndarray) -> float:
        """Logarithm of the squares that are left of a signal, not below rounding."""
        corner = np.asarray(np.linalg.qr(np.column_stack([np.ones(len(now)), *by, of[now]]), mode="r"))
        return float(np.log(corner[-1, -1] ** 2 + 1e-16 * np.sum(of[now] ** 2) + 1e-300))

    feedback = min(missed(a, a[back], b[back]), missed(a, a[back], b[back], b[now])) + missed(b, b[back], a[back])
    ahead = [missed(b, b[back], a[back + k]) for k in range(1, most + 1)]
    late = int(np.argmin(ahead))
    return feedback - missed(a, a[back]) - ahead[late], late + 1


def news_told(a: np.ndarray, b: np.ndarray, own_lags: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Of a signal a (n,) what its own past does not tell, and what of that the past `LAGS` values of b (n,) tell, of
    the last samples.

    Its own past are `own_lags` values, of None up to `OWN`, as the record allows; both arrays are as much shorter than
    a.
    """
    own_lags = max(LAGS, min(OWN, len(a) // 15)) if own_lags is None else own_lags
    n = len(a) - own_lags
    own = np.column_stack([np.ones(n), *(a[own_lags - k : len(a) - k] for k in range(1, own_lags + 1))])
    both = np.column_stack([own, *(b[own_lags - k : len(b) - k] for k in range(1, LAGS + 1))])
    by_own, by_both = (m @ np.linalg.lstsq(m, a[own_lags:], rcond=1e-12)[0] for m in (own, both))
    return a[own_lags:] - by_own, by_both - by_own


def _share_told(a: np.ndarray, new: np.ndarray, told: np.ndarray) -> tuple[float, float]:
    """The share of what is new in a signal that is told of it, and the squares of that; nothing where nothing is new
    or all of it told."""
    before, after = float(np.sum(new**2)), float(np.sum((new - told) ** 2))
    if before <= 1e-20 * float(np.sum(a**2)) or after <= 0:
        return 0.0, 0.0
    return 1.0 - after / before, before - after


def _times(times: np.ndarray, at: np.ndarray) -> list[float]:
    """Of the samples (k,), the first MARKED of them."""
    return times[at][:MARKED].tolist()


def _runs(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lengths of runs of equal values, and where they begin."""
    begins = np.r_[0, np.flatnonzero(np.diff(values) != 0) + 1]
    return np.diff(np.r_[begins, len(values)]), begins


def _longest(there: np.ndarray) -> int:
    runs, begins = _runs(there.astype(int))
    return int(np.max(runs[there[begins]], initial=0))


def _begin_of_longest(there: np.ndarray) -> int:
    runs, begins = _runs(there.astype(int))
    own = np.where(there[begins], runs, 0)
    return int(begins[np.argmax(own)])
