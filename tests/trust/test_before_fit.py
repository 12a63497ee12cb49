"""What records can determine, before any fit: models whose rank is known by their construction."""

import numpy as np
import pytest

import plantfit as pf
from plantfit.trust import before_fit

N = 240
T = 0.05 * np.arange(N)
U = np.repeat(np.random.default_rng(0).uniform(-3, 3, N // 20), 20)


def problem(text, parameters, outputs=("y",), states=("x",), u=U, **options):
    model = pf.equations(
        text, inputs=["u"], states=list(states), outputs=list(outputs), parameters=list(parameters), name="plant"
    )
    rng = np.random.default_rng(1)
    record = pf.from_arrays(T, signals={"u": u, **{o: rng.normal(size=N) for o in outputs}})
    space = {n: v if isinstance(v, pf.Parameter) else pf.Parameter(v) for n, v in parameters.items()}
    return pf.Problem(model, record, space, scales=dict.fromkeys(outputs, 1.0), **options)


def told(found):
    return [sentence for _, sentence in found.sentences]


def test_a_lag_with_gain_and_offset_is_told_apart():
    found = before_fit(
        problem("x' = (K*delay(u, L) + r - x)/tau; y = x", {"K": (0.1, 5), "L": (0, 1), "r": (-3, 3), "tau": (0.1, 5)})
    )
    assert found is not None
    assert (found.rank, found.together, found.open, found.fix, found.unseen) == (4, (), (), (), ())
    assert (
        told(found)[0]
        == "These records can tell all 4 parameters apart (rank of the sensitivities at 8 random points of the bounds)."
    )
    assert not any(level == "warning" for level, _ in found.sentences)


@pytest.mark.parametrize(
    ("text", "names", "rank", "alone", "together", "fix"),
    [
        ("x' = a*b*u - x/c; y = x", "abc", 2, ("c",), ("a*b",), {("a",), ("b",)}),
        ("x' = a^2*b*u - x; y = x", "ab", 1, (), ("a^2*b",), {("a",), ("b",)}),
        ("x' = u - (a + b)*x; y = x", "ab", 1, (), ("a + b",), {("a",), ("b",)}),
        ("x' = a*b*u - x*c/d; y = x", "abcd", 2, (), ("a*b", "c/d"), {("a", "c"), ("a", "d"), ("b", "c"), ("b", "d")}),
        ("x' = u - (a + b*c)*x; y = x", "abc", 1, (), (), {("a", "b"), ("a", "c"), ("b", "c")}),
    ],
)
def test_what_stands_only_together_is_named(text, names, rank, alone, together, fix):
    found = before_fit(problem(text, dict.fromkeys(names, (0.2, 3.0))))
    assert found is not None
    assert (found.rank, found.alone, found.together, set(found.fix)) == (rank, alone, together, fix)
    assert found.sentences[0][0] == "warning"
    assert told(found)[0].startswith(f"These records can determine {rank} of {len(names)} at best")
    assert ("neither products of powers nor sums" in told(found)[0]) == (not together)


def test_a_motor_by_voltage_and_speed_has_two_open_scales():
    """Franklin's motor: resistance, inductance, torque constant and mechanical constants have two scales that the
    speed does not show."""
    text = "i' = (u - R*i - kb*w)/L; w' = (kt*i - c*w - tf*tanh(w/0.1))/J; y = w"
    bounds = {
        "R": (0.5, 5),
        "L": (0.02, 0.2),
        "kb": (0.05, 1),
        "kt": (0.05, 1),
        "J": (0.01, 0.1),
        "c": (0.01, 0.1),
        "tf": (0.01, 0.1),
    }
    found = before_fit(problem(text, bounds, states=("i", "w")))
    assert found is not None
    assert (found.rank, found.alone) == (5, ("kb",))
    assert set(found.together) == {"R/L", "J/c", "J/tf", "R*J/kt"}
    with_current = before_fit(problem(text + "; i_m = i", bounds, states=("i", "w"), outputs=("y", "i_m")))
    assert with_current is not None
    assert with_current.rank == 6  # the current gives R, L and kb; one scale of torque stays
    assert {"R", "L", "kb"} <= set(with_current.alone)


def test_a_parameter_without_effect_and_an_input_at_rest():
    found = before_fit(problem("x' = u - a*x + 0*b; y = x", {"a": (0.1, 5), "b": (0.1, 3)}))
    assert found is not None
    assert found.unseen == ("b",)
    assert told(found)[0].startswith("b has no effect on the fitted samples")
    found = before_fit(
        problem("x' = (K*u + r - x)/tau; y = x", {"K": (0.1, 5), "r": (1, 3), "tau": (0.1, 5)}, u=np.zeros(N))
    )
    assert found is not None
    assert found.unseen == ("K",)


LIMITED = "i = sat((u - kt*w)/R, -Imax, Imax); w' = (kt*i - b*w - {})/J; y = w"
DRIVE = {
    "R": (0.1, 10), "kt": pf.Parameter((0.005, 0.5), scale="log"), "J": pf.Parameter((1e-5, 1e-2), scale="log"),
    "b": (0, 1e-2), "Fc": (0, 0.2), "Imax": (0.3, 20),
}  # fmt: skip


@pytest.mark.parametrize("friction", ["Fc*tanh(w/0.5)", "friction(w, Fc)"])
@pytest.mark.parametrize("key", [0, 1, 2])
def test_a_limit_that_random_points_seldom_reach_is_looked_at(friction, key):
    found = before_fit(problem(LIMITED.format(friction), DRIVE, states=("w",), u=8.0 * U), key)
    assert found is not None
    assert (found.rank, found.alone, found.unseen) == (5, ("kt",), ())
    assert set(found.together) == {"R*J", "R*b", "R*Fc", "R*Imax"}
    assert set(found.fix) == {("R",), ("J",), ("b",), ("Fc",), ("Imax",)}
    assert found.varies
    assert told(found)[0].startswith(
        "Where they tell most of 8 random points of the bounds, the records can determine 5 of 6: kt, "
    )


@pytest.mark.parametrize("key", range(4))
def test_no_formula_rests_on_one_point(key):
    """Only with much torque and little friction it moves: the exponents of one such point are no law."""
    text, bounds = "w' = (kt*(u - kt*w)/R - b*w - friction(w, Fc))/J; y = w", {**DRIVE, "Fc": (0.05, 8)}
    del bounds["Imax"]
    found = before_fit(problem(text, bounds, states=("w",), u=8.0 * U), key)
    assert found is not None
    assert found.rank == 3
    assert set(found.together) == {"R*J/kt", "J/Fc"}
    assert "and 1 function of R, kt, J and 2 more that is neither a product of powers nor a sum" in told(found)[0]


def test_of_points_that_tell_too_seldom_no_formula_is_named(monkeypatch):
    """Without more points beside the one that moves: what it shows may be of that point alone."""
    monkeypatch.setattr("plantfit.trust.identify.before_fit.DRAWN", 1)
    text, bounds = "w' = (kt*(u - kt*w)/R - b*w - friction(w, Fc))/J; y = w", {**DRIVE, "Fc": (0.05, 8)}
    del bounds["Imax"]
    found = before_fit(problem(text, bounds, states=("w",), u=8.0 * U), 3)
    assert found is not None
    assert (found.rank, found.alone, found.together, found.agreed) == (3, (), (), False)
    assert "the records can determine 3 of 5. Too few of these points tell so much" in told(found)[0]


def test_a_plant_that_never_moves_is_told():
    text = "w' = (kt*u - friction(w, Fc))/J; y = w"
    bounds = {"kt": (0.1, 1), "Fc": (50, 60), "J": (1, 2)}
    found = before_fit(problem(text, bounds, states=("w",)))
    assert found is not None
    assert found.unseen == ("kt", "Fc", "J")
    assert told(found)[0].startswith("No parameter has any effect on the fitted samples at any of 8 random points")
    assert "Look at the bounds" in told(found)[0]


def tabled(text, over, nodes, y=None, u=U):
    """A plant with a table k over `over`, and the outputs y (N,) that were recorded."""
    tables = {"k": {"over": [over], "nodes": [list(map(float, nodes))]}}
    model = pf.equations(text, inputs=["u"], states=["x"], outputs=["y"], parameters=["K"], tables=tables, name="plant")
    record = pf.from_arrays(T, signals={"u": u, "y": np.zeros(N) if y is None else y})
    space = {"K": pf.Parameter((0.01, 0.1)), "k": pf.Parameter((0.5, 5.0))}
    return before_fit(pf.Problem(model, record, space, scales={"y": 1.0}))


@pytest.mark.parametrize("gain", [1.0, 2.0])
def test_entries_that_only_the_recordings_come_to_are_not_said_to_have_no_effect(gain):
    """Trial simulations stay below 1, the record goes to 7: of nodes at 0, 2, 4, 6, 8, 10 and 12 it touches five."""
    text = f"x' = K*u - k(x)*x; y = {'x' if gain == 1.0 else '2*x'}"
    found = tabled(text, "x", range(0, 14, 2), y=7.0 * np.sin(T) ** 2)
    assert found is not None
    assert not any("no effect" in s for s in told(found))
    if gain == 1.0:
        assert {n for n, seen in found.entries.items() if seen} == {"k[2]", "k[3]", "k[4]"}
        assert {n for n, seen in found.entries.items() if seen is False} == {"k[5]", "k[6]"}
        assert told(found)[0].startswith(
            "No simulation at 8 random points of the bounds comes to k[2], k[3] and k[4], and"
        )
        assert told(found)[1].startswith("No fitted sample comes to k[5] and k[6]: hold values, leave these nodes out")
    else:  # no output is the state as it is
        assert set(found.entries.values()) == {None}
        assert "What the table is over is not measured" in told(found)[0]


def test_entries_of_a_table_over_an_input_are_known_to_be_visited_or_not():
    found = tabled("x' = K*u - k(u)*x; y = x", "u", [-9.0, -6.0, -3.0, 0.0, 3.0, 6.0])
    assert found is not None
    assert found.entries == {"k[0]": False, "k[1]": False, "k[5]": False}
    # inputs come to these nodes, and the table acts on nothing
    found = tabled("x' = K*u - x + 0*k(u); y = x", "u", [-3.0, 0.0, 3.0])
    assert found is not None
    assert found.entries == {}
    assert told(found)[0].startswith("k[0], k[1] and k[2] have no effect on the fitted samples")
    found = tabled("x' = K*u - k(u)*x; y = x", "u", [-3.0, 0.0, 3.0])
    assert found is not None
    assert found.entries == {}
    assert not any("comes to" in s for s in told(found))


def holds_along(formula, names, values, direction, logs):
    """Whether a named formula changes along an open direction, by a step that is not small."""
    at = dict(zip(names, values, strict=True))
    moved = values * np.exp(0.3 * direction) if logs else values + 0.1 * direction
    before, after = (
        eval(formula.replace("^", "**"), {}, dict(zip(names, map(float, v), strict=True))) for v in (values, moved)
    )
    return after == pytest.approx(before, rel=1e-6), at


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.further(12)
def test_random_products(seed):
    """Three coefficients that are products of powers of six parameters: the rank is that of the exponents."""
    rng = np.random.default_rng(seed)
    names = list("abcdfg")
    powers = rng.choice([0, 0, 1, 1, -1, 2], (3, 6))
    theta = [
        "*".join(f"{n}^{p}" if p > 0 else f"{n}^(-{-p})" for n, p in zip(names, row, strict=True) if p) or "1"
        for row in powers
    ]
    found = before_fit(
        problem(
            f"x' = ({theta[0]})*u - ({theta[1]})*x + ({theta[2]})*u^2 + 0*({' + '.join(names)}); y = x",
            dict.fromkeys(names, (0.6, 1.5)),
        )
    )
    assert found is not None
    assert found.rank == np.linalg.matrix_rank(powers)
    used = [n for n, column in zip(names, powers.T, strict=True) if np.any(column)]
    assert set(found.unseen) == {*names} - {*used}
    assert len(found.alone) + len(found.together) == found.rank
    null = np.linalg.svd(powers.astype(float))[2][np.linalg.matrix_rank(powers) :]
    for formula in (*found.alone, *found.together):
        for direction in null:
            assert holds_along(formula, names, np.full(6, 1.1), direction, logs=True)[0], (formula, powers)


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.further(11)
def test_random_sums(seed):
    """Three coefficients that are sums of five parameters with whole weights: the rank is that of the weights."""
    rng = np.random.default_rng(100 + seed)
    names = list("abcdf")
    weights = rng.choice([0, 0, 1, 2, -1], (3, 5))
    theta = [" + ".join(f"({w})*{n}" for n, w in zip(names, row, strict=True) if w) or "1" for row in weights]
    found = before_fit(
        problem(
            f"x' = ({theta[0]})*u - 2*x + ({theta[1]})*u^2 + ({theta[2]}) + 0*({' + '.join(names)}); y = x",
            dict.fromkeys(names, (0.5, 2.0)),
        )
    )
    assert found is not None
    assert found.rank == np.linalg.matrix_rank(weights)
    null = np.linalg.svd(weights.astype(float))[2][np.linalg.matrix_rank(weights) :]
    for formula in found.together:
        for direction in null:
            assert holds_along(formula, names, np.linspace(0.8, 1.6, 5), direction, logs=False)[0], (formula, weights)


def test_noise_is_told_apart_from_structure():
    """A lag of hours in a record of 12 s is an integrator: gain and time constant are two in principle, and rough
    with any noise."""
    hours = pf.Parameter((1e4, 1e5), scale="log")
    found = before_fit(problem("x' = (K*u - x)/tau; y = x", {"K": (1e3, 1e4), "tau": hours}))
    assert found is not None
    assert found.rank == 2
    assert set(found.rough) == {"K", "tau"}
    assert "known only to more than 50 %" in told(found)[-1]


def test_what_is_too_large_is_not_asked():
    names = [f"p{k}" for k in range(41)]
    assert before_fit(problem(f"x' = u - x*({' + '.join(names)}); y = x", dict.fromkeys(names, (0.1, 1.0)))) is None


def test_the_same_bits_for_the_same_key():
    p = problem("x' = a*b*u - x/c; y = x", dict.fromkeys("abc", (0.2, 3.0)))
    assert before_fit(p) == before_fit(p)


def measured_rarely(text, parameters, samples, given=()):
    """A plant with output y at all samples and w at so many of them."""
    model = pf.equations(
        text, inputs=["u"], states=["x"], outputs=["y", "w"], parameters=list(parameters), name="plant"
    )
    rng = np.random.default_rng(2)
    w = np.full(N, np.nan)
    w[np.linspace(30, N - 10, samples).astype(int)] = 10.0 + rng.normal(size=samples)
    record = pf.from_arrays(T, signals={"u": U, "y": rng.normal(size=N), "w": w})
    scales = dict.fromkeys(given, 1.0)
    return pf.Problem(model, record, {n: pf.Parameter((0.2, 3.0)) for n in parameters}, scales=scales or None)


LAG = "x' = (K*u - x)/tau; y = x; "


@pytest.mark.parametrize(
    ("text", "own", "samples", "given", "heard"),
    [
        ("w = b*x + c", "bc", 2, (), ("K", "tau")),
        ("w = b*x + c", "bc", 2, ("w",), None),  # the user tells the errors
        ("w = b*x + c", "bc", 3, (), None),  # one more than the parameters that follow it
        ("w = b*x + c", "bc", 40, (), None),
        ("w = b*x", "b", 2, (), None),
        ("w = b*x", "b", 1, (), ("K", "tau")),
        ("w = b*x + c + d*x^2", "bcd", 3, (), ("K", "tau")),
        ("w = x", "", 2, (), None),  # y tells K and tau, and w nothing of its own
    ],
)
def test_an_output_whose_errors_nothing_shows_fixes_nothing(text, own, samples, given, heard):
    names = ["K", "tau", *own]
    found = before_fit(measured_rarely(LAG + text, names, samples, given))
    assert found is not None
    assert found.rank == len(names)
    if heard is None:
        assert found.silent == {}
        assert told(found)[0].startswith(f"These records can tell all {len(names)} parameters apart")
        return
    assert (found.silent, found.heard, found.heard_alone) == ({"w": samples}, 2, heard)
    assert found.sentences[0] == (
        "warning",
        f"w has {samples} fitted samples, no more than the parameters that follow them, "
        "and nothing shows how large its errors are. Unless the study gives a scale "
        f"for w, these records determine 2 of {len(names)} parameters at best: K, tau.",
    )
    assert told(found)[1].startswith(f"With a scale for w these records can tell all {len(names)} parameters apart")


@pytest.mark.parametrize(
    ("samples", "given", "few"), [(11, None, 0), (10, None, 10), (4, None, 4), (3, None, 3), (3, {"y": 0.1}, 0)]
)
def test_samples_that_are_too_few_for_a_fit_are_told(samples, given, few):
    model = pf.equations(
        "x' = (K*u + r - x)/tau; y = x", inputs=["u"], states=["x"], outputs=["y"], parameters=["K", "r", "tau"]
    )
    places = np.linspace(10, N - 1, samples).astype(int)
    y = np.full(N, np.nan)
    y[places] = np.random.default_rng(3).normal(size=samples)
    record = pf.from_arrays(T, signals={"u": U, "y": y})
    found = before_fit(
        pf.Problem(model, record, {n: pf.Parameter((0.2, 3.0)) for n in ("K", "r", "tau")}, scales=given)
    )
    assert found is not None
    assert found.few == few
    said = f"{samples} fitted samples are too few for 3 parameters: a fit will call none of them determined."
    assert (said in told(found)) is (few > 3)  # of 3 it is said in other words
    assert (found.silent == {"y": 3}) is (few == 3)
    assert ("determine none of 3 parameters." in told(found)[0]) is bool(found.silent)


def test_of_one_free_parameter_nothing_is_told_apart():
    found = before_fit(problem("x' = u - x/tau; y = x", {"tau": (0.1, 5)}))
    assert found is not None
    said = told(found)[0]
    assert said.startswith(
        "These records can tell the one free parameter (rank of the sensitivities at 8 random points"
    )
