"""Study files in the combinations that the data determine, on plants whose combinations are known."""

import numpy as np
import pytest

from plantfit import fit, spec
from plantfit.errors import SpecError

HEAD = """# a comment of the user
name = "plant"

[recording.data]
file = "data.csv"

[model]
"""


def record(folder, **columns):
    text = (
        ",".join(columns)
        + "\n"
        + "\n".join(",".join(f"{v:.12g}" for v in row) for row in zip(*columns.values(), strict=True))
    )
    (folder / "data.csv").write_text(text)


def parameters(**bounds):
    return "".join(
        f'[parameters.{n}]\nbounds = [{low}, {high}]\nunit = "{unit}"\n' for n, (low, high, unit) in bounds.items()
    )


def fitted(folder, text):
    study = spec.parse(text, folder / "plant.toml")
    return study, fit(study.problem, seed=study.plan.seed, budget=1000)


def statuses(answer):
    return {p["name"]: p["status"] for p in answer.findings["parameters"]}


def estimates(answer):
    return {
        p["name"]: (p["value"], p["low"], p["high"])
        for p in answer.findings["parameters"]
        if p["status"] == "determined"
    }


def lag(folder, noise=0.01):
    """x' = (K c u - x)/(R C), y = x + b1 + b2 with K c = 3, R C = 1.2 s, b1 + b2 = 0.8 V."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 20.0, 0.05)
    u = np.where(np.sin(0.9 * t) > 0, 1.0, -0.6)
    x = np.zeros_like(t)
    for k in range(len(t) - 1):
        x[k + 1] = 3.0 * u[k] + (x[k] - 3.0 * u[k]) * np.exp(-0.05 / 1.2)
    record(folder, t=t, u=u, y=x + 0.8 + noise * rng.standard_normal(len(t)))
    return f'''{HEAD}equations = """
x' = (K*u*c - x)/(R*C)
y = x + b1 + b2
"""
inputs = {{ u = "V" }}
states = {{ x = {{ unit = "V", initial = "x0*K" }} }}
outputs = {{ y = "V" }}
{parameters(K=(0.1, 50, "1"), c=(0.1, 50, "1"), R=(0.1, 50, "ohm"), C=(0.01, 5, "F"), b1=(-2, 2, "V"), b2=(-2, 2, "V"), x0=(-1, 1, "V"))}'''  # noqa: E501


def test_parameters_without_units_give_combinations_without_units(tmp_path):
    # in x' = K*c*u - x/R with u and x in V, K*c has 1/s that nobody wrote
    text = lag(tmp_path).replace("x' = (K*u*c - x)/(R*C)", "x' = K*u*c - x/R").replace("b1 + b2", "b")
    head = text[: text.index("[parameters.K]")].replace('"x0*K"', "0.0")
    bare = "".join(f"[parameters.{n}]\nbounds = [0.1, 50]\n" for n in ("K", "c", "R", "b"))
    study, before = fitted(tmp_path, head + bare)
    new = spec.in_combinations(study, before.findings)
    assert set(new.made.values()) == {"K*c"}
    assert "unit" not in new.text[new.text.index("[parameters.K_c]") :]
    after = fit(spec.parse(new.text, tmp_path / "combined.toml").problem, seed=1, budget=1000)
    assert after.best.cost == pytest.approx(before.best.cost, rel=1e-6)
    assert after.values["K_c"] == pytest.approx(3.0 / 1.2, rel=0.02)


@pytest.mark.thorough
def test_products_and_sums_become_parameters_and_hold_the_truth(tmp_path):
    study, before = fitted(tmp_path, lag(tmp_path))
    new = spec.in_combinations(study, before.findings)
    assert set(new.made.values()) == {"K*c", "R*C", "b1 + b2"}
    assert len(new.held) == 3
    assert not new.left
    assert new.text.startswith("# a comment of the user")
    _, after = fitted(tmp_path, new.text)
    found = estimates(after)
    for name, formula in new.made.items():
        value, low, high = found[name]
        assert low < {"K*c": 3.0, "R*C": 1.2, "b1 + b2": 0.8}[formula] < high
        (old,) = [c for c in before.findings["determined"]["combinations"] if c["formula"] == formula]
        assert value == pytest.approx(old["value"], abs=0.05 * old["standard_error"])
        assert (high - low) == pytest.approx(3.92 * old["standard_error"], rel=0.2)
    assert after.best.cost == pytest.approx(before.best.cost, rel=1e-6)
    units = {p["name"]: p["unit"] for p in after.findings["parameters"]}
    assert sorted(units[n] for n in new.made) == sorted(["1", "F*ohm", "V"])


def static(folder, equations, columns, outputs, bounds):
    record(folder, **columns)
    inputs = [n for n in columns if n.startswith("u")]
    return f'''{HEAD}equations = """{equations}"""
inputs = {inputs}
outputs = {outputs}
{parameters(**bounds)}'''.replace("'", '"').replace('file = "data.csv"', 'file = "data.csv"\nperiod = 1.0')


def inputs_and_noise(seed, n=200):
    rng = np.random.default_rng(seed)
    return (
        rng.uniform(0.5, 2.0, n),
        rng.uniform(0.5, 2.0, n),
        0.01 * rng.standard_normal(n),
        0.01 * rng.standard_normal(n),
    )


def test_combinations_that_share_a_parameter_are_solved_together(tmp_path):
    u, v, e1, e2 = inputs_and_noise(1)
    bounds = {n: (0.1, 30, "1") for n in "abc"}
    columns = {"u": u, "u2": v, "y1": 1.5 * 2.0 * u + e1, "y2": 2.0 * 0.7 * v + e2}
    text = static(tmp_path, "y1 = a*b*u\ny2 = b*c*u2", columns, ["y1", "y2"], bounds)
    study, before = fitted(tmp_path, text)
    new = spec.in_combinations(study, before.findings)
    assert len(new.made) == 2
    assert len(new.held) == 1
    _, after = fitted(tmp_path, new.text)
    assert [s for n, s in statuses(after).items() if n in new.made] == ["determined"] * 2
    truth = {"a": 1.5, "b": 2.0, "c": 0.7}
    for c in before.findings["determined"]["combinations"]:
        (name,) = [n for n, f in new.made.items() if f == c["formula"]]
        _, low, high = estimates(after)[name]
        assert low < np.prod([truth[n] ** w for n, w in c["weights"].items()]) < high


def test_a_power_is_taken_back(tmp_path):
    u, _, e, _ = inputs_and_noise(2)
    text = static(
        tmp_path, "y = m*l^2*u", {"u": u, "y": 0.8 * 1.5**2 * u + e}, ["y"], {"m": (0.1, 9, "kg"), "l": (0.1, 9, "m")}
    )
    study, before = fitted(tmp_path, text)
    new = spec.in_combinations(study, before.findings)
    _, after = fitted(tmp_path, new.text)
    assert statuses(after)[next(iter(new.made))] == "determined"
    assert after.best.cost == pytest.approx(before.best.cost, rel=1e-6)


@pytest.mark.parametrize("kind", ["negative", "units", "library"])
@pytest.mark.further(2)
def test_where_equations_cannot_hold_them_companions_are_held(tmp_path, kind):
    u, _, e, _ = inputs_and_noise(3)
    if kind == "negative":
        text = static(
            tmp_path, "y = a*b*u", {"u": u, "y": -3.0 * u + e}, ["y"], {"a": (-9, -0.1, "1"), "b": (0.1, 9, "1")}
        )
    elif kind == "units":
        text = static(
            tmp_path, "y = (a + 5*b)*u", {"u": u, "y": 3.0 * u + e}, ["y"], {"a": (0.1, 9, "V"), "b": (0.01, 9, "A")}
        ).replace("outputs", "check_units = false\noutputs")
    else:
        t = np.arange(0.0, 4.0, 0.01)
        volts = np.where(np.sin(3 * t) > 0, 6.0, -4.0)
        speed, tau, gain = np.zeros_like(t), 0.12, 9.0
        for k in range(len(t) - 1):
            speed[k + 1] = gain * volts[k] + (speed[k] - gain * volts[k]) * np.exp(-0.01 / tau)
        record(tmp_path, t=t, V=volts, w=speed + 0.2 * np.random.default_rng(4).standard_normal(len(t)))
        known = "".join(f"[parameters.{n}]\nvalue = {v}\n" for n, v in {"Kb": 0.05, "Lm": 1e-5, "Tf": 0.0}.items())
        text = f'{HEAD}kind = "dc_motor"\n{known}'
    study, before = fitted(tmp_path, text)
    new = spec.in_combinations(study, before.findings)
    assert new.held
    assert not new.made
    _, after = fitted(tmp_path, new.text)
    own = statuses(after)
    assert all(own[n] == "fixed" for n in new.held)
    named = {n for c in before.findings["determined"]["combinations"] for n in c["weights"]} - set(new.held)
    assert {own[n] for n in named} == {"determined"}
    assert after.best.cost == pytest.approx(before.best.cost, rel=1e-3)


def test_nothing_to_change_and_nothing_that_can_be_changed_are_said(tmp_path):
    u, _, e, _ = inputs_and_noise(6)
    study, answer = fitted(
        tmp_path, static(tmp_path, "y = a*u", {"u": u, "y": 2.0 * u + e}, ["y"], {"a": (0.1, 9, "1")})
    )
    with pytest.raises(SpecError, match="nothing has to be changed"):
        spec.in_combinations(study, answer.findings)
    bounds = {"a": (0.1, 9, "1"), "b": (0.1, 9, "1")}
    text = static(tmp_path, "y = a*b*c*u", {"u": u, "y": 2.0 * u + e}, ["y"], bounds) + '[parameters.c]\ntied = "a"\n'
    study, answer = fitted(tmp_path, text)
    with pytest.raises(SpecError, match="tied to a"):
        spec.in_combinations(study, answer.findings)
