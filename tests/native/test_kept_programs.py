"""Programs that outlive the process: found again without tracing, with the same bits; never where something else is
compiled in."""

import gc
import hashlib
import os
import subprocess
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest

from plantfit.models import equations
from plantfit.native import kept_programs
from plantfit.native.kept_programs import Kept, described
from plantfit.optimize import minimise
from plantfit.optimize.loop import apart, generations, population_loop
from plantfit.problem.evaluate import points
from plantfit.problem.measure.experiment import Experiment
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter
from plantfit.study.objective import objective_of

import jax
import jax.numpy as jnp


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where programs are kept during a test."""
    monkeypatch.setattr(kept_programs, "code_folder", lambda kind: tmp_path)
    return tmp_path


def programs(folder):
    return sorted(f for f in folder.iterdir() if f.name != kept_programs.AGE)


class Counted:
    """A function of (z, numbers) that counts how often it is traced."""

    def __init__(self, factor=2.0):
        self.factor, self.traced = factor, 0

    def __call__(self, z, numbers):
        self.traced += 1
        return jnp.sin(self.factor * z) @ numbers[0], {"square": z**2}


OWN = os.urandom(8).hex()  # XLA's cache holds programs of earlier tests, which are not written down again


def kept(function, name="f", thing=("f", 2.0)):
    test = hashlib.sha256(os.environ["PYTEST_CURRENT_TEST"].encode()).hexdigest()[:8]
    return Kept(function, f"{name} {OWN} {test}", described(thing))


def problem(equation="x' = (K*u - x)/tau\ny = x", bounds=(0.1, 5.0), samples=40):
    t = np.linspace(0.0, 8.0, samples)
    recording = Recording(t, {"u": Signal((t > 1.0) * 1.0), "y": Signal(np.sin(t))})
    model = equations(
        equation,
        inputs=["u"],
        states={"x": {"initial": 0.0}},
        outputs=["y"],
        parameters={"K": {"bounds": bounds}, "tau": {"bounds": (0.2, 3.0)}},
    )
    return Problem(model, recording, substeps=2)


def test_found_again_without_tracing_with_the_same_bits(folder):
    z, numbers = np.array([0.3, 0.7]), (np.array([1.0, -3.0]),)
    first, second = Counted(), Counted()
    made = kept(first)(z, numbers)
    read = kept(second)
    found = read(z, numbers)
    assert (first.traced, second.traced) == (1, 0)
    assert made[0].tobytes() == found[0].tobytes()
    assert made[1]["square"].tobytes() == found[1]["square"].tobytes()
    read(z, numbers)
    read(np.array([0.1, 0.2]), numbers)
    assert second.traced == 0
    assert float(found[0]) == float(jax.jit(Counted())(z, numbers)[0])


def test_other_shapes_names_and_descriptions_are_other_programs(folder):
    z, numbers = np.array([0.3, 0.7]), (np.array([1.0, -3.0]),)
    kept(Counted())(z, numbers)
    longer, named, other = Counted(), Counted(), Counted(factor=3.0)
    assert kept(longer)(np.ones(3), (np.ones(3),))[1]["square"].shape == (3,)
    kept(named, name="g")(z, numbers)
    found = kept(other, thing=("f", 3.0))(z, numbers)
    assert longer.traced == named.traced == other.traced == 1
    assert float(found[0]) == pytest.approx(np.sin(3.0 * z) @ numbers[0], rel=1e-14)


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_functions_that_use_one_argument_each_are_other_programs(folder, monkeypatch, order, told):
    """jax leaves unused arguments out of a program: the text of both was the same, and so was the executable, which
    gave a model's first state where the second was asked for."""
    if not told:  # as a later jax may have it
        monkeypatch.setattr(kept_programs, "_taken", lambda lowered, key, own=kept_programs._taken: own(None, key))
    x = np.array([0.3, 0.7]), np.array([5.0, 6.0])
    found = {place: kept(lambda x, place=place: x[place], thing=("place", place))(x) for place in order}
    for place in order:
        assert found[place].tolist() == x[place].tolist()


def test_functions_that_differ_in_many_numbers_are_other_programs(folder):
    z = np.array([2.0])
    for seed in (1, 2):
        numbers = np.random.default_rng(seed).normal(size=100_000)
        found = kept(lambda z, numbers=numbers: z * jnp.asarray(numbers)[50_000], thing=("seed", seed))(z)
        assert float(found[0]) == 2.0 * numbers[50_000]


def test_functions_that_trace_through_it_and_derive_it_see_the_function_itself(folder):
    z, numbers = np.array([0.3, 0.7]), (np.array([1.0, -3.0]),)
    function = kept(Counted())
    function(z, numbers)
    assert float(jax.jit(lambda z: function(z, numbers)[0])(z)) == pytest.approx(
        float(function(z, numbers)[0]), rel=1e-15
    )
    slope = jax.grad(lambda z: function(z, numbers)[0])(z)
    assert np.allclose(slope, 2.0 * np.cos(2.0 * z) * numbers[0], rtol=1e-14)


@pytest.mark.parametrize("broken", [b"", b"not a program", None])
def test_a_broken_file_is_made_anew(folder, broken):
    z, numbers = np.array([0.3, 0.7]), (np.array([1.0, -3.0]),)
    made = kept(Counted())(z, numbers)
    files = programs(folder)
    assert len(files) == 2
    for file in files:
        file.write_bytes(file.read_bytes()[:-7] if broken is None else broken)
    again = Counted()
    assert kept(again)(z, numbers)[0].tobytes() == made[0].tobytes()
    assert again.traced == 1


def test_a_program_that_calls_back_into_the_process_is_not_kept(folder):
    def function(z, numbers):
        return jax.pure_callback(lambda v: np.asarray(v) * 2.0, jax.ShapeDtypeStruct(z.shape, z.dtype), z)

    assert np.array_equal(kept(function)(np.ones(2), (np.ones(1),)), [2.0, 2.0])
    assert not programs(folder)


def local(x):
    return x


def test_functions_of_other_packages_have_no_description():
    assert described({"model": local}) is None
    assert described({"model": lambda x: x}) is None
    assert described({"model": os.path.join}) is None
    assert described({"numbers": np.arange(3.0), "name": "x", "function": equations}) is not None


def test_more_data_than_a_compilation_is_worth_has_no_description(monkeypatch):
    monkeypatch.setattr(kept_programs, "LARGEST", 10_000)
    assert described(np.zeros(1000)) is not None
    assert described(np.zeros(2000)) is None


def test_a_problem_is_freed_without_the_collector_of_cycles():
    gc.disable()
    try:
        own = problem()
        own.costs(np.array([[0.4, 0.6]]))
        gone = weakref.ref(own)
        del own
        assert gone() is None
    finally:
        gc.enable()


def test_all_that_is_compiled_in_is_in_the_description_of_a_problem():
    own = [
        problem(),
        problem("x' = (K*u - x)/tau\ny = 2*x"),
        problem(bounds=(0.1, 4.0)),
        problem(samples=41),
        problem().with_simulator(problem().predictor.stepping().refined(2)),
        problem().with_scales({"y": 3.0}),
    ]
    found = [p._description for p in own]
    assert None not in found
    assert len(set(found)) == len(found)
    assert problem()._description == found[0]


def compiled_in(problem):
    return problem.compiled["costs"].description


@pytest.mark.thorough
def test_recorded_numbers_are_not_compiled_in(folder):
    z = np.array([0.4, 0.6])
    equation = f"k = {int.from_bytes(os.urandom(6)) / 2**48!r}\nx' = (K*u - k*x)/tau\ny = x"  # its own, as above
    first = problem(equation)
    r = first.experiments["recording"].recording
    noisy = {
        "measured": Recording(r.t, {"u": Signal(r["u"]), "y": Signal(r["y"] + 0.1 * np.cos(7.0 * r.t))}),
        "input": Recording(r.t, {"u": Signal(np.sin(3.0 * r.t)), "y": Signal(r["y"])}),
        "times": Recording(1.1 * r.t, {n: Signal(r[n]) for n in ("u", "y")}),
    }
    cost, _ = first.costs(z[None, :]), points.residuals_and_jacobian(first, z)
    for what, recording in noisy.items():
        other = Problem(first.model, recording, substeps=2)
        assert compiled_in(other) == compiled_in(first), what
        plain = (
            jax.jit(other.evaluator.costs)(z[None, :], other.arguments),
            *jax.jit(other.evaluator.residuals_and_jacobian)(z, other.arguments),
        )
        several = points.several(other.compiled["residuals_and_jacobian"])
        assert isinstance(several, Kept)
        other.compiled["costs"]._plain = several._plain = None  # whoever traced would meet this
        found = other.costs(z[None, :]), *points.residuals_and_jacobian(other, z)
        assert not np.array_equal(found[0], cost), what
        assert all(np.array_equal(a, b) for a, b in zip(found, plain, strict=True)), what


def scored_after(skip):
    own = problem()
    r = own.experiments["recording"].recording
    return Problem(own.model, Experiment(r, skip=skip), substeps=2)


def late(bounds):
    t = np.linspace(0.0, 8.0, 40)
    model = equations(
        "x' = (delay(u, L) - x)/tau\ny = x", inputs=["u"], states={"x": {"initial": 0.0}}, outputs=["y"],
        parameters={"tau": {"bounds": (0.2, 3.0)}, "L": {"bounds": bounds}},
    )  # fmt: skip
    return Problem(model, Recording(t, {"u": Signal((t > 1.0) * 1.0), "y": Signal(np.sin(t))}), substeps=2)


def test_all_else_is_compiled_in():
    own = problem()
    r = own.experiments["recording"].recording
    model = own.model
    others = {
        "first": own,
        "equation": problem("x' = (K*u - x)/tau\ny = 2*x"),
        "bounds": problem(bounds=(0.1, 4.0)),
        "length": problem(samples=41),
        "steps": problem().with_simulator(own.predictor.stepping().refined(2)),
        "stepper": Problem(model, r, substeps=2, stepper="rk4"),
        "hold": Problem(model, r, substeps=2, hold={"u": "linear"}),
        "scored, one": scored_after(1.0),
        "scored, another": scored_after(2.0),
        "names": Problem(model, {"other": r}, substeps=2),
        "two": Problem(model, {"a": r, "b": r}, substeps=2),
        "steady beside it": Problem(model, {"a": r, "b": Experiment(r, steady=True)}, substeps=2),
        "per recording": Problem(model, {"a": r, "b": r}, {"K": Parameter((0.1, 5.0), per_recording=True)}, substeps=2),
        "held": Problem(model, r, {"K": Parameter(value=2.0)}, substeps=2),
        "held elsewhere": Problem(model, r, {"K": Parameter(value=3.0)}, substeps=2),
        "late": late((0.5, 1.0)),
        "late or not": late((0.0, 6.0)),
    }
    found = {name: compiled_in(p) for name, p in others.items()}
    assert None not in found.values()
    assert len(set(found.values())) == len(found), found
    assert compiled_in(problem()) == compiled_in(problem().with_scales({"y": 3.0})) == found["first"]
    assert compiled_in(Problem(model, r, {"K": Parameter((0.1, 5.0), start=2.0)}, substeps=2)) == found["first"]


def test_a_problem_gives_the_same_bits_from_disk(folder):
    z = np.array([0.4, 0.6])
    equation = f"k = {int.from_bytes(os.urandom(6)) / 2**48!r}\nx' = (K*u - k*x)/tau\ny = x"  # its own, as above
    made = problem(equation)
    numbers = [
        np.asarray(made.costs(z[None, :])),
        *points.residuals_and_jacobian(made, z),
        points.residuals_alone(made, z),
    ]
    assert len(programs(folder)) == 6
    read = problem(equation)
    for name in ("costs", "residuals_and_jacobian", "residuals"):
        # whoever traced would meet this
        read.compiled[name]._plain = None
    for name in ("residuals", "residuals_and_jacobian"):
        several = points.several(read.compiled[name])
        assert isinstance(several, Kept)
        several._plain = None
    again = [
        np.asarray(read.costs(z[None, :])),
        *points.residuals_and_jacobian(read, z),
        points.residuals_alone(read, z),
    ]
    assert [a.tobytes() for a in again] == [a.tobytes() for a in numbers]
    plain = jax.jit(read.evaluator.residuals)(z, read.arguments)
    assert np.array_equal(numbers[-1], plain)


def test_a_program_that_is_read_runs_once_for_its_first_numbers(folder, monkeypatch):
    z, numbers = np.array([0.4, 0.6]), (np.eye(2),)
    first = kept(Counted())(z, numbers)
    runs, load = [], kept_programs.deserialize_and_load

    def counted(*given):
        program = load(*given)
        return lambda *args: runs.append(1) or program(*args)

    monkeypatch.setattr(kept_programs, "deserialize_and_load", counted)
    function = Counted()
    again = kept(function)
    for _ in range(2):
        found = again(z, numbers)
        np.testing.assert_array_equal(found[0], first[0])
        np.testing.assert_array_equal(found[1]["square"], first[1]["square"])
    assert (len(runs), function.traced) == (2, 0)


def test_a_program_around_another_is_found_again(folder):
    z, numbers = np.arange(3.0), (np.ones(3),)

    def around(inner):
        return inner.around(lambda z, numbers: inner(z, numbers)[0] / 2.0, f"half {OWN}", ("half", 1))

    first, second = Counted(), Counted()
    result = around(kept(first))(z, numbers)
    assert float(result) == pytest.approx(float(np.sum(np.sin(2.0 * z))) / 2.0, rel=1e-15)
    before = programs(folder)
    assert float(around(kept(second))(z, numbers)) == float(result)
    assert (first.traced, second.traced) == (1, 0)
    assert programs(folder) == before
    assert Kept(Counted(), "f", None).around(Counted(), "half", ()).description is None


def test_what_is_compiled_with_care_is_another_program(folder):
    test, made = hashlib.sha256(os.environ["PYTEST_CURRENT_TEST"].encode()).hexdigest()[:8], []
    for careful in (False, True):
        function = Kept(Counted(), f"f {OWN} {test} {careful}", described("one"), careful)
        made.append(function(np.array([0.4, 0.6]), (np.eye(2),))[0])
    assert len(programs(folder)) == 4  # two keys, two executables
    np.testing.assert_allclose(*made, rtol=1e-14)


@pytest.mark.thorough
def test_a_second_process_reads_what_the_first_one_kept(tmp_path):
    text = """
import sys, numpy as np
from pathlib import Path
sys.path.insert(0, str(Path(sys.argv[1])))
from test_kept_programs import problem
from plantfit.native import kept_programs
made = []
kept_programs._made, before = lambda *a: made.append(a) or before(*a), kept_programs._made
p = problem()
z = np.array([0.4, 0.6])
print(len(made), np.asarray(p.costs(z[None, :])).tobytes().hex(), len(made))
"""
    environment = {**os.environ, "PLANTFIT_CACHE": str(tmp_path / "cache")}
    told = [
        subprocess.run(
            [sys.executable, "-c", text, str(Path(__file__).parent)],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        for _ in range(2)
    ]
    (none, bits, traced), (_, again, of_second) = (t.stdout.split() for t in told)
    assert (none, traced, of_second) == ("0", "1", "0")
    assert bits == again


def in_a_process_of_its_own(text, cache):
    """What a script prints, whose `made` names the programs that it compiled and whose cache is this folder."""
    begin = """
import sys, numpy as np
from pathlib import Path
sys.path.insert(0, str(Path(sys.argv[1])))
from test_kept_programs import problem
from plantfit.native import kept_programs
made, before = [], kept_programs._made
kept_programs._made = lambda f, k, name, jitted, *a: (
    made.append(jitted.__name__.split("_")[1]) or before(f, k, name, jitted, *a))
"""
    environment = {**os.environ, "PLANTFIT_CACHE": str(cache)}
    command = [sys.executable, "-c", begin + text, str(Path(__file__).parent)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.split()


@pytest.mark.thorough
def test_what_is_kept_is_not_written_into_xla_s_cache_as_well(tmp_path):
    text = """
import jax
usual = jax.config.values[kept_programs._LEAST_SECONDS]
p = problem()
p.costs(np.array([[0.4, 0.6]]))
assert jax.config.values[kept_programs._LEAST_SECONDS] == usual, "the setting did not come back"
jax.jit(lambda x: x + 1.25)(2.0)
print(len(made))
"""
    assert in_a_process_of_its_own(text, tmp_path / "cache") == ["1"]
    of_xla = [f.name for f in (tmp_path / "cache" / "xla").iterdir()]
    assert any(name.startswith("jit__lambda") for name in of_xla), "XLA's cache is not used at all"
    assert not [name for name in of_xla if "kept" in name]
    assert programs(tmp_path / "cache" / "programs")


@pytest.mark.thorough
def test_a_second_process_searches_with_the_programs_of_the_first(tmp_path):
    """Generations of a population method (CMA-ES calls LAPACK in them), in blocks and apart, and the candidates of one
    that drives itself."""
    text = """
from plantfit.optimize import minimise
from plantfit.space import Parameter
from plantfit.study.objective import objective_of
for method, budget in (("cmaes", 150), ("pso", 12_000), ("nelder_mead", 150)):
    found = minimise(objective_of(problem()), method, runs=2, budget=budget, seed=3)
    print(method, *(r.x.tobytes().hex() + r.history_cost.tobytes().hex() for r in found))
print("made", *sorted(set(made)))
"""
    first, second = (in_a_process_of_its_own(text, tmp_path / "cache") for _ in range(2))
    at = first.index("made")
    assert first[at:] == ["made", "asked", "candidates", "evaluated", "generations", "told"]
    assert second == [*first[:at], "made"]


# a key and an executable of the blocks; those of asking, and the key of telling, whose text is the same
@pytest.mark.parametrize(("few", "more"), [(False, 2), (True, 3)])
@pytest.mark.thorough
def test_other_settings_of_a_search_are_another_program(folder, monkeypatch, few, more):
    monkeypatch.setattr(population_loop, "worth_it", lambda *_: few)

    def cleared():
        generations._compiled.cache_clear()
        apart._asking_and_telling.cache_clear()
        apart._evaluating.cache_clear()

    def searched(**settings):
        found = minimise(objective_of(problem()), "pso", runs=2, budget=200, seed=1, settings=settings)
        return b"".join(r.history_cost.tobytes() for r in found)

    cleared()
    one, count = searched(population=10), len(programs(folder))
    cleared()
    assert searched(population=10) == one
    assert len(programs(folder)) == count
    cleared()
    assert searched(population=10, inertia=0.5) != one
    assert len(programs(folder)) == count + more


def test_old_programs_make_room(tmp_path, monkeypatch):
    monkeypatch.setattr(kept_programs, "MOST_FILES", 4)
    for k in range(6):
        (tmp_path / f"{k}").write_bytes(b"x")
        os.utime(tmp_path / f"{k}", (k, k))
    kept_programs._make_room(tmp_path)
    assert sorted(f.name for f in tmp_path.iterdir()) == ["3", "4", "5"]


def test_programs_that_were_read_lately_stay(folder, monkeypatch):
    z, numbers = np.array([0.3, 0.7]), (np.array([1.0, -3.0]),)
    kept(Counted())(z, numbers)
    own = [f.name for f in folder.iterdir() if f.name != kept_programs.AGE]
    for name in own:
        os.utime(folder / name, (1, 1))
    kept(Counted())(z, numbers)
    for k in range(2, 2 + len(own)):
        (folder / f"{k}").write_bytes(b"x")
        os.utime(folder / f"{k}", (k, k))
    monkeypatch.setattr(kept_programs, "MOST_FILES", len(own))
    kept_programs._make_room.__wrapped__(folder)
    assert sorted(f.name for f in folder.iterdir()) == sorted(own)


def test_programs_that_made_room_are_kept_again_and_not_read_from_xla_s_cache(tmp_path, monkeypatch):
    """XLA does not write down again what it read, so that they were traced in every process from then on."""
    folders = iter([tmp_path / "first", tmp_path / "second", tmp_path / "second"])
    z, numbers = np.array([0.3, 0.7]), (np.array([1.0, -3.0]),)
    functions = [Counted(), Counted(), Counted()]
    for function in functions:
        folder = next(folders)
        folder.mkdir(exist_ok=True)
        monkeypatch.setattr(kept_programs, "code_folder", lambda kind, folder=folder: folder)
        kept(function)(z, numbers)
    assert [f.traced for f in functions] == [1, 1, 0]


def test_names_are_others_when_programs_have_gone(tmp_path, monkeypatch):
    monkeypatch.setattr(kept_programs, "MOST_FILES", 2)
    age = kept_programs._age.__wrapped__
    before = age(tmp_path)
    assert before == age(tmp_path) != ""
    for k in range(4):
        (tmp_path / f"{k}").write_bytes(b"x")
        os.utime(tmp_path / f"{k}", (k, k))
    kept_programs._make_room.__wrapped__(tmp_path)
    assert sorted(f.name for f in tmp_path.iterdir()) == ["2", "3"]
    assert age(tmp_path) not in ("", before)


def test_without_a_cache_folder_the_bits_are_the_same(folder, monkeypatch):
    own = problem()
    z = np.full(own.space.dimension, 0.4)
    kept = own.residuals_and_jacobian(z)
    assert any(folder.rglob("*")), "nothing was kept"
    monkeypatch.setattr(kept_programs, "code_folder", lambda name: None)
    other = problem()
    assert other.compiled["residuals_and_jacobian"] is not own.compiled["residuals_and_jacobian"]
    for a, b in zip(kept, other.residuals_and_jacobian(z), strict=True):
        assert a.tobytes() == b.tobytes()
