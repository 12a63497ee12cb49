"""All records in one compiled loop, against a plain loop without jax, and against record by record."""

import dataclasses
from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest
from problem_batched_plants import PLAIN, Case, direct, plain_residuals, points

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate.batched import BatchedRecords
from plantfit.simulate.records.rows import RecordRows
from plantfit.simulate.steps.registry import FIXED
from plantfit.space import Parameter

import jax

QUICK = {"xla_backend_optimization_level": 0}  # these programs run once: most of the time is their compilation
OWN = Parameter((-1.0, 1.0), per_recording=True)
LOG = Parameter((0.05, 0.5), scale="log")
CASES = {
    "one record": Case(substeps=3),
    "one late input, new at every sample": Case((9, 150, 70), irregular=True, delays=1, dense=True, outputs="direct",
                                                missing=True),
    "interpolated, many substeps": Case((64, 130, 65), dense=True, hold="linear", substeps=12,
                                        parameters={"x0": OWN, "T1": LOG}),
    "seven records, two late edges": Case(
        (1, 2, 63, 64, 65, 200, 30), irregular=True, delays=2, outputs="direct",
        parameters={"x0": OWN, "off": OWN, "a": 0.1}
    ),
    "two delays, interpolated": Case((40, 90), irregular=True, delays=2, dense=True, hold="linear", outputs="direct"),
    "seven records, table": Case(
        (20, 150, 64, 7, 90, 128, 129), table=True, parameters={"T1": LOG, "c": Parameter(tied="a")}
    ),
    "table, one late edge, interpolated": Case((150, 40), delays=1, hold="linear", table=True, fit_to=0.5),
    "rosenbrock": Case((70,), delays=1, dense=True, hold="linear", stepper="rosenbrock", outputs="direct"),
    "rk4": Case((80, 30), delays=2, stepper="rk4", substeps=3, parameters={"Te": Parameter(tied="Td")}),
}  # fmt: skip
SOME = ["one late input, new at every sample", "interpolated, many substeps", "seven records, table"]
each_case, some_cases = pytest.mark.parametrize("name", CASES), pytest.mark.parametrize("name", SOME)


@cache
def prepared(name) -> SimpleNamespace:
    """Case, problem, three cube points, `call(function, z)` of the batch and `plain(function, z)` record by record."""
    case = CASES[name]
    problem = case.problem()
    batched, one_by_one = problem.evaluator, direct(problem)
    assert isinstance(batched, BatchedRecords)

    @cache
    def jitted(owner, function):
        return jax.jit(getattr(owner, function), compiler_options=QUICK)

    return SimpleNamespace(
        case=case,
        problem=problem,
        zs=points(problem, 3),
        call=lambda function, z: jitted(batched, function)(z, problem.arguments),
        plain=lambda function, z: jitted(one_by_one, function)(z, problem.data),
    )


def anew(function, **options):
    """Compiled once more: jax.jit would find what it compiled for an equal method before."""
    return jax.jit(lambda *given: function(*given), **options)


def close(actual, expected, tolerance):
    expected = np.asarray(expected)
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance * np.max(np.abs(expected)))


def test_every_stepper_is_held_to_a_plain_loop():
    missing = {*FIXED} - {*PLAIN}
    assert missing == set(), f"write a plain loop of {missing} in problem_batched_plants.py and name it in PLAIN there"
    missing = {*FIXED} - {case.stepper for case in CASES.values()}
    assert missing == set(), f"add a row with stepper={missing} to CASES here"
    assert {case.stepper for case in CASES.values()} <= {*FIXED}


@each_case
@pytest.mark.further(1)
def test_residuals_have_order_and_values_of_a_plain_loop(name):
    q = prepared(name)
    for z in q.zs:
        close(q.call("residuals_and_jacobian", z)[0], plain_residuals(q.case, q.problem, z), 1e-11)


@each_case
@pytest.mark.further(2)
def test_jacobian_is_the_slope_of_the_plain_loop(name):
    q = prepared(name)
    jacobian = q.call("residuals_and_jacobian", q.zs[1])[1]
    for move in np.random.default_rng(1).normal(size=(2, q.zs.shape[1])):
        there, here = (plain_residuals(q.case, q.problem, q.zs[1] + h * move) for h in (1e-5, -1e-5))
        close(jacobian @ move, (there - here) / 2e-5, 1e-6)


@each_case
@pytest.mark.further(2)
def test_costs_of_several(name):
    q = prepared(name)
    close(q.call("costs", q.zs), [np.mean(plain_residuals(q.case, q.problem, z) ** 2) for z in q.zs], 1e-11)


@pytest.mark.parametrize("name", [*SOME, "seven records, two late edges"])
def test_cost_of_one(name):
    q = prepared(name)
    close(q.call("costs", q.zs[1:2]), [np.mean(plain_residuals(q.case, q.problem, q.zs[1]) ** 2)], 1e-11)


@pytest.mark.parametrize(
    "name",
    [
        "one record",
        *SOME[:2],
        "seven records, two late edges",
        "table, one late edge, interpolated",
        pytest.param("rk4", marks=pytest.mark.slow),
    ],
)
@pytest.mark.further(1)
def test_gradients(name):
    q = prepared(name)
    f, g = q.call("values_and_gradients", q.zs)
    for k, z in enumerate(q.zs):
        r, jacobian = map(np.asarray, q.call("residuals_and_jacobian", z))
        assert float(f[k]) == pytest.approx(np.mean(r**2), rel=1e-11)
        close(g[k], 2.0 / len(r) * jacobian.T @ r, 1e-9)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.slow) if n in ("rk4", "table, one late edge, interpolated") else n
        for n in CASES
    ],
)
@pytest.mark.thorough
def test_blocks_of_records_side_by_side_and_in_chunks_agree(name, monkeypatch):
    q = prepared(name)
    batched = q.problem.evaluator
    if batched.whole is None:
        assert not batched.few_edges
        return
    weights = {n: 1.0 + k for k, n in enumerate(batched.names)}
    numbers = q.problem.arguments._replace(weight=np.array(list(weights.values())))
    ways, taken, side_by_side = [], [], BatchedRecords._side_by_side
    monkeypatch.setattr(BatchedRecords, "_side_by_side", lambda *given: taken.append(True) or side_by_side(*given))
    for even in (True, False):
        monkeypatch.setattr(RecordRows, "even", even)
        ways.append(anew(batched.blocks, compiler_options=QUICK)(q.zs[0], numbers))
        assert bool(taken) == even
        taken.clear()
    for record, other in zip(*ways, strict=True):
        for ours, theirs in zip(record, other, strict=True):
            assert ours.shape == theirs.shape
            close(ours, theirs, 1e-11)
    plainly = anew(batched.blocks, compiler_options=QUICK)(q.zs[0], numbers._replace(weight=None))
    for record, plain, weight in zip(ways[0], plainly, weights.values(), strict=True):
        for a, b in zip(record, plain, strict=True):
            close(a, np.sqrt(weight) * b, 1e-12)


@pytest.mark.parametrize(
    "name",
    [
        n if n.startswith(("seven", "two", "rosenbrock")) else pytest.param(n, marks=pytest.mark.slow)
        for n in CASES
        if n != "one late input, new at every sample"
    ],
)
@pytest.mark.thorough
def test_records_together_one_by_one_and_in_chunks_give_costs_of_the_same_bits(name, monkeypatch):
    q = prepared(name)
    batched, numbers = q.problem.evaluator, q.problem.arguments
    if batched.whole is None:
        assert not batched.few_edges
        return
    ways = []
    for together in (True, False):
        monkeypatch.setattr(RecordRows, "together", lambda self, candidates, so=together: so)
        compiled = anew(batched.values_and_gradients)
        costs, gradients = compiled(q.zs, numbers)
        for k in range(len(q.zs)):
            cost, gradient = compiled(q.zs[k : k + 1], numbers)
            np.testing.assert_array_equal(cost[0], costs[k])
            close(gradient[0], gradients[k], 1e-14)  # XLA turns parameters into coordinates, to rounding
        ways.append((costs, gradients))
    np.testing.assert_array_equal(ways[0][0], ways[1][0])
    close(ways[0][1], ways[1][1], 1e-14)
    cost = anew(batched.cost)
    np.testing.assert_array_equal([cost(z, numbers) for z in q.zs], ways[0][0])
    close(jax.jit(jax.grad(partial(batched.cost, reverse=True)))(q.zs[0], numbers), ways[0][1][0], 1e-12)


def test_records_of_very_unequal_length_are_not_filled_up():
    lengths = [prepared("one record").case.lengths[0], *[4] * 9]
    case = dataclasses.replace(CASES["one record"], lengths=tuple(lengths))
    problem = case.problem()
    batched = problem.evaluator
    assert isinstance(batched, BatchedRecords)
    assert batched.whole is None
    zs = points(problem, 2)
    close(
        jax.jit(batched.costs)(zs, problem.arguments),
        [np.mean(plain_residuals(case, problem, z) ** 2) for z in zs],
        1e-11,
    )


@pytest.mark.parametrize("name", [SOME[0], *(pytest.param(n, marks=pytest.mark.slow) for n in SOME[1:])])
@pytest.mark.thorough
def test_residuals_and_jacobian_equal_those_record_by_record(name):
    q = prepared(name)
    for own, plain in zip(
        q.call("residuals_and_jacobian", q.zs[0]), q.plain("residuals_and_jacobian", q.zs[0]), strict=True
    ):
        close(own, plain, 1e-10)


@some_cases
@pytest.mark.further(2)
def test_few_rows_keep_mean_square_gradient_and_gauss_newton_matrix(name):
    q = prepared(name)
    r, jacobian = map(np.asarray, q.call("residuals_and_jacobian", q.zs[2]))
    few, own = q.problem.compressed(q.zs[2])
    assert own.shape == (len(few), q.zs.shape[1])
    assert len(few) <= len(q.case.lengths) * (q.zs.shape[1] + 1)
    close(few @ few / len(few), r @ r / len(r), 1e-10)
    close(own.T @ few / len(few), jacobian.T @ r / len(r), 1e-9)
    close(own.T @ own / len(few), jacobian.T @ jacobian / len(r), 1e-9)


def test_records_that_lie_elsewhere_need_other_compiled_functions():
    one = CASES["one record"]
    a, b = (dataclasses.replace(one, lengths=lengths).problem().evaluator for lengths in ((200, 90), (90, 200)))
    assert isinstance(a, BatchedRecords)
    assert isinstance(b, BatchedRecords)
    scored = tuple((np.arange(10),) for _ in range(2))
    a, b = (dataclasses.replace(batched, scored=scored) for batched in (a, b))
    assert a.rows.rows == b.rows.rows
    assert a.serves(a)
    assert not a.serves(b)
