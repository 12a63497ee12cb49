"""What the columns of a file seem to be: time, index, inputs that hold and jump, outputs that lag; why, and whether
it is sure."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from plantfit.recording.readers.any_format import table
from plantfit.recording.readers.clock import guess_time
from plantfit.recording.readers.columns import Column, Table, identifier
from plantfit.recording.readers.long_tables import widened
from plantfit.recording.readers.numbers import casted, mostly_numbers

Kind = Literal["time", "index", "input", "output", "constant", "set point", "copy", "text", "empty"]
MOST = 2000  # samples that the tests look at
SURE = 1.0  # of evidence
UNMOVED = "but no column moves it, so it may be a disturbance"
STILL = 0.1  # share of its changes, below which a column counts as moved by no other
FEW = 8  # columns
SIGNED = 0.7  # of what two columns leave of an output as a sum, below which one is taken as the sign of the other
SPARSE = 0.5  # share of samples that are there, below which a column is measured: an input has to be known at all times

_PARTS = re.compile(r"[A-Za-zÄÖÜäöüßéèêàçôîùÉ]+")
_INPUT = re.compile(
    r"(?:u|in|inp|input|volt|volts|voltage|pwm|duty|heater|heating|heat|valve|pump|fan|cmd|command|control|controller|co|mv|op|actuator|act|drive|"
    r"motor|throttle|torque|tau|force|excitation|stimulus|power|q|ain|dac|ao|eingang|spannung|ventil|pumpe|heizung|heizer|heizleistung|"
    r"stellgröße|stellgrad|stellwert|leistung|lüfter|drehmoment|tension|commande|vanne|pompe|chauffage|puissance|entrée|entree)"
)
_OUTPUT = re.compile(
    r"(?:y|out|temp|temperature|yaw|gyro|speed|rpm|velocity|vel|omega|w|position|pos|angle|theta|phi|level|height|pressure|flow|pv|"
    r"response|tacho|encoder|enc|displacement|distance|dist|range|ultrasonic|sonar|lidar|tof|abstand|entfernung|acceleration|acc|concentration|ph|humidity|current|i|t|x|outlet|level|adc|"
    r"drehzahl|temperatur|geschwindigkeit|winkel|füllstand|niveau|druck|durchfluss|istwert|ist|ausgang|strom|lage|weg|"
    r"température|vitesse|mesure|sortie|pression|débit|courant|angle)"
)
# what a driver, a pilot, the road or the weather gives, also where it is measured and moves gradually
_GIVEN = re.compile(
    r"(?:steer|steering|steeringwheel|brake|braking|pedal|accelerator|rudder|aileron|grade|slope|"
    r"ambient|amb|outdoor|irradiance|lenkrad|lenkwinkel|lenkradwinkel|lenkung|bremse|bremsdruck|gaspedal|"
    r"steigung|außentemperatur|umgebung|umgebungstemperatur|volant|frein|pente|ambiante)"
)
_MEASURED = re.compile(r"(?:meas|measured|measurement|sensor|output)")  # where no other word tells
_GOAL = re.compile(r"(?:sp|set|setpoint|setpt|ref|reference|target|desired|des|soll|sollwert|consigne|goal|setvalue)")
_COUNT = re.compile(
    r"(?:index|idx|sample|samples|no|nr|num|number|row|count|counter|n|k|record|point|unnamed|scan|id|seq|messpunkt|lfd)"
)
_WAY = re.compile(r"(?:dir|direction|dirn|sign|forward|fwd|reverse|rev|backward|richtung|drehrichtung|vorzeichen|sens)")
_OUT_UNITS = {"degC", "°C", "degF", "K", "rad", "deg", "rad/s", "deg/s", "rpm", "1/min", "m", "mm", "cm", "m/s",
              "m/s^2", "bar", "Pa",
              "kPa", "l/min", "L/min", "m^3/h", "tr/min", "A", "mA"}  # fmt: skip
_IN_UNITS = {"V", "mV", "%", "N", "N*m", "Nm", "W", "kW"}


@dataclass(frozen=True)
class Role:
    """One column. `name` is fit for equations, `why` a clause for the user. `answers` are the headers of the inputs
    that an output answers to, the strongest first. `direction` is the header of the column of two levels that gives an
    input without sign its sign. Of a role that is not `sure` the user should be asked."""

    header: str
    name: str
    unit: str | None
    kind: Kind
    why: str
    sure: bool
    answers: tuple[str, ...] = ()
    direction: str = ""


@dataclass(frozen=True)
class Roles:
    """The columns of a file in its order."""

    columns: tuple[Role, ...]

    def of(self, *kinds: Kind) -> list[Role]:
        """The columns of these kinds."""
        return [c for c in self.columns if c.kind in kinds]

    @property
    def unsure(self) -> list[Role]:
        """Inputs and outputs that could be the other."""
        return [c for c in self.columns if not c.sure and c.kind in ("input", "output", "set point", "copy")]


def guess_roles(path: str | os.PathLike[str], **options: Any) -> Roles:
    """What the columns of a file seem to be; `options` as delimiter, sheet, ... Raises RecordingError for a file
    that cannot be read."""
    content = table(path, **options)
    return roles_of(content)


def roles_of(content: Table) -> Roles:
    """The roles of a table's columns.

    Evidence for an input: its name and unit, that it holds its value and jumps, and that its past tells the future of
    others while theirs does not tell its own (Granger 1969, Econometrica 37). Evidence for an output is the opposite. A
    column of which most samples are missing is an output, as of a laboratory, where others are there throughout.
    """
    content = widened(content)
    time = guess_time(content)
    found: list[Role] = []
    values: dict[str, np.ndarray] = {}
    kept: dict[str, Column] = {}
    missing: dict[str, int] = {}
    for column in content.columns:
        own = _alone(content, column, column is time)
        found.append(own[0])
        if own[1] is not None:
            values[column.header], kept[column.header] = own[1], column
            missing[column.header] = own[2]
    judged = _judged(kept, values, missing) if values else {}
    return Roles(tuple(judged.get(role.header, role) for role in found))


def _alone(content: Table, column: Column, is_time: bool) -> tuple[Role, np.ndarray | None, int]:
    """The role that a column has whatever the others are, or its values (n,) without gaps; and how many are missing."""
    base = Role(column.header, identifier(column.name), column.unit, "text", "", True)
    if is_time:
        return replace(base, kind="time"), None, 0
    if not mostly_numbers(content, column):
        return (
            (
                replace(base, why="no numbers")
                if column.cells.null_count() < len(column.cells)
                else replace(base, kind="empty")
            ),
            None,
            0,
        )
    v = casted(content, column.cells).values
    there = np.flatnonzero(np.isfinite(v))
    if v[there].min() == v[there].max():
        return replace(base, kind="constant", why=f"{v[there[0]]:g} throughout"), None, 0
    gaps = len(v) - len(there)
    v = v[np.maximum.accumulate(np.where(np.isfinite(v), np.arange(len(v)), there[0]))]
    with np.errstate(over="ignore"):
        steps = np.diff(v)
    if np.all(steps == 1) or (np.all(steps == steps[0]) and _said(column, _COUNT)):
        return replace(base, kind="index", why="it counts the rows"), None, 0
    return base, v, gaps


def _words(column: Column) -> list[str]:
    return [
        w.lower()
        for w in _PARTS.findall(re.sub(r"(?<=[a-z])(?=[A-Z])", " ", column.name.rpartition(".")[2] or column.name))
    ]


def _said(column: Column, words: re.Pattern[str]) -> bool:
    return any(words.fullmatch(word) for word in _words(column))


def _judged(
    columns: Mapping[str, Column], values: Mapping[str, np.ndarray], missing: Mapping[str, int], commanded: bool = False
) -> dict[str, Role]:
    """The roles of columns of numbers; `commanded` where set points are inputs, as of a servo."""
    heads, n = list(columns), min(map(len, values.values()))
    stride = max(1, n // MOST)
    v = np.column_stack([values[h][::stride] for h in heads])
    goals = set() if commanded else {h for h in heads if _said(columns[h], _GOAL)}
    sparse = {h for h in heads if h not in goals and missing[h] > (1 - SPARSE) * n}
    if len(sparse) == len(heads) - len(
        goals
    ):  # a long table, of which each row holds one column: then nothing is told by what is missing
        sparse = set()
    copies = _copies(
        [h for h in heads if h not in goals and h not in sparse], columns, dict(zip(heads, v.T, strict=True))
    )
    if len(heads) - len(goals) - len(copies) < 2:  # nothing but set points: then they are inputs
        goals = set()
    own = [h for h in heads if h not in goals and h not in copies and h not in sparse]
    everything, v = v / np.abs(v).max(axis=0), v[:, [heads.index(h) for h in own]]
    v = v / np.abs(v).max(axis=0)  # squares of values near the end of float64 overflow
    tells = _tells(v) if len(own) > 1 else np.zeros((len(own), len(own)))
    evidence, reasons = (
        zip(*(_evidence(columns[h], v, tells, k) for k, h in enumerate(own)), strict=True) if own else ((), ())
    )
    inputs = [k for k in range(len(own)) if evidence[k] > 0]
    if goals and not _controlled(tells, inputs, everything[:, [heads.index(h) for h in (*own, *sorted(goals))]]):
        return _judged(columns, values, missing, commanded=True)
    forced = None
    if not inputs or (len(inputs) == len(own) and not sparse):
        forced = int(np.argmax(evidence) if not inputs else np.argmin(evidence))
        inputs = [forced] if not inputs else [k for k in inputs if k != forced]
    # in a file of many columns switches are looked at by their names alone: else the tests take minutes
    signs = _signs(v, [k for k, h in enumerate(own) if len(own) <= FEW or _said(columns[h], _WAY)])
    inputs = sorted({*inputs, *(k for pair in signs.items() for k in pair)})
    found: dict[str, Role] = {}
    for k, h in enumerate(own):
        kind: Kind = "input" if k in inputs else "output"
        alone = kind == "output" and _unmoved(tells, k, inputs)
        driven = kind == "output" and not alone
        answers = (
            tuple(own[i] for i in sorted(inputs, key=lambda i: -tells[i, k]) if _drives(tells, i, k, inputs))
            if driven
            else ()
        )
        sure = abs(evidence[k]) >= SURE and k != forced and not alone
        why = reasons[k][kind] or "nothing speaks against it"
        if k in signs:
            found[h] = replace(
                _role(columns[h], kind, f"{why}; {own[signs[k]]!r} gives it its sign", True), direction=own[signs[k]]
            )
            continue
        if k in signs.values():
            found[h] = _role(columns[h], kind, "it has two levels that say which way another one acts", True)
            continue
        found[h] = _role(columns[h], kind, f"{why}; {UNMOVED}" if alone else why, sure, answers)
    for h in sparse:
        why = "most of its samples are missing, where an input is known at all times"
        found[h] = _role(columns[h], "output", why, _named(columns[h]) <= 0)
    for h in goals:
        found[h] = _role(columns[h], "set point", "a set point by its name", True)
    for h, of in copies.items():
        found[h] = _role(columns[h], "copy", f"nearly the same as {of!r}", True)
    return found


def _signs(v: np.ndarray, switches: Sequence[int]) -> dict[int, int]:
    """Of columns v (n, m) those without sign, each with the one of the `switches`, a column of two levels, that says
    which way it acts: a duty and the direction of a bridge.

    Their product with the levels as -1 and 1 then tells the future of another column far better than their sum does,
    and than the duty in one of the directions alone.
    """
    m = v.shape[1]
    two = [k for k in range(m) if len(np.unique(v[:, k])) == 2]
    found: dict[int, int] = {}
    for b in (k for k in two if k in switches):
        high = v[:, b] == v[:, b].max()
        best = SIGNED
        for a in (k for k in range(m) if k != b and v[:, k].min() >= 0 and k not in found):
            for y in (k for k in range(m) if k not in (a, b, *two) and v[:, k].min() < v[:, k].max()):
                ratio = _signed(v[:, y], v[:, a], high)
                if ratio < best:
                    best, found = ratio, {**{i: j for i, j in found.items() if j != b}, a: b}
    return found


def _signed(y: np.ndarray, a: np.ndarray, high: np.ndarray) -> float:
    """What the past of a with the sign of `high` leaves of y, over the least that a and `high` leave as a sum or a in
    one direction alone; the least over several strides."""
    least = 1.0
    for stride in (1, 3, 10, 30):
        w = y[::stride]
        if len(w) < 40:
            break
        rows = len(w) - 3

        def left(*causes: np.ndarray, w: np.ndarray = w, rows: int = rows, stride: int = stride) -> float:
            past = [x[::stride][2 - j : 2 - j + rows] for x in (y, *causes) for j in range(3)]
            return _left(np.column_stack([*past, np.ones(rows)]), w[3:])

        own, signed = left(), left(np.where(high, a, -a))
        if own - signed > 12 / rows * own:  # beyond chance
            others = min(left(a, high.astype(float)), left(np.where(high, a, 0.0)), left(np.where(high, 0.0, a)))
            least = min(least, signed / max(others, 1e-300))
    return least


def _role(column: Column, kind: Kind, why: str, sure: bool, answers: tuple[str, ...] = ()) -> Role:
    return Role(column.header, identifier(column.name), column.unit, kind, why, sure, answers)


def _unmoved(tells: np.ndarray, k: int, inputs: Sequence[int]) -> bool:
    """Whether nothing tells of output k, while something clearly tells of another output: a supply temperature, a
    load, the weather."""
    others = [float(tells[:, j].max()) for j in range(len(tells)) if j != k and j not in inputs]
    return float(tells[:, k].max()) < STILL < 3.0 * STILL < max(others, default=0.0)


def _drives(tells: np.ndarray, i: int, k: int, inputs: Sequence[int]) -> bool:
    """Whether input i is worth a place in the equation of output k: what it tells is not far below what the
    strongest does."""
    return tells[i, k] >= 0.02 * max(tells[j, k] for j in inputs) and tells[i, k] > 0


def _copies(heads: Sequence[str], columns: Mapping[str, Column], v: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Columns that are another one again, filtered or commanded, by header: the same unit or none, and differences
    of under 2 % of both."""
    found: dict[str, str] = {}
    for j, later in enumerate(heads):
        for first in heads[:j]:
            if first in found or columns[first].unit != columns[later].unit:
                continue
            size = max(np.abs(v[first]).max(), np.abs(v[later]).max())
            a, b = v[first] / size, v[later] / size
            if np.std(a - b) < 0.02 * min(np.std(a), np.std(b)) and abs(np.mean(a - b)) < 0.02 * np.ptp(a):
                filtered = _said(columns[first], re.compile("filt|filtered|smooth|smoothed"))
                found.update({first: later} if filtered else {later: first})
                break
    return found


def _evidence(column: Column, v: np.ndarray, tells: np.ndarray, k: int) -> tuple[float, dict[str, str]]:
    """(evidence, above 0 for an input; the clauses that speak for each role) of column k of v (n, m)."""
    total, said = 0.0, {"input": [], "output": []}

    def add(weight: float, clause: str) -> None:
        nonlocal total
        total += weight
        said["input" if weight > 0 else "output"].append(clause)

    named = _named(column)
    if named:
        add((3.0 if _said(column, _GIVEN) else 1.2) * named, "its name")
    if column.unit in _IN_UNITS or column.unit in _OUT_UNITS:
        add(0.5 if column.unit in _IN_UNITS else -0.5, f"its unit {column.unit}")
    jumps = _jumps(v[:, k])
    if jumps:
        add(1.3 * jumps, "it stays level and jumps" if jumps > 0 else "it changes gradually")
    others = [i for i in range(len(tells)) if i != k]
    if others:
        out, back = max(tells[k, i] for i in others), max(tells[i, k] for i in others)
        lead = (out - back) / max(out + back, 0.05)
        if abs(lead) > 0.3:
            add(1.2 * lead, "other columns react to it" if lead > 0 else "it reacts to another column")
        if any(_shakes_with(v[:, k], v[:, i]) for i in others):
            add(2.0, "another column jumps with it, and shakes where it stays level")
        elif any(_shakes_with(v[:, i], v[:, k]) for i in others):
            add(-2.0, "it shakes where another column is level, and jumps with it")
    return total, {kind: ", ".join(clauses) for kind, clauses in said.items()}


def _controlled(tells: np.ndarray, inputs: Sequence[int], v: np.ndarray) -> bool:
    """Whether the output of a controller is among the columns, whose `tells` (m, m) are given: it moves another one,
    and looks like an input or does not follow a set point itself. Set points are the last of all columns v (n, more).
    """
    m = len(tells)
    leads = [i for i in range(m) if any(tells[i, k] > tells[k, i] for k in range(m) if k not in inputs)]
    if any(i in inputs for i in leads):
        return True
    told = _tells(v)[m:, :m] if leads else np.zeros((1, m))
    moved = np.maximum(STILL, 0.5 * told.max(axis=0))  # (m,): a walk that is slow seems to tell a little of all
    return any(np.any(tells[i] >= moved) and told[:, i].max() < 0.5 for i in leads)


def _shakes_with(level: np.ndarray, other: np.ndarray) -> bool:
    """Whether a column (n,) stays exactly level between jumps, and another one jumps with it but never stays level:
    what was set, and what a sensor without memory says of it."""
    moves, steps = np.diff(level) != 0, np.abs(np.diff(other))
    if not 5 <= np.count_nonzero(moves) <= 0.2 * len(moves) or np.mean(steps[~moves] > 0) < 0.5:
        return False
    after = np.roll(moves, 1) & ~moves  # of a plant with memory the answer goes on
    return bool(np.median(steps[moves]) > 5.0 * max(np.median(steps[~moves]), np.median(steps[after])))


def _named(column: Column) -> float:
    """1 where the name is that of an input, -1 of an output, 0 of neither."""
    if _said(column, _GOAL) or _said(column, _GIVEN):
        return 1.0
    words = [
        (1.0 if _INPUT.fullmatch(w) else -1.0)
        for w in _words(column)
        if bool(_INPUT.fullmatch(w)) != bool(_OUTPUT.fullmatch(w))
    ]
    if not words and _said(column, _MEASURED):
        # the output of a controller
        words = [1.0 if _said(column, re.compile("output")) and column.unit == "%" else -1.0]
    return float(np.sign(words[-1] if sum(words) == 0 else sum(words))) if words else 0.0


def _jumps(v: np.ndarray) -> float:
    """1 for a signal that holds and jumps, down to -1 for one whose changes are spread over all samples; 0 where
    that is unclear."""
    d = np.abs(np.diff(v))
    if not np.any(d):
        return 0.0
    few = max(1, len(d) // 10)
    share = float(np.sort(d**2)[-few:].sum() / np.sum(d**2))  # of the square of all changes, in a tenth of the samples
    size = float(np.sqrt(np.sum(d**2) / max(np.sum(d > 0.5 * d.max()), 1)) / np.ptp(v))
    if share > 0.97 and size > 0.1:
        return 1.0
    return -0.6 if share < 0.9 or size < 0.05 else 0.0


def _tells(v: np.ndarray) -> np.ndarray:
    """(m, m): the share of what the own past leaves of column k that the past of column i explains, at the stride at
    which it is most."""
    m = v.shape[1]
    found = np.zeros((m, m))
    for stride in (1, 3, 10, 30):
        w = v[::stride]
        if len(w) < 40:
            break
        rows = len(w) - 3
        past = [np.column_stack([w[2 - j : 2 - j + rows, k] for j in range(3)]) for k in range(m)]
        for k in range(m):
            own = np.column_stack([past[k], np.ones(rows)])
            left = _left(own, w[3:, k])
            for i in range(m):
                if i != k and left > 1e-12 * np.var(w[:, k]):
                    more = _left(np.column_stack([own, past[i]]), w[3:, k])
                    share = 1 - more / left
                    # chance gives 3 / rows in the mean
                    found[i, k] = max(found[i, k], share if share * rows > 12 else 0.0)
    return found


def _left(x: np.ndarray, y: np.ndarray) -> float:
    scale = np.maximum(np.abs(x).max(axis=0), 1e-300)
    return float(np.mean((y - x @ (np.linalg.lstsq(x / scale, y, rcond=1e-10)[0] / scale)) ** 2))
