"""Units of time in study files: what is fitted is the truth in the unit told; else there is a line to write."""

import numpy as np
import pytest

import plantfit as pf
from plantfit.errors import EquationError, PlantfitError, SpaceError, UnitError
from plantfit.spec import parse

SECONDS = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0, "day": 86400.0, "week": 604800.0}
K, TAU, LATE = 2.0, 120.0, 20.0  # the truth
LIBRARY = 'kind = "first_order"\noptions = { input_unit = "%", output_unit = "degC", offset = false }'


def recorded(folder, unit="s", scale=1.0):
    """A lag with dead time under steps, every 10 s for 20 minutes; input in % or of another scale."""
    t = np.arange(0.0, 1200.0, 10.0)
    u = np.where((t // 300) % 2 == 0, 0.0, 10.0)
    y, x = [0.0], 0.0
    for end in t[1:]:
        late = u[int(end - 10.0 - LATE) // 10] if end - 10.0 >= LATE else 0.0
        x = K * late + (x - K * late) * np.exp(-10.0 / TAU)
        y.append(x)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(t))
    rows = "".join(
        f"{a:.15g},{b:.15g},{c:.15g}\n"
        for a, b, c in zip(t / SECONDS[unit], u * scale, np.asarray(y) + noise, strict=True)
    )
    (folder / "r.csv").write_text(f"t [{unit}],u [%],y [degC]\n" + rows)


def study(folder, model, parameters, recording=""):
    tables = "".join(f"[parameters.{name}]\n{table}\n" for name, table in parameters.items())
    text = f'name = "lag"\n[recording.r]\nfile = "r.csv"\n{recording}\n[model]\n{model}\n{tables}'
    return parse(text, folder / "lag.toml")


def equations(text, signals='inputs = ["u"]\nstates = ["x"]\noutputs = ["y"]'):
    return f'equations = "{text}"\n{signals}'


LAG = "x' = (K*delay(u, L) - x)/tau; y = x"
TEXT = {
    "s": (equations(LAG), {"tau": 'bounds = [10, 1000]\nunit = "s"', "L": 'bounds = [0, 100]\nunit = "s"'}),
    "no unit": (equations(LAG), {"tau": "bounds = [10, 1000]", "L": "bounds = [0, 100]"}),
    "min, converted": (
        equations("x' = (K*delay(u, L) - x)/(60*tau); y = x"),
        {"tau": 'bounds = [0.2, 20]\nunit = "min"', "L": 'bounds = [0, 100]\nunit = "s"'},
    ),
    "1/h, converted": (
        equations("x' = (K*delay(u, L) - x)*tau/h; y = x") + '\nconstants = { h = "3600 s/h" }',
        {"tau": 'bounds = [3, 300]\nunit = "1/h"', "L": "bounds = [0, 100]"},
    ),
}  # fmt: skip
TRUTH = {"s": TAU, "no unit": TAU, "min, converted": TAU / 60, "1/h, converted": 3600 / TAU}


SOME = [("s", "s"), ("no unit", "min"), ("min, converted", "s"), ("1/h, converted", "min")]


@pytest.mark.parametrize(("what", "unit"), [
    pytest.param(w, u, marks=() if (w, u) in SOME else pytest.mark.slow) for w in TEXT for u in ("s", "min")
])  # fmt: skip
@pytest.mark.thorough
def test_equations_fit_the_truth_in_the_unit_that_is_told(what, unit, tmp_path):
    recorded(tmp_path, unit)
    model, parameters = TEXT[what]
    values = pf.fit(study(tmp_path, model, {"K": "bounds = [0.1, 10]", **parameters}).problem, budget=1200).values
    assert values["tau"] == pytest.approx(TRUTH[what], rel=2e-3)
    assert values["L"] == pytest.approx(LATE, abs=0.2)
    assert values["K"] == pytest.approx(K, rel=2e-3)


@pytest.mark.parametrize(
    ("unit", "own"),
    [("s", "min"), ("ms", "s"), *(pytest.param(*p, marks=pytest.mark.slow) for p in (("min", "h"), ("day", "week")))],
)
@pytest.mark.thorough
def test_a_library_model_converts_to_seconds_and_tells_them(unit, own, tmp_path):
    recorded(tmp_path, unit)
    low, high = (v / SECONDS[own] for v in (10, 1000))
    parameters = {
        "tau": f'bounds = [{low!r}, {high!r}]\nunit = "{own}"',
        "L": f'bounds = [0, {100 / SECONDS[own]!r}]\nunit = "{own}"',
    }
    problem = study(tmp_path, LIBRARY, {"K": "bounds = [0.1, 10]", **parameters}).problem
    values = pf.fit(problem, budget=1200).values
    assert {problem.space.parameters[n].unit for n in ("tau", "L")} == {"s"}
    assert values["tau"] == pytest.approx(TAU, rel=2e-3)
    assert values["L"] == pytest.approx(LATE, abs=0.2)


REFUSED = {
    "min": (equations(LAG), {"tau": 'bounds = [1, 10]\nunit = "min"'}, EquationError,
            "Write unit = \"s\", bounds = [60, 600] for 'tau'"),
    "week": (equations(LAG), {"tau": 'bounds = [1, 10]\nunit = "week"'}, EquationError,
             "bounds = [604800, 6048000] for 'tau'"),
    "held": (equations(LAG), {"tau": 'value = 2\nunit = "min"'}, EquationError, 'unit = "s", value = 120'),
    "furlong": (equations(LAG), {"tau": 'bounds = [1, 10]\nunit = "furlong"'}, EquationError,
                "has the unit 'furlong', but must be in s"),
    "late": (equations(LAG), {"L": 'bounds = [0, 1]\nunit = "min"'}, EquationError, "bounds = [0, 60] for 'L'"),
    "late, unchecked": (equations(LAG) + "\ncheck_units = false", {"L": 'bounds = [0, 1]\nunit = "min"'}, UnitError,
                        "dead times are in s"),
    "tied": (equations(LAG), {"tau": "bounds = [1, 10]", "L": 'tied = "tau"\nunit = "s"'}, None, ""),
    "tied otherwise": (LIBRARY, {"tau": "bounds = [1, 10]", "L": 'tied = "K"'}, SpaceError, "give both one unit"),
    "library, furlong": (LIBRARY, {"tau": 'bounds = [1, 10]\nunit = "furlong"'}, UnitError, "the model has it in 's'"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_a_wrong_unit_is_refused_with_file_and_line_to_write(what, tmp_path):
    recorded(tmp_path)
    model, parameters, kind, told = REFUSED[what]
    parameters = {"K": "bounds = [0.1, 10]", "tau": "bounds = [10, 1000]", "L": "bounds = [0, 100]"} | parameters
    if kind is None:
        study(tmp_path, model, parameters)
        return
    with pytest.raises(kind) as caught:
        study(tmp_path, model, parameters)
    assert "lag.toml" in str(caught.value)
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("header", "line", "told"),
    [
        ("min", 'time_unit = "s"', "says 'min'"),
        ("min", 'time_unit = "furlong"', "not a unit of time"),
        ("min", "", None),
    ],
)
def test_the_unit_of_the_time_column_is_one(header, line, told, tmp_path):
    recorded(tmp_path, header)
    parameters = {"K": "bounds = [0.1, 10]", "tau": "bounds = [10, 1000]", "L": "bounds = [0, 100]"}
    if told is None:
        problem = study(tmp_path, equations(LAG), parameters, line).problem
        assert problem.experiments["r"].recording.t[1] == pytest.approx(10.0)
        return
    with pytest.raises(PlantfitError, match=told):
        study(tmp_path, equations(LAG), parameters, line)


@pytest.mark.parametrize(
    ("gain", "told"), [("degC/%", None), ("degC", "input 'u' has the unit '%'"), ("K/%", None), ("V/%", None)]
)
def test_recorded_units_are_held_against_declared_ones(gain, told, tmp_path):
    """A kind that does not fit may be a header that was misread; a size that does not fit makes a value wrong."""
    recorded(tmp_path)
    parameters = {"K": f'bounds = [0.1, 10]\nunit = "{gain}"', "tau": "bounds = [10, 1000]", "L": "bounds = [0, 100]"}
    if told is None:
        study(tmp_path, equations(LAG), parameters)
        return
    with pytest.raises(EquationError) as caught:
        study(tmp_path, equations(LAG), parameters)
    assert told in str(caught.value)
