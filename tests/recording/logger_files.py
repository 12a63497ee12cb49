"""Files as loggers, oscilloscopes, PLCs, MATLAB and Excel write them, of simulated plants whose inputs and outputs
are known."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Logged:
    """`write(path)` makes the file; `time`, `inputs` and `outputs` are headers as `describe` gives them."""

    name: str
    write: Callable[[Path], None]
    time: str | None
    inputs: frozenset[str]
    outputs: frozenset[str]
    period: float | None = None


def lag(u: np.ndarray, h: float, tau: float, gain: float = 1.0, late: int = 0) -> np.ndarray:
    """First-order answer (n,) to an input (n,) that is held, from rest at the first value, `late` samples behind."""
    u = np.r_[np.full(late, u[0]), u[: len(u) - late]]
    y, a = np.empty(len(u)), np.exp(-h / tau)
    y[0] = gain * u[0]
    for k in range(len(u) - 1):
        y[k + 1] = a * y[k] + (1 - a) * gain * u[k]
    return y


def prbs(rng: np.random.Generator, n: int, held: int, low: float, high: float) -> np.ndarray:
    return np.repeat(rng.choice([low, high], n // held + 1), held)[:n]


def steps(rng: np.random.Generator, n: int, held: int, low: float, high: float) -> np.ndarray:
    return np.repeat(np.round(rng.uniform(low, high, n // held + 1), 1), held)[:n]


def _motor(seed: int, n: int = 600, h: float = 0.02) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    u = prbs(rng, n, 20, 1.0, 5.0)
    return h * np.arange(n), u, lag(u, h, 0.12, 180.0) + rng.normal(0, 3.0, n)


def _heater(seed: int, n: int = 400, h: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q = steps(rng, n, 80, 0, 60)
    return h * np.arange(n), q, np.round(21 + lag(q, h, 60.0, 0.6, 5) + rng.normal(0, 0.1, n), 2)


def _csv(path: Path, headers: list[str], *columns: np.ndarray, sep: str = ",", form: str = "%.6g", top: str = "",
         encoding: str = "utf-8",
         comma: bool = False) -> None:  # fmt: skip
    rows = [sep.join(c if isinstance(c, str) else form % c for c in row) for row in zip(*columns, strict=True)]
    body = "\n".join(row.replace(".", ",") if comma else row for row in rows)
    path.write_bytes(f"{top}{sep.join(headers)}\n{body}\n".encode(encoding))


def _stamps(t: np.ndarray, form: str, cut: int | None = None) -> np.ndarray:
    start = datetime(2024, 3, 28, 9, 58, 57)
    return np.array([(start + timedelta(seconds=float(v))).strftime(form)[:cut] for v in t], dtype=object)


def plain(path: Path) -> None:
    t, u, y = _motor(1)
    _csv(path, ["t", "u", "y"], t, u, y)


def german(path: Path) -> None:
    t, u, y = _motor(2)
    _csv(path, ["Zeit [s]", "Drehzahl [1/min]", "Spannung [V]"], t, y, u, sep=";", comma=True, encoding="latin-1")


def french(path: Path) -> None:
    t, q, y = _heater(3)
    _csv(
        path,
        ["Temps (s)", "Puissance chauffage (%)", "Température (°C)"],
        t,
        q,
        y,
        sep=";",
        comma=True,
        encoding="utf-8-sig",
    )


def pandas_index(path: Path) -> None:
    t, u, y = _motor(4)
    n = np.arange(len(t)).astype(str).astype(object)
    _csv(path, ["", "time", "pwm", "speed"], n, t, u, y)


def date_and_clock(path: Path) -> None:
    t, q, y = _heater(5)
    top = "Device: DL-220\nSerial: 004711\nChannels: 2\n\n"
    _csv(
        path,
        ["Date", "Time", "CH1 temp (degC)", "CH2 heater (%)"],
        _stamps(t, "%d.%m.%Y"),
        _stamps(t, "%H:%M:%S"),
        y,
        q,
        top=top,
    )


def iso(path: Path) -> None:
    t, q, y = _heater(6)
    _csv(path, ["timestamp", "temperature", "heater"], _stamps(t, "%Y-%m-%dT%H:%M:%S.%fZ"), y, q)


def american(path: Path) -> None:
    t, q, y = _heater(7)
    _csv(path, ["Timestamp", "Valve Position (%)", "Outlet Temp (degC)"], _stamps(t, "%m/%d/%Y %I:%M:%S %p"), q, y)


def german_stamp(path: Path) -> None:
    t, u, y = _motor(8)
    _csv(path, ["Datum", "Ventil", "Durchfluss"], _stamps(t, "%d.%m.%Y %H:%M:%S,%f", -3), u, y, sep=";", form="%.4f")


def epoch(path: Path) -> None:
    t, u, y = _motor(9)
    _csv(path, ["timestamp_ms", "duty", "rpm"], 1.7e12 + 1e3 * t, u / 5, y, form="%.14g")


def scope(path: Path) -> None:
    rng = np.random.default_rng(10)
    n, h = 2000, 1e-5
    u = np.where(np.arange(n) < 300, 0.0, 2.0) + rng.normal(0, 0.004, n)
    y = lag(np.where(np.arange(n) < 300, 0.0, 2.0), h, 2e-3, 1.6) + rng.normal(0, 0.004, n)
    top = "Model,TDS2014\nFirmware Version,7.1\nRecord Length,2000\nSample Interval,1e-05,s\n\n"
    _csv(path, ["TIME", "CH1", "CH2"], h * np.arange(n) - 3e-3, u, y, top=top, form="%.7e")


def scope_two_rows(path: Path) -> None:
    rng = np.random.default_rng(11)
    n, h = 1500, 1e-4
    wave = 2.5 + 2.5 * np.sign(np.sin(2 * np.pi * 11 * h * np.arange(n) + 0.3))
    y = lag(wave, h, 8e-3, 0.9) + rng.normal(0, 0.01, n)
    top = "x-axis,1,2\nsecond,Volt,Volt\n"
    rows = "\n".join(
        f"{t:.6e},{b:.4f},{a:.4f}" for t, a, b in zip(h * np.arange(n), wave + rng.normal(0, 0.01, n), y, strict=True)
    )
    path.write_text(top + rows + "\n")


def plc(path: Path) -> None:
    t, q, y = _heater(12)
    n = np.arange(1, len(t) + 1).astype(str).astype(object)
    _csv(path, ["Nr", "Time", "MW100 Valve", "MW102 Level"], n, _stamps(t, "%H:%M:%S"), q, y, sep="\t")


def plc_long(path: Path) -> None:
    t, q, y = _heater(13)
    stamps = _stamps(t, "%Y-%m-%d %H:%M:%S")
    rows = [
        f"{s};{tag};{v:.2f}"
        for s, a, b in zip(stamps, q, y, strict=True)
        for tag, v in (("Heater.Out", a), ("Tank.Temp", b))
    ]
    path.write_text("timestamp;tag;value\n" + "\n".join(rows) + "\n")


def mat_struct(path: Path) -> None:
    from scipy.io import savemat

    t, u, y = _motor(14)
    savemat(path, {"data": {"t": t, "u": u, "y": y, "name": "bench 3"}})


def mat_cells(path: Path) -> None:
    from scipy.io import savemat

    t, u, y = _motor(15)
    cells = np.empty((len(t) + 1, 3), dtype=object)
    cells[0] = ["time [s]", "voltage [V]", "speed [rad/s]"]
    cells[1:] = np.column_stack([t, u, y])
    savemat(path, {"log": cells})


def mat_matrix(path: Path) -> None:
    from scipy.io import savemat

    _, u, y = _motor(16)
    savemat(path, {"Ts": 0.02, "u": u[:, None], "y": y[:, None]})


def excel(path: Path) -> None:
    from openpyxl import Workbook

    t, q, y = _heater(17)
    book = Workbook()
    sheet = book.worksheets[0]
    sheet.append(["Heating test, line 2"])
    sheet.append(["Operator", "night shift"])
    sheet.append([])
    sheet.append(["Time", "Heater power", "Temperature"])
    sheet.append(["s", "%", "degC"])
    for row in zip(t, q, y, strict=True):
        sheet.append([float(v) for v in row])
    book.save(path)


def excel_stamps(path: Path) -> None:
    from openpyxl import Workbook

    t, q, y = _heater(18)
    book = Workbook()
    sheet = book.worksheets[0]
    sheet.append(["Sample", "Timestamp", "Temp. (degC)", "Output (%)"])
    start = datetime(2024, 3, 28, 9, 58, 57)
    for k, row in enumerate(zip(t, y, q, strict=True)):
        sheet.append([k, start + timedelta(seconds=float(row[0])), float(row[1]), float(row[2])])
    book.save(path)


def arduino(path: Path) -> None:
    t, u, y = _motor(19)
    _csv(path, ["millis", "pwm", "rpm"], np.round(1e3 * t), np.round(u * 51), np.round(y), form="%g")
    path.write_text(path.read_text() + "120")


def labview(path: Path) -> None:
    t, u, y = _motor(20)
    top = "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\n***End_of_Header***\t\n\t\nChannels\t2\n"
    top += "Samples\t600\t600\n***End_of_Header***\t\t\n"
    _csv(path, ["X_Value", "Voltage", "Tacho"], t, u, y, sep="\t", top=top)


def counted(path: Path) -> None:
    _, q, y = _heater(21)
    n = np.arange(1, len(q) + 1).astype(str).astype(object)
    _csv(path, ["Sample", "Heater", "Temp"], n, q, y)


def one_heater_idle(path: Path) -> None:
    t, q, y = _heater(22)
    rng = np.random.default_rng(22)
    other = np.round(21 + lag(q, 1.0, 150.0, 0.15, 9) + rng.normal(0, 0.1, len(t)), 2)
    _csv(path, ["Time", "Q1", "Q2", "T1", "T2"], t, q, 0 * q, y, other)


def two_heaters(path: Path) -> None:
    rng = np.random.default_rng(23)
    n = 900
    a, b = steps(rng, n, 90, 0, 60), steps(rng, n, 70, 0, 60)
    first = 20 + lag(a, 1.0, 60.0, 0.6, 5) + lag(b, 1.0, 90.0, 0.2, 8) + rng.normal(0, 0.1, n)
    second = 20 + lag(b, 1.0, 60.0, 0.5, 5) + lag(a, 1.0, 90.0, 0.15, 8) + rng.normal(0, 0.1, n)
    headers = ["Time (sec)", "Heater 1 (%)", "Heater 2 (%)", "Temperature 1 (degC)", "Temperature 2 (degC)"]
    _csv(path, headers, np.arange(n) * 1.0, a, b, first, second)


def output_first(path: Path) -> None:
    t, u, y = _motor(24)
    _csv(path, ["a", "b", "seconds"], y, u, t)


def closed_loop(path: Path) -> None:
    rng = np.random.default_rng(25)
    n, h = 900, 1.0
    goal = steps(rng, n, 150, 30, 60)
    y, u, total, noisy = np.empty(n), np.empty(n), 0.0, np.empty(n)
    y[0] = 25.0
    for k in range(n):
        noisy[k] = y[k] + rng.normal(0, 0.05)
        error = goal[k] - noisy[k]
        u[k] = np.clip(4 * error + total, 0, 100)
        total += 0.05 * error * (0 < u[k] < 100)
        if k + 1 < n:
            y[k + 1] = y[k] + h * (0.6 * u[k] + 21 - y[k]) / 60
    _csv(path, ["time", "SP", "PV", "CO"], h * np.arange(n), goal, noisy, u)


def random_input(path: Path) -> None:
    rng = np.random.default_rng(26)
    n, h = 1200, 0.05
    u = lag(rng.normal(0, 3, n), h, 0.3)  # smooth, as a filtered noise generator gives it
    y = lag(lag(u, h, 0.5, 2.0), h, 0.2) + rng.normal(0, 0.01, n)
    _csv(path, ["sec", "AI0", "AI1"], h * np.arange(n), y, u)


STYLES = [
    Logged("plain.csv", plain, "t", frozenset({"u"}), frozenset({"y"})),
    Logged("german.csv", german, "Zeit [s]", frozenset({"Spannung [V]"}), frozenset({"Drehzahl [1/min]"})),
    Logged("french.csv", french, "Temps (s)", frozenset({"Puissance chauffage (%)"}), frozenset({"Température (°C)"})),
    Logged("pandas.csv", pandas_index, "time", frozenset({"pwm"}), frozenset({"speed"})),
    Logged("logger.csv", date_and_clock, "Time", frozenset({"CH2 heater (%)"}), frozenset({"CH1 temp (degC)"}), 1.0),
    Logged("iso.csv", iso, "timestamp", frozenset({"heater"}), frozenset({"temperature"}), 1.0),
    Logged("american.csv", american, "Timestamp", frozenset({"Valve Position (%)"}), frozenset({"Outlet Temp (degC)"}),
           1.0),
    Logged("datum.csv", german_stamp, "Datum", frozenset({"Ventil"}), frozenset({"Durchfluss"}), 0.02),
    Logged("epoch.csv", epoch, "timestamp_ms", frozenset({"duty"}), frozenset({"rpm"}), 0.02),
    Logged("scope.csv", scope, "TIME", frozenset({"CH1"}), frozenset({"CH2"}), 1e-5),
    Logged("keysight.csv", scope_two_rows, "x-axis", frozenset({"2"}), frozenset({"1"}), 1e-4),
    Logged("plc.txt", plc, "Time", frozenset({"MW100 Valve"}), frozenset({"MW102 Level"}), 1.0),
    Logged("long.csv", plc_long, "timestamp", frozenset({"Heater.Out"}), frozenset({"Tank.Temp"}), 1.0),
    Logged("struct.mat", mat_struct, "data.t", frozenset({"data.u"}), frozenset({"data.y"}), 0.02),
    Logged("cells.mat", mat_cells, "time [s]", frozenset({"voltage [V]"}), frozenset({"speed [rad/s]"}), 0.02),
    Logged("matrix.mat", mat_matrix, None, frozenset({"u"}), frozenset({"y"}), 0.02),
    Logged("excel.xlsx", excel, "Time", frozenset({"Heater power"}), frozenset({"Temperature"}), 1.0),
    Logged("stamps.xlsx", excel_stamps, "Timestamp", frozenset({"Output (%)"}), frozenset({"Temp. (degC)"}), 1.0),
    Logged("arduino.csv", arduino, "millis", frozenset({"pwm"}), frozenset({"rpm"}), 0.02),
    Logged("labview.lvm", labview, "X_Value", frozenset({"Voltage"}), frozenset({"Tacho"}), 0.02),
    Logged("counted.csv", counted, None, frozenset({"Heater"}), frozenset({"Temp"})),
    Logged("idle.csv", one_heater_idle, "Time", frozenset({"Q1"}), frozenset({"T1", "T2"})),
    Logged("two.csv", two_heaters, "Time (sec)", frozenset({"Heater 1 (%)", "Heater 2 (%)"}),
           frozenset({"Temperature 1 (degC)", "Temperature 2 (degC)"})),
    Logged("output_first.csv", output_first, "seconds", frozenset({"b"}), frozenset({"a"})),
    Logged("closed.csv", closed_loop, "time", frozenset({"CO"}), frozenset({"PV"})),
    Logged("noise.csv", random_input, "sec", frozenset({"AI1"}), frozenset({"AI0"})),
]  # fmt: skip
