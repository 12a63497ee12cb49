"""`plantfit tune`: from a finished study of a heater with known truth to a controller, its files, and what is said
when it cannot be."""

import ctypes
import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from cli_call import call, heater

from plantfit.cli.main import run_cli
from plantfit.control.pid import Gains
from plantfit.control.tune.loop_scores import limited_pid  # noqa: F401  (jax is set up)

pytestmark = pytest.mark.thorough

PLANTFIT = (sys.executable, "-c", "from plantfit.cli.start import run; run()")
CONTROL = """
[control]
set_point = "318.15 K"  # 45 degC
step = 5
upper = 80
plants = 20
horizon = "240 s"
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A heater's study file with a [control] table, run into plantfit.db."""
    folder = tmp_path_factory.mktemp("tune")
    spec = heater(folder)
    spec.write_text(spec.read_text() + CONTROL)
    with pytest.MonkeyPatch.context() as patch:  # in this process; the commands under test have their own
        patch.chdir(folder)
        patch.setattr(sys, "argv", ["plantfit", "run", "heater.toml"])
        run_cli()
    return folder


@pytest.fixture(scope="module")
def tuned(place):
    done = subprocess.run(
        [*PLANTFIT, "tune", "heater.toml", "--budget", "30", "--json"],
        cwd=place,
        capture_output=True,
        text=True,
        timeout=500,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_one_command_gives_record_page_and_c(place, tuned):
    assert tuned["wishes"]["set_point"] == pytest.approx(45.0)
    assert tuned["wishes"]["step"] == 5.0
    assert tuned["wishes"]["period"] == 1.0
    assert (tuned["wishes"]["lower"], tuned["wishes"]["upper"]) == (10.0, 80.0)
    assert "lowest u" in tuned["proposed"]["lower"]
    assert "upper" not in tuned["proposed"]
    assert tuned["reduced"]["gain"] == pytest.approx(0.8, rel=0.02)
    assert tuned["reduced"]["lag"] == pytest.approx(40.0, rel=0.03)
    assert tuned["reduced"]["dead_time"] == pytest.approx(3.9, abs=0.1)  # with half a sample
    first = tuned["controllers"][0]
    assert first["name"] == "all plants"
    assert first["Kp"] > 0
    assert first["stable"]
    assert [r["name"] for r in tuned["controllers"][2:]] == ["SIMC", "AMIGO", "lambda", "Ziegler-Nichols", "Cohen-Coon"]
    assert re.match(
        r"Of 20 plants that the data allow, \d+ % have an overshoot under 10 % and an Ms under 1.6; ",
        tuned["verdict"][0]["sentence"],
    )
    written = json.loads((place / "heater-tune.json").read_text())
    assert {k: v for k, v in tuned.items() if k != "files"} | {"made_by": "plantfit"} == written
    page = (place / "heater-tune.html").read_text("utf-8")
    assert "Controller of heater" in page
    assert tuned["verdict"][0]["sentence"] in page
    assert "https://" not in re.sub(r"<script.*?</script>", "", page, flags=re.S)


def test_the_c_file_is_the_controller_that_was_tuned(place, tuned):
    """Compiled, over 10 000 samples of a measurement that reaches both limits: python's PID to 1e-12."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not on this machine: the exported C is not compiled")
    library = place / "pid.so"
    subprocess.run(
        [
            "gcc",
            "-std=c99",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-ffp-contract=off",
            "-O2",
            "-shared",
            "-fPIC",
            "-o",
            library,
            place / "heater_pid.c",
        ],
        check=True,
    )
    program, state = ctypes.CDLL(str(library)), ctypes.create_string_buffer(256)
    program.heater_pid_init.argtypes, program.heater_pid_init.restype = (
        (ctypes.c_void_p, ctypes.c_double, ctypes.c_double),
        None,
    )
    program.heater_pid_update.argtypes = (ctypes.c_void_p, ctypes.c_double, ctypes.c_double)
    program.heater_pid_update.restype = ctypes.c_double
    from plantfit.control import pid

    import jax
    import jax.numpy as jnp

    row, w = tuned["controllers"][0], tuned["wishes"]
    gains = Gains(row["Kp"], row["Ki"], row["Kd"], row["b"], 0.0, row["filter_time"])
    rng = np.random.default_rng(1)
    y = 45 + np.cumsum(rng.normal(0, 0.3, 10_000)) * np.exp(-np.arange(10_000) / 4000)
    r = 45 + 5.0 * (np.arange(10_000) // 700 % 2)
    own = pid(w["period"], lower=w["lower"], upper=w["upper"])
    rest = 0.02 * w["upper"]
    state0 = own.init(jnp.asarray(y[0]), gains).at_rest(y[0], rest, gains)
    _, truth = jax.lax.scan(lambda s, v: own.update(s, v[0], v[1], gains), state0, (jnp.asarray(y), jnp.asarray(r)))
    program.heater_pid_init(state, y[0], rest)
    found = np.array([program.heater_pid_update(state, a, b) for a, b in zip(y, r, strict=True)])
    assert found.min() == w["lower"]
    assert found.max() == w["upper"]
    np.testing.assert_allclose(found, np.asarray(truth), rtol=1e-12, atol=1e-12 * w["upper"])


def test_what_cannot_be_is_one_sentence(place, tuned, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    spec = place / "heater.toml"
    said = call(capsys, monkeypatch, "tune", str(spec))
    assert said.code == 10
    assert "so the study 'heater' has not been run; run it first: `plantfit run " in said.err
    text = spec.read_text()
    changed = tmp_path / "heater.toml"
    (tmp_path / "heater.csv").write_text((place / "heater.csv").read_text())
    changed.write_text(text.replace("bounds = [0.01, 10.0]", "bounds = [0.01, 20.0]"))
    said = call(capsys, monkeypatch, "tune", "heater.toml", "--store", str(place / "plantfit.db"))
    assert said.code == 10
    assert "has another [parameters] than study 1" in said.err
    changed.write_text(text.replace("set_point = ", "setpoint = "))
    said = call(capsys, monkeypatch, "tune", "heater.toml")
    assert said.code == 7
    assert "key 'control.setpoint' is not known; did you mean 'set_point'?" in said.err
    changed.write_text(text.replace("horizon = ", "ms = 0.5\nhorizon = "))
    assert "control.ms = 0.5 cannot be used" in call(capsys, monkeypatch, "tune", "heater.toml").err
    monkeypatch.chdir(place)
    said = call(capsys, monkeypatch, "tune", "heater.toml", "--set-point", "P=45 degC")
    assert said.code == 7
    assert "There is no output 'P'; the model has T." in said.err
    said = call(capsys, monkeypatch, "tune", "heater.toml", "--set-point", "T=300 degC")
    assert said.code == 9
    assert "they cannot hold that set point" in said.err
    assert "Traceback" not in said.err
    said = call(capsys, monkeypatch, "tune", "heater.toml", "--set-point", "45 bar")
    assert said.code == 4
    said = call(capsys, monkeypatch, "tune", "heater.toml", "--tolerance", "10 %")
    assert said.code == 7
    assert "--tolerance '10 %' names no parameter; write for example 'tau=10 %'" in said.err
    said = call(capsys, monkeypatch, "tune", "heater.toml", "--tolerance", "T=10 %")
    assert said.code == 7
    assert "[control] tolerances names 'T'; the model has the parameters" in said.err
    for words, sentence in (
        (("--front", "iae,size"), "front names 'size'; the figures are iae, itae, load_iae"),
        (("--front", "iae"), "A front has two or three different figures, not iae"),
        (("--minimise", "iae=much"), "--minimise 'iae=much' gives no weight; write for example iae=1,travel=0.2"),
        (("--minimise", "size=1"), "minimise names 'size'"),
        (("--pick", "2"), "pick chooses a point of a front"),
        (("--levels", "3"), "[control] levels belongs to controller = 'scheduled', and the controller is 'pid'"),
        (
            ("--inner-upper", "3 A"),
            "[control] inner_upper belongs to controller = 'cascade', and the controller is 'pid'",
        ),
        (
            ("--number", "q15", "--controller", "smith"),
            "Fixed point is written of a PID or PI, and 'smith' was asked for",
        ),
        (("--number", "q15", "--full-scale", "P=3"), "[control] full_scale names 'P'; it may name T and u"),
        (("--full-scale", "T=100 degC"), "full_scale belongs to number = 'q15' or 'q31', and the number is 'double'"),
        (
            ("--number", "q15", "--full-scale", "100"),
            "--full-scale '100' names no signal; write for example 'T=100 degC'",
        ),
        (("--controller", "cascade"), "A cascade measures an inner output beside T: the model has no other"),
        (("--controller", "cascade", "--inner", "i"), "There is no inner output 'i'; beside T the model has none"),
    ):
        said = call(capsys, monkeypatch, "tune", "heater.toml", *words)
        assert said.code == 7, said
        assert sentence in said.err
    text = (place / "heater.toml").read_text("utf-8")
    (place / "other.toml").write_text(text.replace('"318.15 K"', '"45 bar"'), encoding="utf-8")
    said = call(capsys, monkeypatch, "tune", "other.toml", "--study", "1")
    assert said.err.splitlines()[-1].startswith("plantfit: other.toml, [control] set_point = '45 bar'")
    said = call(capsys, monkeypatch, "tune", "other.toml", "--study", "1", "--set-point", "46 bar")
    assert said.err.splitlines()[-1].startswith("plantfit: [control] set_point = '46 bar'")  # not of the file
    for words, sentence in (
        (
            ("--lower", "60", "--upper", "20"),
            "The limits of u are lower = 60 % and upper = 20 %; give lower below upper ([control] lower and upper,",
        ),
        (("--upper", "5"), "upper = 5 % is not above 10 %, the lowest u of the recordings; give lower too"),
    ):  # the heater's study file gives upper alone
        said = call(capsys, monkeypatch, "tune", "heater.toml", *words)
        assert said.code == 9, said
        assert sentence in said.err
        assert "The recordings have" not in said.err


@pytest.mark.slow
def test_an_output_that_is_not_named_is_asked_for_before_anything_is_opened(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tanks.csv").write_text("t,u,h1,h2\n0,1,0,0\n1,1,0.1,0\n2,1,0.2,0.1\n", "utf-8")
    (tmp_path / "tanks.toml").write_text(
        'name = "tanks"\n[recording.run]\nfile = "tanks.csv"\n[model]\n'
        'equations = """\nh1\' = k*u - a*h1\nh2\' = a*(h1 - h2)\n"""\n'
        'inputs = { u = "1" }\nstates = ["h1", "h2"]\noutputs = { h1 = "1", h2 = "1" }\n'
        "[parameters]\nk = { bounds = [0.1, 1] }\na = { bounds = [0.1, 1] }\n",
        "utf-8",
    )
    said = call(capsys, monkeypatch, "tune", "tanks.toml")
    assert said.code == 7
    assert "The model has the outputs h1, h2, and one loop has one" in said.err
    said = call(capsys, monkeypatch, "tune", "tanks.toml", "--output", "h3")
    assert "There is no output 'h3'; the model has h1, h2." in said.err
    said = call(capsys, monkeypatch, "tune", "tanks.toml", "--output", "h2")
    assert said.code == 10
    assert "has not been run" in said.err


def test_a_pendubot_is_held_upright_from_its_regression(tmp_path):
    """From a virtual record to page, JSON and C; without --hold, and held where nothing rests, one sentence."""
    for words in (
        ("rig", "pendubot", "--study"),
        ("tune", "pendubot.toml", "--hold", "theta1=90 deg", "--lower", "-24V", "--upper", "24V"),
    ):
        done = subprocess.run([*PLANTFIT, *words], cwd=tmp_path, capture_output=True, text=True, timeout=600)
        assert done.returncode == 0, done.stderr
    assert "100 % return to the point from theta1 0.1 rad away to either side" in " ".join(done.stdout.split())
    told = json.loads((tmp_path / "pendubot-tune.json").read_text())
    best = told["regulators"][0]
    assert best["share"] == 1.0
    assert 0.17 < best["below"] < 0.23  # the LQR of docs/control.md catches 12.1 degrees
    assert told["unstable"][0] == pytest.approx(11.2, abs=0.3)
    assert told["wishes"]["quantum"]["theta1"] == pytest.approx(2 * np.pi / 10_000, rel=1e-3)
    assert "From the lean back to the point" in (tmp_path / "pendubot-tune.html").read_text("utf-8")
    if shutil.which("gcc") is not None:
        flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only"]
        subprocess.run(["gcc", *flags, tmp_path / "pendubot_lqr.c"], check=True)
    for words, sentence in (
        ((), "is a regression, which is solved at once and closes no loop of one output; say where its plant is held"),
        (("--controller", "lqr"), "Nothing is to be held; give states and where"),
        (("--hold", "theta9=1"), "[control] hold names 'theta9'; the states are theta1, theta2, omega1, omega2."),
        (("--hold", "90 deg"), "--hold '90 deg' names no state"),
        (("--hold", "theta1=90 deg", "--lower", "-9V", "--upper", "-1V"), "beyond its limits"),
        (
            ("--hold", "theta1=90 deg", "--lower", "1V", "--upper", "-1V"),
            "lower = 1 V and upper = -1 V; give lower below",
        ),
    ):
        done = subprocess.run(
            [*PLANTFIT, "tune", "pendubot.toml", *words], cwd=tmp_path, capture_output=True, text=True, timeout=300
        )
        assert done.returncode != 0
        assert sentence in " ".join(done.stderr.split())
        assert "Traceback" not in done.stderr


def driven(tuned, seconds=240.0):
    """The output after a step, the plant known: T = 21 + 0.8 u, tau 40 s, 3.4 s late, at rest without power; and the
    inputs."""
    w, running = tuned.settings, tuned.running()
    h, y, u = w.period, 21.0, [0.0] * 20
    running.begin(y)
    past = round(3.4 / h)
    for _ in range(round(seconds / h)):
        u.append(running.update(y, tuned.set_point))
        assert w.lower - 1e-9 <= u[-1] <= w.upper + 1e-9
        y += (1.0 - np.exp(-h / 40.0)) * (21.0 + 0.8 * u[-1 - past] - y)
    return y


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "form", "c"),
    [
        (("--controller", "smith"), "Smith predictor", "smith"),
        (("--controller", "scheduled", "--levels", "42 degC,47 degC"), "scheduled PID", "scheduled"),
        (("--front", "load_iae,travel", "--points", "3", "--pick", "1"), "PID", "pid"),
        (("--number", "q15", "--full-scale", "T=100 degC"), "PID", "pid"),
    ],
)
def test_other_controllers_by_command_their_pages_their_c_and_what_a_rig_reads_of_them(place, tmp_path, words, form, c):
    more = (*words, "--budget", "60", "--out", str(tmp_path / "it.html"), "--json")
    done = subprocess.run(
        [*PLANTFIT, "tune", "heater.toml", *more], cwd=place, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["form"] == form
    assert told["controllers"][0]["stable"]
    page = (tmp_path / "it.html").read_text("utf-8")
    files = {f.rsplit("/", 1)[-1]: f for f in told["files"]}
    assert {"it.html", "it.json", f"heater_{c}.c", f"heater_{c}.h"} == set(files)
    if shutil.which("gcc") is not None:
        subprocess.run(
            ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only", files[f"heater_{c}.c"]],
            check=True,
        )
    from plantfit.rig.offered.tuned import read_tuned

    tuned = read_tuned(files["it.json"])
    assert tuned.form == form
    assert tuned.told
    assert driven(tuned) == pytest.approx(tuned.set_point, abs=0.05 * abs(tuned.step))
    if form == "Smith predictor":
        assert told["controllers"][0]["ahead"] == 3
        assert "a Smith predictor" in page or "Smith predictor" in page
    elif form == "scheduled PID":
        assert [r["level"] for r in told["schedule"]["levels"]] == pytest.approx([42.0, 47.0])
        assert "Gains over the level" in page
        assert "the schedule gains nothing here" in told["verdict"][1]["sentence"]  # the plant is linear
    elif "--number" in words:
        header = (tmp_path / "heater_pid.h").read_text()
        # 10 and 80 % of 100 %
        assert "Fixed point: signals of 16 bits, the command limited to 3277 .. 26214 steps." in header
        assert told["proposed"]["full_scale.u"].startswith("100 %, above all")
        assert "full_scale.T" not in told["proposed"]
    else:
        assert told["front"]["picked"] == 1
        first, *_, last = told["front"]["points"]
        assert first["figures"]["load_iae"] < last["figures"]["load_iae"]
        assert first["figures"]["travel"] > last["figures"]["travel"]
        assert told["controllers"][0]["Kp"] == first["settings"]["Kp"]
        assert "numbered as --pick takes them" in page


@pytest.mark.slow
def test_an_mpc_by_command_its_page_its_c_and_what_record_reads_of_it(place, tmp_path):
    """Tuned with a limit of the rate; driven sample by sample as `plantfit record --controller` does, it holds the
    known plant."""
    words = ("--controller", "mpc", "--rate", "20 %/s", "--budget", "30", "--out", tmp_path / "mpc.html", "--json")
    done = subprocess.run(
        [*PLANTFIT, "tune", "heater.toml", *map(str, words)], cwd=place, capture_output=True, text=True, timeout=900
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["form"] == "MPC"
    assert told["plan"]["moves"][0] == 1
    assert [r["form"] for r in told["controllers"][:4]] == ["MPC", "MPC", "LQI", "PID"]
    assert "MPC" in (tmp_path / "mpc.html").read_text("utf-8")
    files = {f.rsplit("/", 1)[-1]: f for f in told["files"]}
    assert {"mpc.html", "mpc.json", "heater_mpc.c", "heater_mpc.h"} == set(files)
    if shutil.which("gcc") is not None:
        subprocess.run(
            ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only", files["heater_mpc.c"]],
            check=True,
        )
    from plantfit.rig.offered.tuned import read_tuned

    tuned = read_tuned(files["mpc.json"])
    w, running = told["wishes"], tuned.running()
    h, y, u = w["period"], 21.0, [0.0] * 20  # as in `driven`
    running.begin(y)
    past = round(3.4 / h)
    for _ in range(round(240 / h)):
        u.append(running.update(y, w["set_point"]))
        assert w["lower"] - 1e-9 <= u[-1] <= w["upper"] + 1e-9
        y += (1.0 - np.exp(-h / 40.0)) * (21.0 + 0.8 * u[-1 - past] - y)
    assert y == pytest.approx(w["set_point"], abs=0.05 * abs(w["step"]))
    assert np.max(np.abs(np.diff(u[21:]))) <= 20.0 * h + 1e-9


@pytest.mark.slow
def test_a_share_promised_within_stated_tolerances_holds_on_a_thousand_fresh_plants_within_three_percent(
    place, tmp_path
):
    """Both forms, 1000 plants that judge and 1000 others of the same distribution; page and C file of the LQI."""
    import plantfit as pf
    from plantfit.control.tune.frequency import frequencies, sampled_response
    from plantfit.control.tune.loop_design import FINE
    from plantfit.control.tune.loop_scores import Judge
    from plantfit.control.tune.reduction import slowest
    from plantfit.control.tune.searching.judged import judged_on
    from plantfit.control.tune.stated import toleranced
    from plantfit.report.pages.controller import write_controller_page

    asked = {"tau": "15 %", "L": "30 %", "K": "15 %"}
    answer = pf.open_study("heater", store=str(place / "plantfit.db"))
    found = pf.tune(answer, budget=100, tolerances=asked, plants=1000, controller="lqi")
    d, w = found.design, found.design.wishes
    assert found.design.best.share >= 0.9
    assert "plants within the stated tolerances, " in found.verdict[0]["sentence"]
    page = write_controller_page(found.typed, found.curves, tmp_path / "page.html").read_text("utf-8")
    assert "LQI on plants within the stated tolerances" in page
    assert "A PID tuned on the same plants: " in page
    assert found.to_c(tmp_path).source.name == "heater_lqi.c"
    assert repr(found).startswith("LQI of T by u: K (")
    best = {n: v[0] for n, v in d.family.plants.items()}
    fresh = d.family.part(slice(0, 1))
    fresh = type(fresh)(fresh.model, fresh.output, fresh.input, fresh.others, toleranced(best, asked, {}, 1000, 99))
    start, rest = (fresh.at_rest(level, (w.lower, w.upper)) for level in (w.set_point - w.step, w.set_point))
    f = frequencies(w.period, slowest(d.reduced), FINE)
    h = sampled_response(rest, w.period, f)
    for row in d.rows:
        judge = Judge.of(fresh, start, d.course, w.quantum, row.form)
        share = float(np.mean(judged_on(judge, row.form, [row.parameters], h, f, w, 1).kept))
        print(f"{row.name} ({row.form.name}): promised {100 * row.share:.1f} %, fresh {100 * share:.1f} %")
        assert share == pytest.approx(row.share, abs=0.03)
