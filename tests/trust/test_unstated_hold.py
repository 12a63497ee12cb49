"""A dead time that rests on how an input goes on between samples, on plants whose dead time and hold are known."""

import numpy as np
import pytest

import plantfit as pf
from plantfit.recording.record import Recording, Signal

DEAD, K, T, DT, FINE = 27.0, 2.0, 60.0, 10.0, 100


def recorded(
    seed: int,
    hold: str,
    noise: float = 0.02,
    n: int = 120,
    fine: int = FINE,
    level: int = 1,
    dead: float = DEAD,
) -> Recording:
    """Samples of a first-order plant under a wandering input, which stays for `level` samples, by exact steps of a
    hundredth of a sample."""
    rng = np.random.default_rng(seed)
    t, u = np.arange(n) * DT, np.repeat(np.cumsum(rng.normal(size=-(-n // level))), level)[:n] * 0.3
    middle = (np.arange((n - 1) * fine) + 0.5) * DT / fine - dead
    at = np.interp(middle, t, u) if hold == "linear" else u[np.clip(np.floor(middle / DT).astype(int), 0, n - 1)]
    x, kept = K * u[0], [K * u[0]]
    for k, v in enumerate(at):
        x += (K * v - x) * -np.expm1(-DT / fine / T)
        if (k + 1) % fine == 0:
            kept.append(x)
    y = np.array(kept) + noise * rng.normal(size=n)
    return Recording(t, {"u": Signal(u, "V"), "y": Signal(y, "K")}, "bench", ())


def problem(recording: Recording, hold: dict[str, str] | None = None, late: bool = True) -> pf.Problem:
    start = {"x": "K" if late else {"unit": "K", "initial": "y"}}
    model = pf.equations(
        f"x' = (K*{'delay(u, Td)' if late else 'u'} - x)/T; y = x", states=start, inputs={"u": "V"},
        outputs={"y": "K"}, parameters={"K": "K/V", "T": "s"} | ({"Td": "s"} if late else {}),
    )  # fmt: skip
    own = {"K": pf.Parameter((0.1, 10.0)), "T": pf.Parameter((5.0, 500.0))}
    return pf.Problem(model, {"bench": recording}, own | ({"Td": pf.Parameter((0.0, 80.0))} if late else {}), hold=hold)


def told(answer: pf.Answer) -> list[str]:
    return [s["sentence"] for s in answer.findings["verdict"] if "between its samples" in s["sentence"]]


@pytest.mark.parametrize("seed", [0, 2, 7, 12])
@pytest.mark.parametrize("true", ["previous", "linear"])
@pytest.mark.thorough
def test_both_dead_times_are_told_where_the_record_cannot_tell(seed, true):
    answer = pf.fit(problem(recorded(seed, true)), seed=1)
    [look] = [look for look in answer.findings["data"] if look["kind"] == "hold"]
    assert look["figures"][true] == pytest.approx(DEAD, abs=0.6)
    assert look["figures"]["linear"] - look["figures"]["previous"] == pytest.approx(DT / 2, abs=0.5)
    [sentence] = told(answer)
    assert sentence.startswith("Td rests on how u goes on between its samples")
    assert 'hold = { u = "previous" } or hold = { u = "linear" }' in sentence


@pytest.mark.thorough
def test_a_long_record_with_little_noise_tells_straight_lines():
    [sentence] = told(pf.fit(problem(recorded(1, "linear", noise=1e-3, n=600, fine=40)), seed=1))
    assert "straight lines fit better" in sentence
    assert 'Write hold = { u = "linear" } under [model]' in sentence


def test_nothing_is_said_where_a_long_record_tells_that_the_input_is_held():
    assert told(pf.fit(problem(recorded(1, "previous", noise=1e-3, n=600, fine=40)), seed=1)) == []


@pytest.mark.thorough
def test_dead_times_of_several_recordings_share_one_sentence():
    records = {"first": recorded(7, "linear"), "second": recorded(12, "linear")}
    whole = problem(records["first"])
    own = {n: pf.Parameter(p.bounds, per_recording=n == "Td") for n, p in whole.space.parameters.items()}
    answer = pf.fit(pf.Problem(whole.model, records, own), seed=1)
    [sentence] = told(answer)
    assert sentence.startswith(("Td[first] rests on how u goes on", "Td[second] rests on how u goes on"))
    [look] = [look for look in answer.findings["data"] if look["kind"] == "hold"]
    assert look["figures"]["linear"] == pytest.approx(DEAD, abs=0.6)


@pytest.mark.thorough
def test_what_is_stated_is_believed():
    record = recorded(0, "linear")
    assert problem(record).holds_stated == frozenset()
    for hold in ("previous", "linear"):
        assert told(pf.fit(problem(record, {"u": hold}), seed=1)) == []


def without_dead_time(seed: int, hold: str, shift: int = 0) -> pf.Answer:
    """A lag of 60 s under an input recorded every 10 s, `shift` samples late, fitted as held."""
    record = recorded(seed, hold, n=600, fine=40, dead=0.0)
    u = record["u"]
    seen = np.concatenate([np.full(shift, u[0]), u[: len(u) - shift]])
    signals = {"u": Signal(seen, "V"), "y": record.signals["y"]}
    return pf.fit(problem(Recording(record.t, signals, "bench", ()), late=False), seed=1)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.thorough
def test_straight_lines_are_told_without_a_dead_time(seed):
    answer = without_dead_time(seed, "linear")
    [sentence] = told(answer)
    assert sentence.startswith("u is held between its samples, as nobody said how it goes on, and straight lines fit")
    assert "of what is left" in sentence
    assert 'Write hold = { u = "linear" } under [model]' in sentence
    [look] = [look for look in answer.findings["data"] if look["kind"] == "hold"]
    assert look["figures"]["noise"] < 1.1
    assert look["other"] == "T"
    assert look["figures"]["linear"] == pytest.approx(T, rel=0.01)
    tried = answer.diagnose()
    assert tried is not None
    assert tried["state"] == "left"
    assert [s["sentence"].partition(";")[0] for s in tried["verdict"]] == [
        "What may be missing was not tried, as straight lines between the samples of u leave hardly more than noise"
    ]


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(s, marks=pytest.mark.slow) for s in (2, 3))])
@pytest.mark.thorough
def test_no_straight_lines_are_told_of_a_held_input_nor_of_a_clock_that_is_late(seed):
    assert told(without_dead_time(seed, "previous")) == []
    for shift in (1, 3):
        assert told(without_dead_time(seed, "previous", shift)) == []


@pytest.mark.thorough
def test_beside_something_else_that_is_missing_straight_lines_come_first():
    record = recorded(1, "linear", n=600, fine=40, dead=0.0)
    y = record["y"] + 0.1
    both = Recording(record.t, {"u": record.signals["u"], "y": Signal(y, "K")}, "bench", ())
    answer = pf.fit(problem(both, late=False), seed=1)
    assert "straight lines fit better" in told(answer)[0]
    made = answer.diagnose()
    assert made is not None
    assert made["state"] != "left"
    assert made["next"] == ""
    last = made["verdict"][-1]["sentence"]
    assert last.startswith(
        "Straight lines between the samples of u fit better, and what is said of what may be missing"
    )


def driven_by(seed: int, linear: tuple[str, ...], stated: dict[str, str], n: int = 600, fine: int = 40) -> pf.Problem:
    """A lag of 60 s under three wandering inputs that are recorded every 10 s; those of `linear` go straight, the
    others jump."""
    rng = np.random.default_rng(seed)
    t, gains = np.arange(n) * DT, {"u": 2.0, "v": 1.0, "w": 1.5}
    inputs = {name: 0.3 * np.cumsum(rng.normal(size=n)) for name in gains}
    middle = (np.arange((n - 1) * fine) + 0.5) * DT / fine
    at = np.zeros(len(middle))
    for name, u in inputs.items():
        at += gains[name] * (np.interp(middle, t, u) if name in linear else u[np.floor(middle / DT).astype(int)])
    x = sum(gains[name] * u[0] for name, u in inputs.items())
    kept = [x]
    for k, v in enumerate(at):
        x += (v - x) * -np.expm1(-DT / fine / T)
        if (k + 1) % fine == 0:
            kept.append(x)
    y = np.array(kept) + 0.02 * rng.normal(size=n)
    signals = {name: Signal(u, "V") for name, u in inputs.items()} | {"y": Signal(y, "K")}
    model = pf.equations(
        "x' = (Ku*u + Kv*v + Kw*w - x)/T; y = x", states={"x": {"unit": "K", "initial": "y"}},
        inputs=dict.fromkeys(inputs, "V"), outputs={"y": "K"},
        parameters=dict.fromkeys(("Ku", "Kv", "Kw"), "K/V") | {"T": "s"},
    )  # fmt: skip
    own = dict.fromkeys(("Ku", "Kv", "Kw"), pf.Parameter((0.1, 10.0))) | {"T": pf.Parameter((5.0, 500.0))}
    return pf.Problem(model, {"bench": Recording(t, signals, "bench", ())}, own, hold=stated)


@pytest.mark.parametrize("stated", [{}, {"w": "previous"}], ids=["alone", "stated"])
@pytest.mark.thorough
def test_two_inputs_that_go_straight_are_written_in_one_line(stated):
    answer = pf.fit(driven_by(1, ("u", "v"), stated), seed=1)
    first, second = told(answer)
    assert first.startswith(
        "u is held between its samples, as nobody said how it goes on, and straight lines fit better"
    )
    assert "of what is left" in first
    assert second.startswith("v is held between its samples, as nobody said how it goes on, and straight lines fit")
    assert "fit better beside those of u (" in second
    assert "of what is then left" in second
    line = 'hold = { u = "linear", v = "linear"' + (', w = "previous" }' if stated else " }")
    assert f"Write {line} under [model]" in second
    assert "Write hold" not in first
    looks = [look for look in answer.findings["data"] if look["kind"] == "hold"]
    assert [look["write"] for look in looks] == [line, line]
    assert looks[0]["figures"]["noise"] > looks[1]["figures"]["noise"]
    assert looks[1]["figures"]["noise"] < 1.1
    tried = answer.diagnose()
    assert tried is not None
    assert [s["sentence"].partition(";")[0] for s in tried["verdict"]] == [
        "What may be missing was not tried, as straight lines between the samples of u and v leave hardly more than "
        "noise"
    ]
    mended = pf.fit(driven_by(1, ("u", "v"), {"u": "linear", "v": "linear", **stated}), seed=1)
    assert told(mended) == []
    assert all(test["white"] for test in mended.findings["residual_tests"])
    assert mended.values["T"] == pytest.approx(T, rel=0.01)


def test_nothing_is_told_of_two_inputs_that_are_held():
    assert told(pf.fit(driven_by(1, (), {}), seed=1)) == []
    [sentence] = told(pf.fit(driven_by(1, ("u",), {}), seed=1))
    assert 'Write hold = { u = "linear" } under [model]' in sentence


@pytest.mark.thorough
def test_nothing_is_said_without_a_dead_time_nor_of_an_input_that_jumps_nor_where_the_interval_holds_both():
    assert told(pf.fit(problem(recorded(0, "previous"), late=False), seed=1)) == []
    for seed in (0, 2):
        assert told(pf.fit(problem(recorded(seed, "previous", level=4)), seed=1)) == []
    noisy = pf.fit(problem(recorded(0, "previous", noise=1.0)), seed=1)
    assert told(noisy) == []
