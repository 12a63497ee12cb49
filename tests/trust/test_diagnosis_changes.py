"""Parameters that change with an input, a state or time, cross-terms of inputs, and friction that falls with speed:
named with their sizes.

Truths are simulated elsewhere (benchmarks/diagnosis.py; scipy for the room below), and never are the values at which a
fit begins.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).parents[2]))  # benchmarks are beside the package

from benchmarks.diagnosis import PLANTS, write

from plantfit.fitting import fit
from plantfit.models import equations
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.spec import load, with_additions
from plantfit.trust.diagnosis import changed, diagnose, diagnosis_record
from plantfit.trust.diagnosis.catalogue import MOST_PAIRS, inside_kinds
from plantfit.trust.diagnosis.plant.carrier import Carrier
from plantfit.trust.diagnosis.plant.hypothesis import evaluate, fitted
from plantfit.trust.diagnosis.plant.sizes import round_number
from plantfit.trust.diagnosis.rounds import CHANGES, promising


def answered(problem):
    return fit(problem, budget=1000)


@pytest.mark.parametrize(
    ("plant", "fault"),
    [
        ("first", "change K with u"),
        pytest.param("first", "change tau with t", marks=pytest.mark.slow),
        pytest.param("second", "change k with x", marks=pytest.mark.slow),
        ("tanks", "change a2 with t"),
    ],
)
@pytest.mark.thorough
def test_what_changes_is_named_with_its_size_and_the_file_runs(plant, fault, tmp_path):
    made = PLANTS[plant]
    place = write(made, fault, 0.01, 21, tmp_path)
    study = load(place)
    answer = answered(study.problem)
    d = diagnose(answer.problem, answer.best.x)
    kind, _, pair = fault.partition(" ")
    first = d.rounds[0].found
    assert [(t.extension.kind, t.extension.signal) for t in first] == [(kind, pair)]
    name = pair.replace(" ", "_")
    reference = d.carrier.values[f"reference_{name}"]
    # the relative slope at another reference: c / (1 + c (r - r0))
    own = made.faults[fault]
    size = own / (1.0 + own * (reference - made.references.get(pair.split(" ")[-1], 0.0)))
    value, error = first[0].value, first[0].standard_error
    assert value is not None
    assert error is not None
    assert abs(value - size) < 4 * error + 0.03 * abs(size)
    record = diagnosis_record(d)
    assert f"A relative change of {pair} by" in record["verdict"][0]["sentence"]
    assert "very likely missing" in record["verdict"][0]["sentence"]
    assert f'change = {{ "{pair}" = [' in record["write"][1]
    (tmp_path / "new.toml").write_text(with_additions(study.text, study.path, changed(d)))
    problem = load(tmp_path / "new.toml").problem
    assert f"change_{name}" in problem.space.names
    assert f"reference_{name}" not in problem.space.names
    end = fit(problem, budget=2000)
    noise = float(np.sqrt(np.mean(d.end.residuals[d.carrier.rows.fit] ** 2)))
    assert np.sqrt(end.best.cost) == pytest.approx(noise, rel=0.02)
    assert end.values[f"change_{name}"] == pytest.approx(value, abs=2 * error)


def room(seed, cross, noise=0.1):
    """A room heated by u and cooled by v; with `cross` the heater does less where v is more. Temperatures above that
    outside."""
    rng, n, h = np.random.default_rng(seed), 400, 4.0
    t, x = np.arange(n) * h, np.zeros(n)
    u, v = np.repeat(rng.uniform(0, 10, n // 10), 10), np.repeat(rng.uniform(0, 5, n // 16), 16)
    for k in range(n - 1):
        gain = 3.0 * (1.0 + cross * (v[k] - 2.5))
        steady = gain * u[k] - 2.0 * v[k]
        x[k + 1] = solve_ivp(lambda s, y, steady=steady: (steady - y) / 40.0, (0.0, h), [x[k]], rtol=1e-9, atol=1e-9).y[
            0, -1
        ]
    measured = x + noise * rng.standard_normal(n)
    record = Recording(t, {"u": Signal(u, "V"), "v": Signal(v, "V"), "T": Signal(measured, "K")}, "a")
    model = equations(
        "x' = (K1*u + K2*v - x)/tau; T = x", inputs={"u": "V", "v": "V"}, states={"x": {"unit": "K", "initial": 0.0}},
        outputs={"T": "K"},
        parameters={
            "K1": {"bounds": (0.1, 100.0), "unit": "K/V", "scale": "log"},
            "K2": {"bounds": (-100.0, 0.0), "unit": "K/V"},
            "tau": {"bounds": (1.0, 1000.0), "unit": "s", "scale": "log"},
        },
    )  # fmt: skip
    return Problem(model, record, split=0.7)


@pytest.mark.thorough
def test_a_cross_term_of_two_inputs_is_named_by_all_its_names():
    """Through either gain or either input it is one and the same, which the sentence says."""
    answer = answered(room(4, -0.06))
    d = diagnose(answer.problem, answer.best.x)
    assert {t.extension.signal for t in d.rounds[0].found} == {"K1 with v", "K2 with u", "u with v", "v with u"}
    first = d.rounds[0].found[0]
    assert first.standard_error is not None
    reference = d.carrier.values["reference_K1_with_v"]
    assert first.extension.signal == "K1 with v"
    assert first.value == pytest.approx(-0.06 / (1.0 - 0.06 * (reference - 2.5)), abs=4 * first.standard_error)
    said = diagnosis_record(d)["verdict"][0]["sentence"]
    assert (
        "a change of K2 with u, a change of u with v and a change of v with u explain it as well: one of them is"
        in said
    )
    assert "this record cannot tell which" in said


@pytest.mark.parametrize("seed", [4, 5, 6])
@pytest.mark.further(1)
def test_two_inputs_without_a_cross_term_have_none(seed):
    answer = answered(room(seed, 0.0))
    assert not diagnose(answer.problem, answer.best.x).found


@pytest.mark.slow
def test_dry_friction_and_its_fall_with_speed_are_both_named(tmp_path):
    """A motor with the whole Stribeck curve: 100 at speed, 200 rad/s^2 at breakaway, falling within 6 rad/s; noise
    of 2 %."""
    answer = answered(load(write(PLANTS["motor"], "coulomb+stribeck", 0.02, 7, tmp_path)).problem)
    d = diagnose(answer.problem, answer.best.x)
    assert {t.extension.kind for t in d.found} == {"coulomb", "stribeck"}
    values = d.answer_values()
    assert values["coulomb_w"] == pytest.approx(100.0, rel=0.1)
    assert values["stribeck_w"] == pytest.approx(100.0, rel=0.2)
    assert values["stribeck_speed_w"] == pytest.approx(6.0, rel=0.3)
    named = [n for r in diagnosis_record(d)["rounds"] for n in r["found"]]
    assert len(named) == len(set(named))  # what a later round finds does not stand for an earlier one
    lines = diagnosis_record(d)["write"]
    assert lines.count("[parameters.creep_w]") == 1
    assert any(line.startswith("[parameters.stribeck_speed_w]") for line in lines)


@pytest.mark.thorough
def test_derivatives_by_changes_are_exact_and_the_core_leaves_them_out(tmp_path):
    problem = load(write(PLANTS["second"], "clean", 0.01, 3, tmp_path)).problem
    carrier = Carrier.of(problem, np.full(3, 0.5), inside_kinds(problem))
    x, step = carrier.x, 1e-6
    _, jacobian = evaluate(carrier, (), x, np.zeros(0), changes=True)
    _, core = evaluate(carrier, (), x, np.zeros(0))
    assert carrier.core is not None
    assert carrier.charge(False) < carrier.charge(True)
    pairs = {n: k for k, n in enumerate(carrier.names) if n.startswith("change_")}
    assert len(pairs) == 12
    for n, k in enumerate(carrier.names):
        if k in pairs:
            assert not core[:, n].any()
    for name in ("change_k_with_x", "change_m_with_t", "change_b_with_u"):
        k = pairs[name]
        ends = []
        for sign in (1, -1):
            moved = x.copy()
            moved[k] += sign * step
            ends.append(evaluate(carrier, (), moved, np.zeros(0), changes=True)[0])
        numeric = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(jacobian[:, k], numeric, atol=1e-5 * np.abs(numeric).max())
    others = [k for k in range(len(carrier.names)) if k not in pairs.values()]
    np.testing.assert_allclose(core[:, others], jacobian[:, others], rtol=1e-9, atol=1e-12)


@pytest.mark.thorough
def test_of_many_changes_the_best_by_their_derivatives_are_tried(tmp_path):
    """What a straight line explains is what least squares with that column explains; the planted one is among the
    best."""
    problem = load(write(PLANTS["second"], "change k with t", 0.01, 2, tmp_path)).problem
    answer = answered(problem)
    carrier = Carrier.of(answer.problem, answer.best.x, inside_kinds(answer.problem))
    use = carrier.rows.fit
    base = fitted(carrier, (), carrier.x, np.zeros(0), use)
    from plantfit.trust.diagnosis.catalogue import catalogue

    extensions = catalogue(answer.problem, carrier.rows)
    chosen, others = promising(carrier, base, extensions, use)
    changes = [e for e in chosen if e.kind == "change"]
    assert len(changes) == CHANGES
    assert "k with t" in [e.signal for e in changes]
    assert len(changes) + len(others) == 12
    assert [e.kind for e in extensions][-12:] == ["change"] * 12  # last among equals
    r, jacobian = evaluate(carrier, (), base.x, np.zeros(0), changes=True)
    for e, share in others.items():
        a = np.column_stack([jacobian[use, : carrier.own], jacobian[use, carrier.names.index(e.parameter)]])
        norms = np.linalg.norm(a, axis=0)
        left = r[use] - a / norms @ np.linalg.lstsq(a / norms, r[use], rcond=None)[0]
        without = r[use] - a[:, :-1] @ np.linalg.lstsq(a[:, :-1], r[use], rcond=None)[0]
        assert share == pytest.approx((without @ without - left @ left) / (r[use] @ r[use]), abs=1e-6)


def test_parameters_that_may_not_change_and_too_many_pairs(tmp_path):
    plant = PLANTS["first"]
    text = plant.study.replace(
        "[parameters]", 'extensions = { dead_time = { u = [0, 1] }, change = { "K with t" = [-1, 1] } }\n[parameters]'
    )
    text += "reference_K_with_t = { value = 0 }\n"
    problem = load(write(replace(plant, study=text), "clean", 0.01, 0, tmp_path)).problem
    pairs = inside_kinds(problem)["change"]
    # no dead time, no change twice
    assert set(pairs) == {"K with u", "K with x", "tau with u", "tau with t", "tau with x"}
    many = [f"p{k}" for k in range(30)]
    model = equations(
        f"x' = ({' + '.join(many)})*u - x; y = x", inputs={"u": "V"}, states={"x": {"unit": "K", "initial": 0.0}},
        outputs={"y": "K"},
        parameters={p: {"bounds": (0.0, 1.0)} for p in many}, check=False,
    )  # fmt: skip
    t = np.arange(40) * 0.1
    record = Recording(t, {"u": Signal(np.sin(t), "V"), "y": Signal(t, "K")}, "a")
    assert len(inside_kinds(Problem(model, record))["change"]) == MOST_PAIRS


@pytest.mark.parametrize(
    ("value", "deviation", "number"),
    [(0.47, 1.4, 0.0), (3.6, 0.9, 3.6), (293.42, 5.0, 293.0), (1234.0, 160.0, 1200.0), (0.0, 1e-9, 0.0)],
)
@pytest.mark.thorough
def test_references_are_round_numbers_within_half_a_step(value, deviation, number):
    found = round_number(value, deviation)
    assert found == pytest.approx(number)
    assert abs(found - value) <= 0.5 * deviation + 1e-12
