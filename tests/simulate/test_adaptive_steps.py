"""Steps as long as their error allows: what they reach, what they cost, and what does not depend on whom."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg

import plantfit as pf
from plantfit.errors import SimulationError
from plantfit.problem.accuracy.steps import choose_substeps, finer_at, refined_at, steps_for
from plantfit.simulate.check.tight import follow
from plantfit.simulate.simulator import ADAPTIVE, Simulator
from plantfit.simulate.steps import adaptive as steps

import jax
import jax.numpy as jnp

T = np.arange(400) * 0.05
U = 3.0 * np.sin(0.9 * T) * np.sign(np.sin(0.31 * T + 0.2))
PERIOD = 0.8  # s, in which there is more than one step
PENDULUM = "a' = w\nw' = (u - c*w)/m - g*sin(a)\ny = a"
RUBBED = "w' = (u - b*w - F*tanh(w/0.001))/m\ny = w"
OWN = {"g": (1.0, 20.0), "c": (0.01, 1.0), "m": (0.5, 2.0)}
RUBBING = {"b": (0.1, 2.0), "F": (0.2, 2.0), "m": (0.005, 0.1)}
TRUTH = {"b": 0.7, "F": 0.9, "m": 0.03}


def problem_of(text, free, *, t=T, u=U, y=None, **options):
    states = [line.split("'")[0] for line in text.split("\n") if "'" in line]
    model = pf.equations(text, inputs=["u"], states=states, outputs=["y"], parameters=dict.fromkeys(free), name="plant")
    record = pf.from_arrays({"t": t, "u": u, "y": np.zeros(len(t)) if y is None else y}, time="t")
    return pf.Problem(model, record, {n: pf.Parameter(b, scale="log") for n, b in free.items()}, **options)


def sampled_coarsely(noise=0.0):
    """Friction that sticks within 1 mm/s, samples of half a second, and the exact speed; with noise also as what was
    measured."""
    t, rng = np.arange(300) * 0.5, np.random.default_rng(6)
    u = rng.uniform(-3, 3, 300)
    problem = problem_of(RUBBED, RUBBING, t=t, u=u)
    followed = follow(
        problem.predictor.stepping(),
        {k: np.asarray(v) for k, v in TRUTH.items()},
        next(iter(problem.whole_drives.values())),
    )
    assert followed.stopped is None
    exact = followed.outputs["y"]
    return problem_of(
        RUBBED, RUBBING, t=t, u=u, y=exact + noise * rng.standard_normal(300)
    ) if noise else problem, exact


def adaptively(problem, fineness=1):
    own = problem.predictor.stepping()
    return problem.with_simulator(Simulator(own.vector, ADAPTIVE, fineness, own.interpolated))


def errors(problem, values, fineness):
    """rms error of y for each fineness, against scipy at a relative tolerance of 1e-9."""
    p, drive = {k: np.asarray(float(v)) for k, v in values.items()}, next(iter(problem.whole_drives.values()))
    tight = follow(problem.predictor.stepping(), p, drive)
    assert tight.stopped is None
    found = []
    for k in fineness:
        simulator = adaptively(problem, k).predictor.stepping()
        ours = jax.jit(lambda p, s=simulator: s.outputs(p, drive)["y"])(p)
        found.append(float(np.sqrt(np.mean((np.asarray(ours) - tight.outputs["y"]) ** 2))))
    return found


@pytest.mark.parametrize("hold", ["previous", pytest.param("linear", marks=pytest.mark.slow)])
def test_twice_the_fineness_is_about_a_quarter_of_the_error(hold):
    """Three states, whose exponentials are rational functions: the voltage of the pendulum's drive comes late."""
    t = np.arange(40) * PERIOD
    late = PENDULUM.replace("(u -", "(v -").replace("\ny", "\nv' = (u - v)/0.3\ny")
    problem = problem_of(late, OWN, t=t, u=2.0 * np.sin(0.4 * t), hold={"u": hold})
    found = errors(problem, {"g": 9.8, "c": 0.2, "m": 1.3}, (2, 4, 8, 16))
    assert found[-1] < 2e-4
    for coarse, fine in pairwise(found):
        assert 2.5 < coarse / fine < 9.0


@pytest.mark.parametrize("hold", [pytest.param("previous", marks=pytest.mark.slow), "linear"])
def test_two_states_follow_their_linear_part_exactly(hold):
    t = np.arange(40) * PERIOD
    u, truth = 2.0 * np.sin(0.4 * t), {"g": 9.8, "c": 0.2, "m": 1.3}
    linear = problem_of(PENDULUM.replace("sin(a)", "a"), OWN, t=t, u=u, hold={"u": hold})
    assert errors(linear, truth, (1,))[0] < 1e-8  # samples are a third of an oscillation apart
    turning = errors(problem_of(PENDULUM, OWN, t=t, u=u, hold={"u": hold}), truth, (1, 4, 32))
    assert turning[0] < 2e-3
    assert turning[2] < 1e-6


@pytest.mark.parametrize("text", [PENDULUM, "a' = u - a - g*a^3/m - c*a^2\ny = a"])
def test_the_pair_has_order_three(text):
    problem, z = problem_of(text, OWN), np.array([9.8, 0.2, 1.3])
    vector = problem.predictor.stepping().vector
    p = tuple(float(dict(zip(problem.space.names, z, strict=True))[n]) for n in vector.parameters)

    def end(step, parts):
        x = (0.3, 0.4)[: len(vector.states)]
        for _ in range(parts):
            x = tuple(map(float, step(tuple(x), 0.7, 1.0 / parts, p)[0]))
        return np.array(x)

    # exponential functions, of an error that rational ones do not reach, and rational ones
    for step, parts in zip(pair_of(vector, 1000), ((4, 8, 16), (16, 32, 64)), strict=True):
        found = [np.max(np.abs(end(step, k) - end(step, 1024))) for k in parts]
        for coarse, fine in pairwise(found):
            assert 6.0 < coarse / fine < 11.0


@pytest.mark.parametrize("text", ["x' = v\nv' = (k*u - x - a*v)/b\ny = x", "x' = (k*u - x - a*x^3)/b\ny = x"])
def test_what_rounding_leaves_at_rest_asks_for_no_steps(text):
    """Of 200 plants at rest, with time constants from 0.1 ms to 1000 s, all intervals are good in one step; moved by
    a tenth, few are."""
    rng = np.random.default_rng(1)
    problem = problem_of(text, {"k": (0.1, 1.5), "a": (0.1, 160.0), "b": (1e-3, 160.0)})
    vector = problem.predictor.stepping().vector
    at_once, n = pair_of(vector, 12)[1], len(vector.states)
    good = []
    for _ in range(200):
        free = {"k": rng.uniform(0.1, 1.5), "a": 10 ** rng.uniform(-1, 2.2), "b": 10 ** rng.uniform(-3, 2.2)}
        p, u = tuple(free[name] for name in vector.parameters), rng.uniform(10.0, 100.0)
        x = (free["k"] * u, 0.0)[:n]
        for _ in range(60):
            x = tuple(map(float, at_once(x, u, 100.0, p)[0]))
        good.append((bool(at_once(x, u, 0.1, p)[1]), bool(at_once((1.1 * x[0], *x[1:]), u, 0.1, p)[1])))
    rest, moved = np.mean(good, axis=0)
    assert rest == 1.0
    assert moved < 0.7


@pytest.mark.parametrize("count", [pytest.param(2, marks=pytest.mark.slow), pytest.param(6, marks=pytest.mark.slow), 4])
@pytest.mark.thorough
def test_derivatives_run_in_native_loops_whatever_the_number_of_states(count, monkeypatch):
    """As XLA's loops they took 10 s for an interval: all the trials that an interval may have are worked off there."""

    def refused(*_, **__):
        raise AssertionError("not native")

    for place in ("plantfit.native.scan.scan_used", "plantfit.native.primitive._scan"):
        monkeypatch.setattr(place, refused)
    chain = [f"x{i}' = ({'u' if i == 0 else f'x{i - 1}'} - x{i} - a*x{i}^3)/b" for i in range(count)]
    problem = problem_of(
        "\n".join([*chain, f"y = x{count - 1}"]), {"a": (0.1, 2.0), "b": (0.1, 2.0)}, t=T[:20] * 6, u=U[:20]
    )
    costs, gradients = adaptively(problem, 4).values_and_gradients(np.random.default_rng(0).random((3, 2)))
    assert np.all(np.isfinite(np.asarray(costs)))
    assert np.all(np.isfinite(np.asarray(gradients)))


def phi_of(z, k):
    """phi_k(Z) from the exponential of a matrix twice to four times as large."""
    n = len(z)
    large = np.zeros((n * (k + 1), n * (k + 1)))
    large[:n, :n] = z
    for j in range(k):
        large[j * n : (j + 1) * n, (j + 1) * n : (j + 2) * n] = np.eye(n)
    return scipy.linalg.expm(large)[:n, k * n :]


@pytest.mark.parametrize("n", [1, 2])
def test_functions_of_the_linear_part_are_exponential_or_say_their_error(n):
    rng, exact = np.random.default_rng(0), 0
    zero = np.zeros(n)

    @jax.jit
    def rationally(rows, f, d):
        """By rational functions only."""
        first, off, second = steps._linear(list(map(list, rows)), list(f), list(d), 1.0, None)
        return first, off, second([*f])

    @jax.jit
    def exactly(rows, f, d):
        """By exact ones wherever there are some."""
        first, off, second = steps._linear(list(map(list, rows)), list(f), list(d), 1.0, [0.0] * n)
        return first, off, second([*f])

    for size in np.geomspace(1e-3, 40.0, 60):
        z, y = size * rng.standard_normal((n, n)), rng.standard_normal(n)
        if np.max(np.linalg.eigvals(z).real) > 40.0:
            continue
        for one in (rationally, exactly):
            f, off, second = one(z, y, zero)
            d, _, _ = (exactly if np.all(np.array(off) == 0.0) else rationally)(z, zero, y)
            said = np.max(np.abs(off))
            exact += said == 0.0
            for k, found in ((1, f), (2, d), (3, [0.5 * v for v in second])):
                true = phi_of(z, k) @ y
                # the error of the first is what it says or less, and of the others of the order of theirs
                allowed = 1e-9 * np.max(np.abs(true)) if said == 0.0 else {1: 3.0 * said, 2: size**2, 3: size}[k]
                if said == 0.0 or size < 0.3:
                    np.testing.assert_allclose(np.array(found), true, atol=allowed)
    assert exact > 25


@pytest.mark.thorough
def test_states_that_begin_at_zero_one_behind_another_take_few_steps(monkeypatch):
    """Each grows by a higher power of time: as a share of itself its error is large however short a step is."""
    text = "a' = g - a + 0*u\nb' = c*a - b\nd' = m*b^2 - d\nx' = d - x^2\ny = x"
    t = np.array([0.0, 1.0, 2.0, 3.0])
    problem = problem_of(text, OWN, t=t, u=np.zeros(4))
    values = {"g": 9.8, "c": 0.2, "m": 1.3}
    vector = problem.predictor.stepping().vector
    p = tuple(values[n] for n in vector.parameters)
    found = errors(problem, values, (4, 16))
    assert max(map(len, followed(pair_of(vector, 4), p, [0.0] * 4, np.zeros(4), 4)[1])) < 150
    monkeypatch.setattr(steps, "SOON", 0.0)
    assert len(followed(pair_of(vector, 4), p, [0.0] * 4, np.zeros(2), 4)[1][0]) > 300
    assert found[0] < 2e-3
    assert found[1] < 2e-4


@pytest.mark.thorough
def test_sharp_friction_is_followed_where_equal_steps_are_far_off():
    problem, exact = sampled_coarsely()
    found = errors(problem, TRUTH, (1, 2, 4, 8))
    own, p, drive = (
        problem.predictor.stepping(),
        {k: np.asarray(v) for k, v in TRUTH.items()},
        next(iter(problem.whole_drives.values())),
    )
    equal = np.asarray(replace(own, substeps=64).outputs(p, drive)["y"]) - exact
    assert np.sum(np.abs(exact) < 1e-3) > 40  # it sticks
    assert found[1] < 1e-3 * np.std(exact)
    assert found[3] < 1e-4 * np.std(exact)
    assert np.sqrt(np.mean(equal**2)) > 30 * found[1]


def test_a_candidate_has_the_same_bits_beside_any_others():
    problem = adaptively(problem_of(RUBBED, RUBBING), 2)
    z = np.random.default_rng(4).random((37, 3))
    together = np.asarray(problem.costs(z))
    assert np.all(np.isfinite(together))
    order = np.random.default_rng(5).permutation(37)
    np.testing.assert_array_equal(np.asarray(problem.costs(z[order])), together[order])
    for k in (0, 17, 36):
        assert float(problem.costs(z[k : k + 1])[0]) == together[k]


def pair_of(vector, fineness=1):
    """A step (x, u, h, p), and an interval at once."""

    def of(step):
        return jax.jit(
            lambda x, u, h, p: step(
                vector.rate, x, (u, 0.0), (u, 0.0), h, p, False, vector.pattern, steps.tolerance(fineness)
            )
        )

    return of(steps._trial), of(steps._at_once)


def followed(pair, p, x, u, fineness):
    """States at all samples, and the shares of every interval that its steps took (none: at once), in plain Python."""
    trial, at_once = pair
    shares, states = [], [x]
    for k in range(len(u) - 1):
        later, good = at_once(tuple(x), float(u[k]), PERIOD, p)
        done, length, begun, largest, ends = 0.0, 1.0, x, [abs(v) for v in x], []
        if good:
            done, x = 1.0, [float(v) for v in later]
        while done < 1.0:
            length = min(length, 1.0 - done)
            last = length >= 1.0 - done
            later, error, noise, bent, way = trial(tuple(x), float(u[k]), length * PERIOD, p)
            size = [max(s, abs(float(b))) for s, b in zip(largest, later, strict=True)]
            soon = [
                max(s, steps.SOON * PERIOD * abs(float(w))) if v == 0.0 else s
                for v, s, w in zip(begun, size, way, strict=True)
            ]
            over = [max(float(e) - float(n), 0.0) for e, n in zip(error, noise, strict=True)]
            share = [e / (steps.tolerance(fineness) * max(s, 1e-300)) for e, s in zip(over, soon, strict=True)]
            strained = any(
                bool(b) and s > steps.SEEN and a <= c for b, s, a, c in zip(bent, share, soon, size, strict=True)
            )
            factor = (
                steps.SHORTEST
                if strained
                else np.clip(steps.SAFETY * max(max(share), 1e-6) ** -0.25, steps.SHORTEST, steps.LONGEST)
            )
            if max(share) <= 1.0 and not strained:
                done, x, largest = 1.0 if last else done + length, [float(v) for v in later], size
                ends.append(length)
            length *= float(factor)
        shares.append(ends)
        states.append(x)
    return np.array(states), shares


def replayed(pair, p, x, u, shares):
    for k, ends in enumerate(shares):
        for share in ends:
            x = pair[0](tuple(x), float(u[k]), share * PERIOD, p)[0]
        if not ends:
            x, _ = pair[1](tuple(x), float(u[k]), PERIOD, p)
        yield x[0]


@pytest.mark.thorough
def test_derivatives_are_those_of_the_steps_as_they_are():
    t, u = np.arange(12) * PERIOD, 2.0 * np.sin(0.5 * np.arange(12))
    problem = adaptively(problem_of(PENDULUM, OWN, t=t, u=u), 2)
    z = np.array([0.55, 0.4, 0.6])
    r, jacobian = (np.asarray(a) for a in problem.residuals_and_jacobian(z))
    cost, gradient = problem.value_and_gradient(z)
    np.testing.assert_allclose(gradient, 2 * jacobian.T @ r / len(r), rtol=1e-12)
    np.testing.assert_allclose(cost, np.mean(r**2), rtol=1e-13)
    vector, p = problem.predictor.stepping().vector, np.asarray(problem.space.physical(z))
    by_name = dict(zip(problem.space.names, p, strict=True))
    values = tuple(float(by_name[n]) for n in vector.parameters)
    pair = pair_of(vector, 2)
    states, shares = followed(pair, values, [0.0, 0.0], u, 2)
    np.testing.assert_allclose(states[:, 0], r, rtol=1e-9, atol=1e-13)  # measured is 0: the product took these steps
    assert max(map(len, shares)) > 1
    assert min(map(len, shares)) == 0

    def simulated(z):
        named = dict(zip(problem.space.names, np.asarray(problem.space.physical(z)), strict=True))
        course = replayed(pair, tuple(float(named[n]) for n in vector.parameters), (0.0, 0.0), u, shares)
        return np.array([0.0, *map(float, course)])

    for k in range(3):
        step = 1e-5 * np.eye(3)[k]
        by_differences = (simulated(z + step) - simulated(z - step)) / 2e-5
        np.testing.assert_allclose(jacobian[:, k], by_differences, rtol=1e-6, atol=1e-8 * np.max(np.abs(jacobian)))


def test_what_dies_away_asks_for_no_steps_and_what_explodes_costs_infinity():
    quick = adaptively(problem_of("x' = u - k*x\ny = x", {"k": (1e5, 1e9)}, u=np.where(T < 1.0, 1.0, 0.0)), 4)
    costs = np.asarray(quick.costs(np.array([[0.0], [0.5], [1.0]])))
    assert np.all(np.isfinite(costs))
    blown = adaptively(problem_of("x' = 1 + k*x^2 + 0*u\ny = x", {"k": (1e-9, 1e3)}), 1)
    costs = np.asarray(blown.costs(np.array([[0.0], [1.0], [0.01]])))
    assert np.isfinite(costs[0])
    assert costs[1] == np.inf
    assert float(blown.costs(np.array([[0.0]]))[0]) == costs[0]


@pytest.mark.thorough
def test_sharp_friction_can_be_followed_everywhere_in_the_box():
    """Coarse steps that jump over the place where it sticks, to and fro, took more trials than an interval may."""
    problem, _ = sampled_coarsely()
    z = np.random.default_rng(0).random((300, 3))
    for fineness in (1, 2, 4):
        assert np.all(np.isfinite(np.asarray(adaptively(problem, fineness).costs(z))))


def test_a_gradient_search_is_told_no_number_too():
    blown = adaptively(problem_of("x' = 1 + k*x^2 + 0*u\ny = x", {"k": (1e-9, 1e3)}), 1)
    costs, gradients = blown.values_and_gradients(np.array([[0.0], [1.0]]))
    assert np.isfinite(float(costs[0]))
    assert np.all(np.isfinite(np.asarray(gradients)[0]))
    assert not np.isfinite(float(costs[1]))


@pytest.mark.thorough
def test_sharp_friction_gets_adaptive_steps_and_a_smooth_plant_does_not():
    given, exact = sampled_coarsely(1e-4)
    problem = choose_substeps(given)
    z = problem.space.cube(problem.space.vector(TRUTH))
    at = refined_at(problem, z)
    for chosen in (problem, at, steps_for(given, z)):
        assert chosen.predictor.stepping().stepper == ADAPTIVE
    error = np.asarray(at.predict(problem.space.physical(z))["y"]) - exact
    assert np.sqrt(np.mean(error**2)) < 3e-5
    finer = finer_at(at, z, 0.001)
    assert finer is not None
    assert finer.predictor.stepping().substeps == 4 * at.predictor.stepping().substeps
    calm = problem_of(PENDULUM, OWN, y=0.1 * np.sin(T))
    assert refined_at(choose_substeps(calm), np.full(3, 0.5)).predictor.stepping().stepper == "exponential"


def test_what_the_user_chose_stays():
    y = np.sin(T)
    chosen = problem_of(RUBBED, RUBBING, y=y, stepper="adaptive", substeps=3)
    assert choose_substeps(chosen) is chosen
    assert refined_at(chosen, np.full(3, 0.5)) is chosen
    left = choose_substeps(problem_of(RUBBED, RUBBING, y=y, stepper="adaptive"))
    assert left.predictor.stepping().stepper == ADAPTIVE


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("w' = (u - b*w - friction(w, F))/m\ny = w", "dry friction that sticks"),
        ("w' = (u - b*w)/m\nwhen falling(w): w = F\ny = w", "events"),
        ("w' = (u - b*delay(w, F))/m\ny = w", "late states"),
    ],
)
def test_models_with_jumps_are_refused_in_one_sentence(text, word):
    with pytest.raises(SimulationError, match=word) as told:
        problem_of(text, RUBBING, stepper="adaptive")
    assert "use stepper = 'exponential'" in str(told.value)


def test_a_fineness_beyond_numbers_is_refused():
    with pytest.raises(SimulationError, match="at most 1000"):
        problem_of(PENDULUM, OWN, stepper="adaptive", substeps=1001)


@pytest.mark.thorough
def test_an_edge_of_a_dead_time_ends_a_step():
    t, truth = np.arange(300) * 0.1, {"K": 2.0, "tau": 0.8, "L": 0.437}
    u = np.repeat(np.random.default_rng(1).uniform(-1, 1, 10), 30)
    model = pf.equations(
        "x' = (K*delay(u, L) - x - x^3)/tau\ny = x", inputs=["u"], states=["x"], outputs=["y"],
        parameters={"K": {"bounds": (0.5, 4)}, "tau": {"bounds": (0.2, 2)}, "L": {"unit": "s", "bounds": (0.0, 2.0)}},
        name="late",
    )  # fmt: skip
    record = pf.from_arrays({"t": t, "u": u, "y": np.zeros(300)}, time="t")
    problem = pf.Problem(model, record, stepper="adaptive", substeps=8)
    drive, p = next(iter(problem.whole_drives.values())), {k: np.asarray(v) for k, v in truth.items()}
    exact = follow(problem.predictor.stepping(), p, drive).outputs["y"]
    values = np.array([truth[n] for n in problem.space.names])
    np.testing.assert_allclose(problem.predict(values)["y"], exact, atol=2e-4 * np.ptp(exact))
    z, place = problem.space.cube(values), problem.space.names.index("L")
    jacobian = np.asarray(problem.residuals_and_jacobian(z)[1])[:, place] / 2.0  # by s: the box is 2 s wide
    later, sooner = (
        follow(problem.predictor.stepping(), {**p, "L": np.asarray(0.437 + d)}, drive).outputs["y"]
        for d in (1e-4, -1e-4)
    )
    slope = (later - sooner) / 2e-4
    assert np.sqrt(np.mean((jacobian - slope) ** 2)) < 0.01 * np.sqrt(np.mean(slope**2))


def test_steps_in_a_closed_form():
    """x' = -x^2 from 1 has x = 1/(1 + t): one interval of 50, many steps."""
    model = pf.equations(
        "x' = -k*x^2 + 0*u\ny = x", inputs=["u"], states={"x": {"initial": 1}}, outputs=["y"],
        parameters={"k": {"bounds": (0.5, 2)}},
        name="decay",
    )  # fmt: skip
    record = pf.from_arrays({"t": np.array([0.0, 50.0, 51.0]), "u": np.zeros(3), "y": np.zeros(3)}, time="t")
    y = pf.Problem(model, record, stepper="adaptive", substeps=16).predict(np.array([1.0]))["y"]
    np.testing.assert_allclose(y, [1.0, 1 / 51, 1 / 52], rtol=2e-4)
    assert jnp.isfinite(y).all()
