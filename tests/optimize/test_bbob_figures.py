"""The figures of the BBOB benchmark: areas, running times, tests, counting, files and logs."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from benchmarks.bbob import ecdf, references, table
from benchmarks.bbob.results import Result, first_hits, from_runs, load, path_of, save
from benchmarks.bbob.suite import TARGETS, Done, Problem, Run

from plantfit.optimize.contract import Facts, Needs

import jax.numpy as jnp

INF = np.inf
ROOT = Path(__file__).resolve().parents[2]


def sphere(dimension: int = 2, optimum: float = 7.0) -> Problem:
    return Problem(1, dimension, 1, optimum, lambda x: optimum + float(np.sum(np.asarray(x) ** 2)))


def test_targets_are_those_of_the_issue():
    assert len(TARGETS) == 51
    np.testing.assert_allclose(np.log10(TARGETS), np.linspace(2, -8, 51))


def test_area_by_hand():
    d = 4
    # met within d evaluations, after 10 d, after 1000 d, after more, never
    hits = np.array([[1, 40, 4000, 8000, INF]])
    assert ecdf.areas(hits, d) == pytest.approx((1 + 2 / 3 + 0 + 0 + 0) / 5)
    assert ecdf.areas(np.full((2, 51), 4.0), d) == pytest.approx([1, 1])
    assert ecdf.areas(np.full((2, 51), INF), d) == pytest.approx([0, 0])


def test_area_is_the_integral_of_the_solved_share():
    rng = np.random.default_rng(3)
    d = 5
    hits = np.where(rng.random((15, 51)) < 0.3, INF, d * 10 ** rng.uniform(-0.5, 3.5, (15, 51)))
    at = np.linspace(0, 3, 300_001)
    integral = np.trapezoid(ecdf.solved_share(hits, d, 10**at), at) / 3
    assert ecdf.areas(hits, d).mean() == pytest.approx(integral, abs=1e-5)


def test_first_hits_of_improvements():
    hits = first_hits([1, 5, 9], [150.0, 50.0, 1e-8])
    assert hits[0] == 5  # 10^2
    assert hits[1] == 5  # 10^1.8 = 63
    assert hits[2] == 9  # 10^1.6 = 40
    assert hits[-1] == 9
    assert np.all(np.isinf(first_hits([], [])))


def test_expected_running_time_counts_failures():
    # two hits after 10 and 30, a miss of 100: (10 + 30 + 100) / 2
    times = ecdf.running_times([[10, INF], [30, INF], [INF, INF]], [50, 60, 100])
    assert times[0] == 70
    assert times[1] == INF


def test_differences_by_hand():
    areas = {
        "good": {f: np.array([0.6, 0.7]) + f / 100 for f in range(1, 7)},
        "bad": {f: np.array([0.5, 0.6]) + f / 200 for f in range(1, 7)},
        "same": {f: np.array([0.6, 0.7]) + f / 100 for f in range(1, 7)},
    }
    better, equal = ecdf.differences(areas, [("good", "bad"), ("good", "same")])
    # six differences of one sign: the exact two-sided p value is 2 / 2^6
    assert better.p == pytest.approx(2 / 64)
    assert better.p_holm == pytest.approx(4 / 64)
    assert (better.better, better.worse) == (6, 0)
    # 0.60 + f / 100 > 0.60 + f / 200, so all four pairs are won on every function
    assert better.effect == 1.0
    assert (equal.p, equal.p_holm, equal.effect, equal.better, equal.worse) == (1.0, 1.0, 0.5, 0, 0)


def test_a_run_counts_and_stops_at_its_budget():
    run = Run(sphere(), 5, keep=True)
    assert run([3.0, 4.0]) == 32.0
    assert run.costs([[1.0, 0.0], [2.0, 0.0]]).tolist() == [8.0, 11.0]
    with pytest.raises(Done):
        run.costs([[0.5, 0.0], [0.0, 2.0], [0.0, 0.0]])
    assert run.evaluations == 5
    assert run.best == 0.25
    assert (run.at, run.above) == ([1, 2, 4], [25.0, 1.0, 0.25])
    assert len(np.concatenate(run.points)) == 5
    with pytest.raises(Done):
        run([0.0, 0.0])


def test_a_run_stops_at_the_last_target_and_survives_nan():
    run = Run(Problem(1, 1, 1, 0.0, lambda x: float(x[0])), 100)
    assert np.isnan(run([np.nan]))
    assert not run.at
    run([1e-9])
    with pytest.raises(Done):
        run([1.0])
    assert run.evaluations == 2


def test_results_survive_the_file(tmp_path):
    runs = [Run(sphere(), 50), Run(sphere(), 50)]
    for run in runs:
        run.costs(np.random.default_rng(len(run.at)).uniform(-5, 5, (20, 2)))
    kept = from_runs("random", runs, 1.5, {"package": "numpy 2"})
    save(kept, tmp_path)
    path = path_of(tmp_path, "random", 1, 2)
    back: Result = load(path)
    assert [p.name for p in path.parent.iterdir()] == [path.name]
    np.testing.assert_array_equal(back.hits(), kept.hits())
    np.testing.assert_array_equal(back.spent, [20, 20])
    assert (back.method, back.seconds, back.about) == ("random", 1.5, {"package": "numpy 2"})


def result(method: str, function: int, hits: np.ndarray, instances: tuple[int, ...], dimension: int = 5) -> Result:
    """A result whose run i reaches target j at hits[i, j] evaluations."""
    at = [np.sort(h[np.isfinite(h)]).astype(int) for h in hits]
    above = [TARGETS[np.isfinite(h)] for h in hits]
    return Result(
        method, function, dimension, 1000 * dimension, np.array(instances), np.full(len(hits), 5000), at, above, 0.0
    )


def test_shares_count_what_was_reached_by_the_end():
    assert ecdf.shares([[1, 40, INF, INF], [5, INF, INF, INF], [1, 1, 1, 1]]).tolist() == [0.5, 0.25, 1.0]


def test_tables_of_the_page_by_hand():
    """Ours is ahead in area by the slope f5 alone and reaches fewer targets on every other function."""
    fast, slow = np.full((2, 51), INF), np.full((2, 51), INF)
    of = {"cmaes": {}, "pycma": {}}
    for f in range(1, 8):
        a, b = fast.copy(), slow.copy()
        a[:, :10], b[:, :20] = 500, 600
        if f == 5:
            a[:], b[:] = 5, 4000
        of["cmaes"][f], of["pycma"][f] = result("cmaes", f, a, (1, 2)), result("pycma", f, b, (2, 3))
    # only instance 2 is common
    ours, theirs = table.common_runs(of, ("cmaes", "pycma"))
    assert [list(r.instances) for r in (ours[1], theirs[1])] == [[2], [2]]
    [end] = table.compared(of, [("cmaes", "pycma")], table.at_the_end)
    assert (end.area, end.reference_area) == pytest.approx(((6 * 10 / 51 + 1) / 7, (6 * 20 / 51 + 1) / 7))
    assert (end.better, end.worse) == (0, 6)
    [area], [sloped] = (table.compared(of, [("cmaes", "pycma")], table.area, out) for out in ((), (5,)))
    assert (area.better, area.worse) == (1, 6)
    assert (sloped.better, sloped.worse) == (0, 6)
    assert sloped.area == pytest.approx(10 / 51 * (3 - 2) / 3)
    assert area.area > area.reference_area
    assert sloped.area < sloped.reference_area
    lines = table.page_table(of, [("cmaes", "pycma")], 5)
    row = next(line for line in lines if line.startswith("| `cmaes`"))
    assert row.startswith("| `cmaes` | pycma (7 functions) | 1 | ")
    # behind by more than chance without f5 and at the end: six of six
    assert any(line.startswith("| **`cmaes`** | pycma (7 functions) | 0.065 | ") for line in lines)


def test_equal_first_populations():
    from benchmarks.bbob.ours import portfolio

    for d in (5, 20):
        facts = Facts(d, 1000 * d)
        for name, entry in portfolio().items():
            if entry.method in ("lshade", "jso"):
                rows = entry.made(d).rows(facts)
                options = references.REFERENCES[entry.references[0]].start.keywords["options"](d)  # pyrefly: ignore[missing-attribute]
                assert options["population_size"] == rows, name


@pytest.mark.parametrize("name", ["numpy-random", "scipy-lbfgsb", "scipy-nelder-mead", "scipy-de"])
def test_references_restart_and_keep_the_budget(name):
    run = Run(Problem(1, 3, 1, -1.0, lambda x: float(np.sum(np.asarray(x) ** 2))), 700)  # the optimum is never met
    references.run_reference(references.REFERENCES[name], [run], 1)
    assert run.evaluations == 700
    assert run.best < 5.0


def test_gray_code_covers_the_box():
    bits = np.array([[0] * 32, [1] + [0] * 15 + [0] * 15 + [1]])
    points = references.gray_to_box(bits)
    assert points[0].tolist() == [-5.0, -5.0]
    # 10...0 is the last code, 0...01 the second
    assert points[1] == pytest.approx([5.0, -5.0 + 10 / 65535])


class Halving:
    """A population of 8 of which every second generation uses 4, and which ends after 3."""

    needs = Needs()

    def rows(self, facts: Facts) -> int:
        return 8

    def init(self, key, facts):
        return jnp.zeros(facts.dimension), jnp.zeros((), int)

    def live(self, state):
        return jnp.where(state[1] % 2 == 0, 8, 4)

    def ask(self, key, state):
        return jnp.full((8, len(state[0])), 0.25), state

    def tell(self, state, x, f):
        expected = jnp.where(jnp.arange(8) < self.live(state), jnp.isfinite(f), jnp.isinf(f))
        # a wrong set of costs would end the run at once
        return (state[0], state[1] + 1), {"stop": (state[1] == 2) | ~jnp.all(expected)}


def test_our_driver_charges_live_rows_alone_and_restarts():
    from benchmarks.bbob.ours import _run_population

    runs = [Run(sphere(), 50), Run(sphere(), 50)]
    _run_population(Halving(), runs, [1, 2])
    # 8 + 4 + 8 a life of three generations: 20, 40, then 48; the next 4 do not fit
    assert [r.evaluations for r in runs] == [48, 48]
    assert runs[0].best == pytest.approx(2 * 2.5**2)


def test_our_methods_keep_the_budget_on_host_and_in_jax():
    from benchmarks.bbob.ours import Ours, run_ours

    for name in ("random", "lbfgsb"):
        run = Run(Problem(1, 2, 1, -1.0, lambda x: float(np.sum((np.asarray(x) - 1) ** 2))), 130)
        run_ours(Ours(name, {}, ()), [run], 1)
        assert 120 < run.evaluations <= 130
        assert run.best < 3.0


@pytest.fixture(scope="module")
def logged(tmp_path_factory):
    """Folder of a short logged run of random search on f1 and f8 in 2-D by the command line."""
    pytest.importorskip("cocoex", reason="coco-experiment is not installed (make bbob brings it)")
    pytest.importorskip("ioh", reason="ioh is not installed (make bbob brings it)")
    folder = tmp_path_factory.mktemp("bbob")
    command = [
        sys.executable, "-m", "benchmarks.bbob", "--methods", "numpy-random", "--alone", "--dimensions", "2",
        "--functions", "1,8",
        "--quick", "--logs", "--out", str(folder),
    ]  # fmt: skip
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    assert done.returncode == 0, done.stderr
    assert "numpy-random" in done.stdout
    return folder


def test_logs_tell_what_the_runs_saw(logged):
    kept = load(path_of(logged, "numpy-random", 8, 2))
    assert kept.spent.tolist() == [200, 200, 200]
    info = (logged / "logs" / "numpy-random" / "f08_d02" / "bbobexp_f8.info").read_text()
    assert "funcId = 8, DIM = 2" in info
    assert "algId = 'numpy-random'" in info
    # instance:evaluations|distance to the optimum, as the replay saw them
    found = [part.strip() for part in info.strip().splitlines()[-1].split(",")[1:]]
    assert found == [f"{i}:200|{above[-1]:.1e}" for i, above in zip(kept.instances, kept.above, strict=True)]


def test_cocopp_reads_the_same_running_times_from_the_logs(logged):
    cocopp = pytest.importorskip("cocopp", exc_type=ImportError, reason="cocopp is not installed (make bbob brings it)")
    theirs = {d.funcId: d for d in cocopp.load(str(logged / "logs" / "numpy-random"))}
    assert sorted(theirs) == [1, 8]
    for function, data in theirs.items():
        kept = load(path_of(logged, "numpy-random", function, 2))
        np.testing.assert_allclose(ecdf.running_times(kept.hits(), kept.spent), data.detERT(TARGETS))


def test_options_of_the_command_line():
    from benchmarks.bbob.__main__ import chosen, numbers

    assert numbers("1-3,8") == [1, 2, 3, 8]
    assert chosen(["pso"], alone=False) == ["pso", "pymoo-pso", "minion-pso"]
    assert chosen(["pso"], alone=True) == ["pso"]
    with pytest.raises(SystemExit, match="no method 'psso'"):
        chosen(["psso"], alone=True)
    assert json.dumps(chosen(["references"], alone=True)).count("pyhms") == 2
