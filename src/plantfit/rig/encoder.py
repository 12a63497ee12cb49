"""What a microcontroller sees of an incremental encoder: pulses counted and the time between the last two."""

from typing import NamedTuple

import numpy as np


class Pulses(NamedTuple):
    """At each sample, (N,): pulses since the start, backwards ones taken off; the last full period in s, with the
    sign of the motion."""

    counts: np.ndarray
    period: np.ndarray


def capture(
    t_fine: np.ndarray,
    angle: np.ndarray,
    t: np.ndarray,
    pulses: int,
    slots: np.ndarray,
    tick: float,
    timeout: float,
    speed: np.ndarray | None = None,
) -> Pulses:
    """Pulses of a disc with `pulses` slots whose edges lie at (n + slots[n mod pulses]) / pulses of a turn.

    `angle` (M,) of the disc in rad at times `t_fine` (M,), straight between them; with `speed` (M,) in rad/s, of which
    the angle is the trapezoidal sum, a parabola, without which a period tells of the speed half a step ago. A timer of
    `tick` s (0: exact) stamps the edges; a period is that between two edges the same way round, kept until the next,
    and `timeout` once none came for so long.
    """
    place = angle * pulses / (2 * np.pi)
    first, last = int(np.floor(place.min())) - 2, int(np.ceil(place.max())) + 2
    edges = np.arange(first, last + 1)
    whole = np.floor(np.interp(place, edges + slots[np.mod(edges, pulses)], edges))
    jumps = np.diff(whole).astype(int)
    step = np.repeat(np.arange(len(jumps)), np.abs(jumps))
    nth = np.arange(len(step)) - np.repeat(np.cumsum(np.abs(jumps)) - np.abs(jumps), np.abs(jumps))
    way = np.sign(jumps)[step]
    edge = np.where(way > 0, whole[step] + 1 + nth, whole[step] - nth).astype(int)
    share = (edge + slots[np.mod(edge, pulses)] - place[step]) / (place[step + 1] - place[step])
    if speed is not None:
        share = _share_of_parabola(share, speed[step], speed[step + 1])
    stamp = t_fine[step] + share * (t_fine[step + 1] - t_fine[step])
    counts = np.concatenate([[0.0], np.cumsum(way)])[np.searchsorted(stamp, t, side="right")]
    return Pulses(counts, _periods(stamp, way, t, tick, timeout))


def _share_of_parabola(share: np.ndarray, begins: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Share of a step's time after which `share` of its way is done, by a speed that goes straight from one value to
    another.

    A step that turns round within keeps the straight line.
    """
    mean = 0.5 * (begins + ends)
    steady = begins * ends > 0
    first, rest = (
        np.where(steady, begins / np.where(steady, mean, 1.0), 1.0),
        np.where(steady, 0.5 * (ends - begins), 0.0),
    )
    bend = rest / np.where(steady, mean, 1.0)
    return 2.0 * share / (first + np.sqrt(np.maximum(first**2 + 4.0 * bend * share, 0.0)))


def _periods(stamp: np.ndarray, way: np.ndarray, t: np.ndarray, tick: float, timeout: float) -> np.ndarray:
    seen = np.floor(stamp / tick) * tick if tick > 0 else stamp
    length = np.concatenate([[timeout], np.diff(seen)])
    turned = np.concatenate([[True], np.diff(way) != 0])
    length = np.where(turned, timeout, np.clip(length, tick if tick > 0 else 0.0, timeout)) * np.where(way == 0, 1, way)
    last = np.searchsorted(stamp, t, side="right") - 1
    late = last < 0
    if len(stamp) == 0:
        return np.full(len(t), timeout)
    late |= t - stamp[last] >= timeout
    return np.where(late, timeout, length[last])
