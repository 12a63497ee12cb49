"""Ranges of parameters by feasibility: against closed forms, in boxes of several widths, with physical limits."""

from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from plantfit import Parameter, Problem, Recording, Signal, equations
from plantfit.errors import SpaceError
from plantfit.fitting import fit
from plantfit.trust.intervals.linearised import linearise

N = 200
X = np.linspace(0.1, 3.0, N)


def answer(text, truth, parameters, *, noise=0.01, seed=1, **options):
    """The fit of a static model to its own outputs with white noise; `truth` is the outputs' formula."""
    y = truth(X) + noise * np.random.default_rng(seed).normal(size=N)
    model = equations(text, inputs=["x"], outputs=["y"], parameters=list(parameters), name="curve")
    record = Recording(np.arange(N) * 1.0, {"x": Signal(X, None), "y": Signal(y, None)}, "run")
    return fit(Problem(model, record, parameters, **options), seed=seed)


def rows(found):
    return {row["name"]: row for row in found.findings["parameters"]}


def test_a_well_known_line_has_the_textbook_intervals():
    found = answer("y = a*x + b", lambda x: 2.0 * x + 1.0, {"a": Parameter((0.0, 5.0)), "b": Parameter((-5.0, 5.0))})
    matrix = np.column_stack([X, np.ones(N)])
    y = np.asarray(found.problem.experiments["run"].recording["y"])
    rest = y - matrix @ np.linalg.lstsq(matrix, y)[0]
    expected = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)) * (rest @ rest) / (N - 2))
    for name, error in zip("ab", expected, strict=True):
        row = rows(found)[name]
        assert row["status"] == "determined"
        assert row["standard_error"] == pytest.approx(error, rel=1e-6)
        # Student's t with 198 degrees of freedom
        assert row["high"] - row["value"] == pytest.approx(1.972 * error, rel=2e-3)
    assert found.findings["determined"]["count"] == 2


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("most", [5.0, 1e3])
def test_of_a_product_only_the_product_is_determined_in_any_box(scale, most):
    found = answer(
        "y = a*b*x",
        lambda x: 2.0 * x,
        {"a": Parameter((1e-3, most), scale=scale), "b": Parameter((1e-3, most), scale=scale)},
    )
    assert {rows(found)[n]["status"] for n in "ab"} == {"flat"}
    told = found.findings["determined"]
    assert (told["count"], told["of"]) == (1, 2)
    (one,) = told["combinations"]
    assert one["product"]
    assert set(one["formula"].split("*")) == {"a", "b"}
    assert one["value"] == pytest.approx(2.0, abs=4 * one["standard_error"])
    assert told["only_if"]["a"]["known"] == "b"
    assert "larger budget" not in found.verdict


def test_a_ratio_is_told_as_well_as_by_the_fit_in_which_its_divisor_is_known():
    """It is known to 0.035 % where each alone is open to any factor: by entries of their covariance that would be
    rounding."""
    t, rng = np.arange(N) * 0.02, np.random.default_rng(5)
    y = 3.0 * np.exp(-0.7 * t) + 1e-3 * rng.normal(size=N)
    record = Recording(t, {"y": Signal(y, None)}, "run")
    model = equations(
        "x' = -a*x/b\ny = x", states={"x": {"initial": "y"}}, outputs=["y"], parameters=["a", "b"], name="decay"
    )
    wide = Parameter((1e-3, 1e3), scale="log")
    errors = []
    for b in (wide, 2.0):
        found = fit(Problem(model, record, {"a": wide, "b": b}), seed=1)
        errors.append(rows(found)["a"]["standard_error"] if b == 2.0 else found.findings["determined"])
    both, (one,) = errors[0], errors[0]["combinations"]
    assert one["formula"] == "b/a"
    # to what the floor of variances differs by between directions and parameters
    assert one["standard_error"] / one["value"] == pytest.approx(errors[1] / 1.4, rel=0.1)
    known = both["only_if"]["a"]
    assert known["standard_error"] / known["value"] == pytest.approx(errors[1] / 1.4, rel=0.1)
    assert both["first_values"] is None


def test_of_a_sum_only_the_sum_is_determined():
    found = answer("y = (a + b)*x", lambda x: 2.0 * x, {"a": Parameter((-10.0, 10.0)), "b": Parameter((-10.0, 10.0))})
    assert {rows(found)[n]["status"] for n in "ab"} == {"flat"}
    assert rows(found)["a"]["open"] == "both"
    (one,) = found.findings["determined"]["combinations"]
    assert not one["product"]
    assert one["value"] == pytest.approx(2.0, abs=0.01)
    assert "the data allow any value" in found.verdict


def test_physical_limits_end_a_range_where_bounds_of_the_search_do_not():
    """a + b = 2: with both at least 0 neither is above 2; where they may be negative nothing ends them."""
    limited = answer("y = (a + b)*x", lambda x: 2.0 * x, {"a": Parameter((0.0, 10.0)), "b": Parameter((0.0, 10.0))})
    for name in "ab":
        row = rows(limited)[name]
        assert row["status"] != "determined"
        assert row["low"] == pytest.approx(0.0, abs=1e-6)
        assert row["high"] == pytest.approx(2.0, rel=0.15)
    free = Parameter((0.0, 10.0), limits=(-np.inf, np.inf))
    unlimited = answer("y = (a + b)*x", lambda x: 2.0 * x, {"a": free, "b": free})
    assert {rows(unlimited)[n]["status"] for n in "ab"} == {"flat"}


def test_what_a_parameter_on_a_bound_gauges_is_not_called_determined():
    """a b = 0.02 with b searched down to 0.05: b ends on its bound or a somewhere, and a is known only up to b."""
    found = answer(
        "y = a*(1 + b)*x", lambda x: 1.02 * x, {"a": Parameter((0.0, 10.0)), "b": Parameter((0.05, 5.0))}, noise=1e-3
    )
    assert rows(found)["a"]["status"] != "determined"


@pytest.mark.parametrize("width", [1.0, 1e6])
def test_the_status_does_not_depend_on_the_width_of_the_box(width):
    """An offset of 0 +- 0.005 is not told from zero in any box; against a typical size of 1 it is determined."""
    box = {"a": Parameter((0.0, 5.0)), "b": Parameter((-width, width))}
    found = answer("y = a*x + b", lambda x: 2.0 * x + 0.0, box, noise=0.05)
    assert rows(found)["b"]["status"] == "weak"
    assert "b cannot be told from zero" in found.verdict
    known = answer("y = a*x + b", lambda x: 2.0 * x, {**box, "b": Parameter((-width, width), typical=1.0)}, noise=0.05)
    assert rows(known)["b"]["status"] == "determined"


def test_an_end_is_followed_where_the_problem_is_curved():
    """y = exp(-k x) with little of the curve seen: the interval of k is that of a grid of costs, not a symmetric
    one."""
    box = {"k": Parameter((1e-4, 5.0), scale="log"), "c": Parameter((0.01, 1e4), scale="log")}
    found = answer("y = c*(1 - exp(-k*x))", lambda x: 10.0 * (1.0 - np.exp(-0.05 * x)), box, noise=0.01)
    row, y = rows(found)["k"], np.asarray(found.problem.experiments["run"].recording["y"])
    grid = np.geomspace(1e-4, 1.0, 4000)
    basis = 1.0 - np.exp(-grid[:, None] * X)
    squares = np.sum(y**2) - (basis @ y) ** 2 / np.sum(basis**2, axis=1)
    least = squares.min()
    inside = grid[squares - least <= 1.972**2 * least / (N - 2)]
    assert row["low"] == pytest.approx(inside[0], rel=0.15)
    assert row["high"] == pytest.approx(inside[-1], rel=0.15)


def test_limits_are_checked_and_have_defaults():
    from plantfit.errors import SpaceError
    from plantfit.space import Space

    def limits(p):
        return Space({"m": p}).coordinates[0].limits

    assert limits(Parameter((0.1, 2.0))) == (0.0, np.inf)
    assert limits(Parameter((-2.0, 0.0))) == (-np.inf, 0.0)
    assert limits(Parameter((-2.0, 1.0))) == (-np.inf, np.inf)
    assert limits(Parameter((0.2, 0.8), limits=(0.0, 1.0))) == (0.0, 1.0)
    with pytest.raises(SpaceError, match=r"'m' is searched from -1 to 2, beyond its physical limits \[0, inf\]"):
        limits(Parameter((-1.0, 2.0), limits=(0.0, np.inf)))
    with pytest.raises(SpaceError, match="typical = -1"):
        limits(Parameter((-1.0, 2.0), typical=-1.0))


def test_standard_errors_without_a_box():
    """The error of an offset that is hardly known is its own, not that of a box."""
    found = answer(
        "y = a*x + b", lambda x: 2.0 * x, {"a": Parameter((0.0, 5.0)), "b": Parameter((-1e-3, 1e-3))}, noise=0.05
    )
    local = linearise(found.problem, found.best.x)
    matrix = np.column_stack([X, np.ones(N)])
    expected = 0.05 * np.sqrt(np.linalg.inv(matrix.T @ matrix)[1, 1])
    assert local.standard_error[1] == pytest.approx(expected, rel=0.15)


def test_classical_and_robust_errors_are_an_option():
    """Noise with a correlation of 0.8 from row to row: robust errors are larger by about sqrt((1 + r) / (1 - r)) = 3
    for a mean."""
    noise = np.asarray(lfilter([0.6], [1.0, -0.8], np.random.default_rng(3).normal(size=N))) * 0.05
    box, errors = {"a": Parameter((0.0, 5.0)), "b": Parameter((-5.0, 5.0))}, {}
    for kind in (None, "classical", "robust"):
        found = answer("y = a*x + b", lambda x: 2.0 * x + 1.0 + noise, box, noise=0.0, standard_errors=kind)
        errors[kind] = rows(found)["b"]["standard_error"]
        assert found.findings["standard_errors"] == {
            "kind": kind or "classical",
            "in_time": False,
            "not_weighted": "",
            "estimator": None,
            "filterable": False,
        }
        assert ("do not allow for it" in found.verdict) == (kind != "robust")
    assert errors[None] == errors["classical"]
    assert errors["robust"] > 1.7 * errors["classical"]
    with pytest.raises(SpaceError, match="standard_errors = 'plain'; give 'robust' or 'classical'"):
        answer("y = a*x + b", lambda x: x, box, standard_errors="plain")


@pytest.mark.parametrize(("text", "n"), [("y = a*x + b", 3), ("y = a*x + b", 2), ("y = a*x", 40)])
def test_few_rows_and_outputs_that_are_all_zero_have_a_verdict(text, n):
    model = equations(text, inputs=["x"], outputs=["y"], parameters=["a", "b"] if "b" in text else ["a"], name="curve")
    record = Recording(np.arange(n) * 1.0, {"x": Signal(X[:n], None), "y": Signal(np.zeros(n), None)}, "run")
    found = fit(Problem(model, record, {p.name: Parameter((0.0, 5.0)) for p in model.parameters}))
    assert "determine" not in found.verdict or n > 3
    assert found.findings["parameters"][0]["value"] == pytest.approx(0.0, abs=1e-6)


def test_a_plant_at_rest_has_a_verdict():
    """Outputs of a dynamic model that are all zero: nothing is known, and nothing crashes."""
    t = np.arange(100) * 0.1
    model = equations(
        "x' = a*u - b*x\ny = x", inputs=["u"], states=["x"], outputs=["y"], parameters=["a", "b"], name="lag"
    )
    record = Recording(t, {"u": Signal(np.ones(100), None), "y": Signal(np.zeros(100), None)}, "run")
    found = fit(Problem(model, record, {"a": Parameter((0.0, 5.0)), "b": Parameter((0.1, 5.0), scale="log")}))
    assert rows(found)["b"]["status"] != "determined"


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("known", [False, True])
def test_a_bound_of_the_search_on_a_partner_ends_no_range(known, seed):
    """p/q and p/r are all that y shows. One of them leaves its bounds first when all three grow or shrink: that is
    no end of the others."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0.5, 2.0, (2, 200))
    y = 5e-5 * u / 1.2e-4 + 5e-5 * v / 0.02 + 1e-3 * rng.standard_normal(200)
    boxes = {"p": (1e-6, 1e-3), "q": (1e-6, 1e-2), "r": (1e-3, 1.0)}
    parameters: dict[str, Any] = {n: {"bounds": b, "scale": "log", "unit": "1"} for n, b in boxes.items()}
    if known:
        parameters["q"] = {"value": 1.2e-4, "unit": "1"}
    model = equations("y = p*u/q + p*v/r", inputs=["u", "v"], outputs=["y"], parameters=parameters, check=False)
    record = Recording(np.arange(200) * 1.0, {"u": Signal(u), "v": Signal(v), "y": Signal(y)}, "run")
    found = fit(Problem(model, record), seed=seed)
    told = " ".join(s["sentence"] for s in found.findings["verdict"])
    for name in set(boxes) - ({"q"} if known else set()):
        assert (f"{name} is not determined: the data allow any value above 0" in told) == (not known)
        assert (rows(found)[name]["status"] == "determined") == known


@pytest.mark.parametrize("divides", [True, False])
def test_a_divisor_on_a_bound_of_the_search_ends_no_range(divides):
    """q may be as small as it likes: p/q then goes on below what q's bound allows. With p - q, p ends where q is
    nothing."""
    x = np.linspace(0.1, 2.0, 200)
    y = 2.0 * x + 1e-2 * np.random.default_rng(3).standard_normal(200)
    boxes = {"p": (1e-4, 10.0), "q": (0.05, 10.0)} if divides else {"p": (1e-2, 10.0), "q": (1e-2, 10.0)}
    parameters = {n: Parameter(b, scale="log") for n, b in boxes.items()}
    model = equations(
        "y = p/q*x" if divides else "y = (p - q)*x", inputs=["x"], outputs=["y"], parameters=list(boxes), check=False
    )
    found = rows(
        fit(
            Problem(model, Recording(0.1 * np.arange(200), {"x": Signal(x), "y": Signal(y)}, "run"), parameters), seed=1
        )
    )["p"]
    assert found["low"] == pytest.approx(0.0 if divides else 2.0, rel=5e-3)


@pytest.mark.parametrize("spread", [40.0, 80.0, 120.0])
def test_a_wide_range_does_not_end_where_it_is_no_longer_followed(spread):
    """Ranges are followed to -5 and 5 here; beyond, the growth says how they go on."""
    noise = np.random.default_rng(1).standard_normal(N)
    noise = 1e-4 * spread * (noise - X * (X @ noise) / (X @ X))  # the fit finds the truth
    found = rows(
        answer("y = exp(1e-4*a*x)", lambda x: np.exp(1e-4 * 0.2 * x) + noise, {"a": Parameter((-1.0, 1.0))}, noise=0.0)
    )["a"]
    half = 1.96 * np.linalg.norm(noise) * 1e4 / np.sqrt(N - 1) / np.linalg.norm(X)
    assert [found["low"], found["high"]] == pytest.approx([0.2 - half, 0.2 + half], abs=0.03 * half)


FAMILIES = {  # all parameters may grow or shrink together: bounds of the search must end no range
    "quotients": ("y = p*u/(q + r*v) + s*w/(r*v + q)", {"p": 0.3, "q": 0.05, "r": 2.0, "s": 0.7}),
    "mixed": ("y = p*u/r + q*v/(r + s*w)", {"p": 0.3, "q": 0.05, "r": 2.0, "s": 0.7}),
    "powers": ("y = a*b^2*u/c", {"a": 2.0, "b": 3.0, "c": 1.0}),
}


def scaled_fit(text, truth, seed, box):
    """The fit of static equations with one percent of noise, bounds `box` times around values some way off the
    truth."""
    rng = np.random.default_rng(seed)
    inputs = {name: rng.uniform(0.5, 2.0, 200) for name in "uvw" if name in text}
    y = eval(text.removeprefix("y = ").replace("^", "**"), {}, {**inputs, **truth})
    y = y + 0.01 * np.std(y) * rng.standard_normal(200)
    parameters = {n: Parameter((v / box * np.exp(0.5 * rng.normal()), v * box), scale="log") for n, v in truth.items()}
    model = equations(text, inputs=list(inputs), outputs=["y"], parameters=list(truth), check=False)
    signals = {**{n: Signal(v) for n, v in inputs.items()}, "y": Signal(y)}
    return fit(Problem(model, Recording(np.arange(200) * 1.0, signals, "run"), parameters), seed=seed)


@pytest.mark.parametrize("box", [3.0, 20.0])
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("family", list(FAMILIES))
@pytest.mark.further(8)
def test_what_scales_together_has_no_ends(family, seed, box):
    for row in rows(scaled_fit(*FAMILIES[family], seed, box)).values():
        assert (row["status"], row["low"], row["open"]) == ("flat", 0.0, "upper")


@pytest.mark.parametrize("box", [3.0, 20.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_sums_that_share_a_term_end_where_physics_ends_them(seed, box):
    """a + b = 5 and b + c = 4 with nothing below 0: a is 1 to 5, b and c are 0 to 4, whatever the bounds."""
    found = rows(scaled_fit("y = (a + b)*u + (b + c)*v", {"a": 2.0, "b": 3.0, "c": 1.0}, seed, box))
    for name, low, high in (("a", 1.0, 5.0), ("b", 0.0, 4.0), ("c", 0.0, 4.0)):
        assert found[name]["low"] == pytest.approx(low, abs=0.03)
        assert found[name]["high"] == pytest.approx(high, rel=0.15)  # as near as a cliff is looked for


@pytest.mark.parametrize("box", [3.0, 20.0])
def test_what_is_known_is_known_in_any_box(box):
    found = rows(scaled_fit("y = a*u/(b + u) + c", {"a": 2.0, "b": 3.0, "c": 1.0}, 3, box))
    assert [found[n]["status"] for n in ("a", "b", "c")] == ["determined"] * 3
