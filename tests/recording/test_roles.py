"""What columns seem to be: thirty files of loggers, and plants without names, of which the truth is known."""

from collections import Counter
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from logger_files import STYLES, lag, prbs, steps

from plantfit.recording import describe, read
from plantfit.recording.readers.any_format import table
from plantfit.recording.readers.columns import Table, named_columns
from plantfit.recording.roles import roles_of


def headers(roles, kind):
    return {r.header for r in roles.of(kind)}


@pytest.mark.parametrize("style", STYLES, ids=lambda s: s.name)
def test_files_of_loggers(style, tmp_path):
    """Time, inputs and outputs are right; where they are not, the user is told that it is unsure."""
    file = tmp_path / style.name
    style.write(file)
    found, roles = describe(file), roles_of(table(file))
    assert found.time == style.time
    assert style.period is None or found.period == pytest.approx(style.period, rel=1e-6)
    assert headers(roles, "input") == style.inputs
    assert headers(roles, "output") == style.outputs
    if style.name == "noise.csv":
        assert roles.unsure
    else:
        assert not roles.unsure
    recording = read(file) if style.time or style.period else read(file, period=1.0)
    assert len(recording) == found.rows
    assert np.isfinite(recording.t).all()


HERE = Path(__file__).parents[2] / "src" / "plantfit" / "cases"


def nameless(seed):
    """(kind of input, u (n,), y (n,)) of a first- or second-order plant with noise; some inputs measured, some
    outputs rounded."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(150, 3000))
    t, tau = np.arange(n), float(np.exp(rng.uniform(np.log(2), np.log(n / 8))))
    held = max(2, int(tau * rng.uniform(0.5, 3)))
    kind = str(rng.choice(["prbs", "steps", "step", "sines", "noise", "ramps"]))
    u = {
        "prbs": lambda: prbs(rng, n, held, -1, 1),
        "steps": lambda: steps(rng, n, held, 0, 10),
        "step": lambda: (t > n // 5) * 3.0,
        "sines": lambda: sum(
            np.sin(2 * np.pi * t / p + rng.uniform(0, 6)) for p in rng.uniform(4 * tau / 3, 6 * tau, 4)
        ),
        "noise": lambda: lag(rng.normal(0, 1, n), 1.0, tau / 4),
        "ramps": lambda: np.interp(t, np.linspace(0, n, 8), rng.uniform(0, 5, 8)),
    }[kind]()
    gain = float(rng.uniform(0.5, 3) * rng.choice([-1, 1]))
    u = np.asarray(u)
    y = lag(u, 1.0, tau, gain, int(rng.integers(0, max(1, int(tau / 3)))))
    y = lag(y, 1.0, tau / 3) if seed % 2 else y
    y = y + rng.normal(0, rng.choice([0.002, 0.01, 0.03]) * np.ptp(y), n)
    if rng.random() < 0.3:
        y = np.round(y / (np.ptp(y) / 200)) * np.ptp(y) / 200
    if rng.random() < 0.3:
        u = u + rng.normal(0, 0.005 * np.ptp(u), n)
    return kind, u, y


def in_a_table(**columns):
    n = len(next(iter(columns.values())))
    cells = [
        pl.Series("t", np.arange(n) * 1.0),
        *(pl.Series(name, np.asarray(v, dtype=float)) for name, v in columns.items()),
    ]
    return Table("x", named_columns(["t", *columns], cells))


def test_plants_without_names():
    """Where it is sure it is right; it is right in nine of ten, and sure of most inputs that jump."""
    counts = Counter()
    for seed in range(200):
        kind, u, y = nameless(seed)
        roles = roles_of(in_a_table(a=u, b=y) if seed % 3 else in_a_table(a=y, b=u))
        right = headers(roles, "input") == ({"a"} if seed % 3 else {"b"})
        counts[kind in ("prbs", "steps", "step"), right, not roles.unsure] += 1
    total = sum(counts.values())
    assert sum(n for (_, right, sure), n in counts.items() if sure and not right) == 0, counts
    assert sum(n for (_, right, _), n in counts.items() if right) >= 0.9 * total, counts
    jumping = sum(n for (jumps, _, _), n in counts.items() if jumps)
    assert sum(n for (jumps, _, sure), n in counts.items() if jumps and sure) >= 0.85 * jumping, counts


def test_two_noises_are_never_sure():
    """Neither drives the other: no word that is sure may stand."""
    sure = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        a, b = (lag(rng.normal(0, 1, 800), 1.0, 10.0) for _ in range(2))
        sure += not roles_of(in_a_table(a=a, b=b)).unsure
    assert sure <= 2


def test_names_that_lie_lose_against_what_the_columns_do():
    """A column that is called a temperature and jumps, and one that is called a voltage and follows, are at least
    unsure."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u = prbs(rng, 800, 40, 0, 5)
        y = lag(u, 1.0, 25.0, 2.0) + rng.normal(0, 0.02, 800)
        roles = roles_of(in_a_table(temperature=u, voltage=y))
        assert headers(roles, "input") == {"temperature"} or roles.unsure


def test_an_output_is_linked_to_the_inputs_that_it_answers_to():
    rng = np.random.default_rng(3)
    n = 2000
    a, b = steps(rng, n, 50, 0, 10), steps(rng, n, 70, 0, 10)
    one = lag(a, 1.0, 20.0) + rng.normal(0, 0.02, n)
    both = lag(a, 1.0, 20.0) + lag(b, 1.0, 30.0) + rng.normal(0, 0.02, n)
    roles = {r.header: r for r in roles_of(in_a_table(a=a, b=b, one=one, both=both)).columns}
    assert roles["one"].answers == ("a",)
    assert set(roles["both"].answers) == {"a", "b"}


@pytest.mark.parametrize("seed", range(6))
def test_a_supply_that_nothing_moves_is_unsure_and_what_it_moves_is_not(seed):
    rng = np.random.default_rng(seed)
    n = 1200
    valve, slow = steps(rng, n, 40, 0, 1), np.cumsum(rng.normal(0, 0.05, n))
    supply = 60.0 + lag(slow, 1.0, 40.0)
    outlet = lag(supply, 1.0, 8.0) - lag(valve, 20.0, 8.0)
    table = in_a_table(
        valve_u=valve, temp1_degC=supply + rng.normal(0, 0.02, n), temp2_degC=outlet + rng.normal(0, 0.02, n)
    )
    roles = {c.header: c for c in roles_of(table).columns}
    assert not roles["temp1_degC"].sure
    assert "disturbance" in roles["temp1_degC"].why
    assert roles["temp1_degC"].answers == ()
    assert (roles["temp2_degC"].kind, roles["temp2_degC"].sure) == ("output", True)
    assert (roles["valve_u"].kind, roles["valve_u"].sure) == ("input", True)


def test_index_constant_copy_and_set_point():
    rng = np.random.default_rng(5)
    n = 600
    u = prbs(rng, n, 30, 0, 5)
    y = lag(u, 1.0, 15.0, 2.0) + rng.normal(0, 0.05, n)
    columns = {
        "Sample": np.arange(n) + 7.0,
        "u": u,
        "fan": np.full(n, 3.0),
        "y": y,
        "y_filt": y + 1e-4 * rng.normal(size=n),
        "y_ref": 2 * u,
    }
    roles = {r.header: r for r in roles_of(in_a_table(**columns)).columns}
    kinds = {h: r.kind for h, r in roles.items()}
    assert kinds == {
        "t": "time", "Sample": "index", "u": "input", "fan": "constant", "y": "output", "y_filt": "copy",
        "y_ref": "set point",
    }  # fmt: skip
    assert roles["fan"].why == "3 throughout"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [1e308, 1e-308, 1e160])
def test_values_at_the_ends_of_float64_give_roles_without_a_warning(size):
    _, u, y = nameless(2)
    u, y = u - u.mean(), y - y.mean()
    small = np.abs(np.r_[u, y]).max()
    roles = roles_of(in_a_table(a=u / small * size, b=y / small * size))
    assert headers(roles, "input") == headers(roles_of(in_a_table(a=u, b=y)), "input")


def test_days_and_months():
    """The order in which all are dates; by the smaller span where both are; refused where nothing tells."""
    from plantfit.recording.readers.timestamps import timestamps

    def day(cells):
        found, unclear = timestamps(cells)
        return [f"{d:%m-%d}" if d else None for d in found], unclear

    assert day(["13/02/2024 10:00", "14/02/2024 10:00"]) == (["02-13", "02-14"], None)
    assert day(["02/13/2024 10:00", "02/14/2024 10:00"]) == (["02-13", "02-14"], None)
    # the day after, not the month
    assert day(["01/02/2024 23:59:59", "02/02/2024 00:00:01"]) == (["02-01", "02-02"], None)
    assert day(["01/02/2024 10:00"])[1] is None  # one date: its order does not matter
    assert day(["03.04.2024 10:00:00,5"])[0] == ["04-03"]
    night, noon = timestamps(["01/02/2024 12:00:00 AM", "01/02/2024 12:00:01 PM"])[0]
    assert night is not None
    assert noon is not None
    assert (night.hour, noon.hour) == (0, 12)
    assert timestamps(["31/31/2024 10:00"])[0] == [None]
    both, unclear = timestamps(["01/02/2024 10:00", "02/01/2024 10:00"])
    assert unclear is not None
    assert len(both) == 2


def test_titles_are_skipped_and_bad_rows_are_not(tmp_path):
    from plantfit.errors import RecordingError

    file = tmp_path / "a.csv"
    body = "\n".join(f"{k},{k % 7},{k % 5}" for k in range(20))
    file.write_text(f"Bench 3\nOperator,night\nt,u,y\n{body}\n")
    assert read(file).signals.keys() == {"u", "y"}
    assert "2 lines above the table were skipped." in read(file).log
    file.write_text(f"t,u,y\n1,2\n{body}\n")  # a short row is a fault of the file, not a title
    with pytest.raises(RecordingError, match="line 2: 2 cells where the first row has 3"):
        read(file)
    file.write_text(f"t,u,y\nbad,row,here\n{body}\n")
    with pytest.raises(RecordingError, match="line 2"):
        read(file)


def test_a_long_table_becomes_wide_and_other_tables_stay(tmp_path):
    file = tmp_path / "long.csv"
    rows = [f"{k},{tag},{v}" for k in range(10) for tag, v in (("u", k % 3), ("y", 2 * k)) if (k, tag) != (4, "y")]
    file.write_text("time,tag,value\n" + "\n".join(rows))
    found = read(file)
    assert found.signals.keys() == {"u", "y"}
    assert np.isnan(found["y"]).tolist() == [k == 4 for k in range(10)]
    assert found["u"].tolist() == [k % 3 for k in range(10)]
    file.write_text("time,mode,value\n" + "\n".join(f"{k},{'auto' if k % 2 else 'hand'},{k}" for k in range(10)))
    assert read(file).signals.keys() == {"value"}


def sampled(gaps_of_u, gaps_of_c, name="u", n=240):
    """An input that is held, a lag that is measured throughout, and a slower one, c; every so many samples are there
    (1: all)."""
    rng = np.random.default_rng(4)
    u = steps(rng, n, 20, 0, 10)
    y, c = lag(u, 1.0, 6.0), lag(u, 1.0, 25.0)

    def there(v, every):
        cells = [f"{a:.4f}" for a in v]
        return [cell if (k % every == 0) == (every > 0) else None for k, cell in enumerate(cells)]

    times = pl.Series([f"{k}" for k in range(n)])
    cells = [times, pl.Series(there(u, gaps_of_u)), pl.Series([f"{a:.4f}" for a in y]), pl.Series(there(c, gaps_of_c))]
    return roles_of(Table("lab.csv", named_columns(["time", name, "y", "c"], cells)))


def test_what_a_laboratory_measures_is_an_output():
    roles = sampled(1, 12)
    assert headers(roles, "input") == {"u"}
    assert headers(roles, "output") == {"y", "c"}
    assert "missing" in roles.of("output")[1].why
    assert not roles.unsure


def test_an_input_with_few_gaps_stays_one_and_where_all_is_sparse_nothing_is_told_by_it():
    roles = sampled(-9, 12)  # every ninth sample is missing
    assert headers(roles, "input") == {"u"}
    few = sampled(1, -9)
    assert headers(few, "output") == {"y", "c"}
    assert "missing" not in few.of("output")[1].why
    valve = sampled(12, 1, name="valve")  # written only where it changes, by its name an input
    assert {r.header for r in valve.unsure} >= {"valve"}


def test_a_table_of_which_each_row_holds_one_column_keeps_its_input():
    rng = np.random.default_rng(4)
    u = steps(rng, 240, 20, 0, 10)
    y, z = lag(u, 1.0, 6.0), lag(u, 1.0, 25.0)
    cells = [pl.Series([f"{a:.4f}" if k % 3 == j else None for k, a in enumerate(v)]) for j, v in enumerate((u, y, z))]
    roles = roles_of(
        Table("x.csv", named_columns(["time", "u", "y", "z"], [pl.Series([f"{k}" for k in range(240)]), *cells]))
    )
    assert headers(roles, "input") == {"u"}
    assert headers(roles, "output") == {"y", "z"}


def _second_order(u, w, dt=0.02):
    """What a servo does: w^2 (u - x) - 1.4 w v, by small steps."""
    x, v, found = float(u[0]), 0.0, []
    for wanted in u:
        found.append(x)
        for _ in range(10):
            v += dt / 10 * (w * w * (wanted - x) - 1.4 * w * v)
            x += dt / 10 * v
    return np.array(found)


@pytest.mark.parametrize("other", ["current", "voltage", "temp"])
@pytest.mark.parametrize("names", [("angle_set", "angle_meas"), ("target", "angle"), ("sp_deg", "pot_deg")])
@pytest.mark.parametrize("moves", ["steps", "sines"])
def test_the_set_point_of_a_servo_is_its_input_where_nothing_else_drives_it(names, other, moves):
    """Whatever else is measured: a battery, a current, the temperature of the room."""
    for seed in range(3):
        rng, t = np.random.default_rng(seed), 0.02 * np.arange(800)
        wanted = steps(rng, 800, 50, 0, 180) if moves == "steps" else 90 + 60 * np.sin(2 * t) + 20 * np.sin(5.6 * t)
        angle = np.round(_second_order(wanted, 12.0) + rng.normal(0, 0.3, 800), 1)
        beside = {
            "current": np.abs(np.gradient(angle)) * 0.1 + rng.normal(0, 0.02, 800),
            "voltage": 7.4 + rng.normal(0, 0.02, 800),
            "temp": 30 + np.cumsum(rng.normal(0, 0.005, 800)),
        }[other]
        roles = roles_of(in_a_table(**{names[0]: wanted, names[1]: angle, other: beside}))
        assert names[0] in headers(roles, "input"), seed
        assert names[1] in headers(roles, "output"), seed
        assert names[0] in next(r.answers for r in roles.columns if r.header == names[1])


@pytest.mark.parametrize("name", ["heating", "out", "x1"])
def test_the_set_point_of_a_loop_whose_controller_is_recorded_is_no_input(name):
    for seed in range(6):
        rng, y, integral = np.random.default_rng(seed), 0.0, 0.0
        wanted, us, ys = steps(rng, 1200, 160, 20, 80), [], []
        for goal in wanted:
            integral += 0.02 * (goal - y)
            u = 2 * (goal - y) + 1.5 * integral
            us.append(u)
            ys.append(y)
            y += 0.02 * (u - y)
        u, y = np.array(us) + rng.normal(0, 0.5, 1200), np.array(ys) + rng.normal(0, 0.2, 1200)
        roles = roles_of(in_a_table(**{"setpoint": wanted, name: u, "temp": y}))
        assert headers(roles, "set point") == {"setpoint"}, seed
        assert headers(roles, "input") == {name}, seed


@pytest.mark.parametrize("names", [("distance [mm]", "voltage [V]"), ("d", "adc"), ("dist_cm", "raw"), ("x", "y")])
def test_a_sensor_answers_to_what_it_is_held_at(names):
    """A distance sensor over a target that is moved by hand: its voltage falls with the distance at once."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        held = steps(rng, 800, 60, 100, 900)
        sensed = 10 / (0.01 * held + 0.1) + rng.normal(0, 0.03, 800)
        roles = roles_of(in_a_table(**{names[0]: held, names[1]: sensed}))
        assert headers(roles, "input") == {names[0]}, seed
        # a plant with memory goes on answering: there names and what the past tells decide
        slow = lag(held, 1.0, 10.0) + rng.normal(0, 3.0, 800)
        roles = roles_of(in_a_table(**{names[0]: held, names[1]: slow}))
        assert not any("shakes" in r.why for r in roles.columns)


def test_a_distance_is_measured_and_no_input_of_a_speed():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        speed = lag(steps(rng, 800, 60, -200, 200), 1.0, 5.0)
        distance = np.round(600 + np.cumsum(0.02 * speed) + rng.normal(0, 1, 800))
        roles = roles_of(in_a_table(speed=np.round(speed + rng.normal(0, 2, 800)), distance=distance))
        assert headers(roles, "output") == {"distance"}, seed
        assert roles.unsure


@pytest.mark.parametrize(("header", "first", "day"), [
    ("day [day]", 0, 86400.0), ("Day (d)", 3, 86400.0), ("Hours [h]", 0, 3600.0), ("min [min]", 1, 60.0),
])  # fmt: skip
def test_a_column_called_by_its_unit_is_the_time(header, first, day, tmp_path):
    """Of the days of an epidemic "it counts the rows" was said, and its 14 samples were 14 s long."""
    sick = [1, 3, 8, 28, 75, 221, 291, 255, 235, 190, 126, 70, 28, 12]
    (tmp_path / "a.csv").write_text(f"{header},I []\n" + "".join(f"{first + k},{v}\n" for k, v in enumerate(sick)))
    assert roles_of(table(tmp_path / "a.csv")).columns[0].kind == "time"
    assert read(tmp_path / "a.csv").t[-1] - read(tmp_path / "a.csv").t[0] == pytest.approx(13 * day)


@pytest.mark.parametrize("header", ["day", "day [m]", "hour [nonsense]", "dose [h]", "hours [h]"])
def test_a_column_that_is_no_time_by_its_unit_stays_what_it_was(header, tmp_path):
    """A count without a unit, a unit of no time, a name of no time, and hours that begin anew."""
    day = [k % 5 if header == "hours [h]" else k for k in range(14)]
    (tmp_path / "a.csv").write_text(f"{header},y []\n" + "".join(f"{d},{d * d % 7}\n" for d in day))
    assert roles_of(table(tmp_path / "a.csv")).columns[0].kind != "time"


def test_the_time_of_a_cycler_is_a_time_and_no_count_of_rows(tmp_path):
    """Test_Time(s) at 1 s counts as the rows do; Step_Time(s) begins anew with each step."""
    t = np.arange(300)
    i = np.where(t % 100 < 50, -2.5, 0.0)
    v = 3.7 + 0.03 * i - 1e-4 * t + 1e-3 * np.random.default_rng(0).normal(size=300)
    rows = zip(t + 1, t % 50, t, i, v, strict=True)
    head = "Data_Point,Step_Time(s),Test_Time(s),Current(A),Voltage(V)"
    place = tmp_path / "cycler.csv"
    place.write_text("\n".join([head, *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n")
    kinds = {r.header: r.kind for r in roles_of(table(place)).columns}
    assert kinds["Test_Time(s)"] == "time"
    assert kinds["Step_Time(s)"] != "time"
    assert kinds["Data_Point"] == "index"


@pytest.mark.parametrize(
    ("given", "answers"),
    [("SteeringWheelAngle [deg]", "YawRate [deg/s]"), ("rudder_angle [deg]", "yaw_rate [deg/s]"),
     ("T_ambient [degC]", "T_room [degC]"), ("Bremsdruck [bar]", "Geschwindigkeit [m/s]")],
)  # fmt: skip
def test_what_a_driver_or_the_weather_gives_is_an_input_though_it_moves_gradually(given, answers):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        t = 0.02 * np.arange(2000)
        waves = [rng.uniform(5, 20) * np.sin(w * t + rng.uniform(0, 6)) for w in (0.7, 1.9, 3.1)]
        turned = np.sum(waves, axis=0)
        follows = lag(turned, 0.35, 10.0) + rng.normal(0, 0.15, 2000)
        roles = roles_of(in_a_table(**{given: np.round(turned, 1), answers: follows}))
        assert headers(roles, "input") == {given}, seed
        assert headers(roles, "output") == {answers}, seed


def test_an_angle_that_is_measured_stays_an_output():
    for seed in range(4):
        rng = np.random.default_rng(seed)
        drive = steps(rng, 2000, 150, -3, 3)
        answer = lag(drive, 0.5, 20.0) + rng.normal(0, 0.05, 2000)
        for name in ("tilt_angle [deg]", "inclination [deg]", "wheel_angle [deg]"):
            assert headers(roles_of(in_a_table(**{"motor [V]": drive, name: answer})), "output") == {name}, seed
